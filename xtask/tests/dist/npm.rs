//! The npm package in a browser.

use super::{
    bench::{Bench, Outcome},
    program::Program,
};
use xtask::web;

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    let folder = bench.folder("npm")?;
    let Some(gs) = Program::linux(bench, &folder)? else {
        return Ok(Outcome::Skipped("this is not x86-64 Linux".to_owned()));
    };
    Ok(match web::test_package(&web::archive(bench.release), || Ok(gs.path().to_owned()), bench.install)? {
        true => Outcome::Passed("both entries in headless Chromium, the decoder also in Node".to_owned()),
        false => Outcome::Skipped("there is no browser, or no Node; --install installs them".to_owned()),
    })
}
