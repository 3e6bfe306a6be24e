//! `cargo xtask cluster`: starts the test of jobs on a Slurm cluster of this machine.

use crate::system::{Options, install_packages, start_test};

/// Installs Slurm, if that is asked for, and runs the test.
///
/// # Errors
/// What went wrong, in words.
pub fn run(options: Options) -> Result<(), String> {
    if options.install {
        install_packages(&["slurm-wlm", "munge"])
            .map_err(|error| format!("{error}: install Slurm by hand, or run without --install"))?;
    }
    start_test("cluster", false)
}
