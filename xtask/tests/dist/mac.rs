//! The compiler's checks for macOS.

use super::bench::{Bench, Outcome};
use xtask::system::{need_target, step, target};

const TRIPLE: &str = "aarch64-apple-darwin";

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    if let Err(error) = need_target(TRIPLE, bench.install) {
        return Ok(Outcome::Skipped(error));
    }
    let mut check = bench.tools.command("cargo-zigbuild");
    check.args(["check", "--locked", "--workspace", "--target", TRIPLE, "--target-dir"]).arg(target());
    step(&mut check)?;
    Ok(Outcome::Passed(format!("all crates pass cargo check for {TRIPLE}")))
}
