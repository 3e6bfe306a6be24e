//! The npm package in a browser.

use super::{Bench, Outcome};
use crate::web;

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    Ok(match web::test_package(&web::archive(bench.release), bench.install)? {
        true => Outcome::Passed("both entries in headless Chromium, the decoder also in Node".to_owned()),
        false => Outcome::Skipped("there is no browser, or no Node; --install installs them".to_owned()),
    })
}
