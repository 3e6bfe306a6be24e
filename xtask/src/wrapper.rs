//! Builds with a `--cfg` for this workspace's crates alone. Flags for all crates would compile those of others again; so this program stands between
//! cargo and rustc, as clippy does, and adds it where the crate is one of this workspace.

use std::{
    env,
    ffi::OsString,
    process::{Command, ExitCode},
};

/// Set, to what `--cfg` is to say, where this program is rustc's wrapper.
const CFG: &str = "XTASK_RUSTC_CFG";

/// What lets cargo compile with this `--cfg`. Cargo tells such builds from ordinary ones, but not one `--cfg` from another: each further one
/// needs a target folder of its own.
pub(crate) fn environment(cfg: &str) -> Result<[(&'static str, OsString); 2], String> {
    let own = env::current_exe().map_err(|source| format!("this program does not know where it is: {source}"))?;
    Ok([("RUSTC_WORKSPACE_WRAPPER", own.into()), (CFG, cfg.into())])
}

/// What cargo asks rustc for, where this program is its wrapper: the first argument is rustc.
pub(crate) fn compile() -> Option<ExitCode> {
    let cfg = env::var_os(CFG)?;
    let mut words = env::args_os().skip(1);
    let rustc = words.next()?;
    let status = Command::new(&rustc).args(words).arg("--cfg").arg(cfg).status();
    Some(match status {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(source) => {
            eprintln!("error: {}: could not be started: {source}", rustc.display());
            ExitCode::FAILURE
        }
    })
}
