//! The licences of a release, and its bills of materials.

use std::path::{Path, PathBuf};

use super::{systems::System, tools::Tools};
use crate::system::{empty, target};

/// The licences of what a file of the release is made of.
pub(super) const NOTICES: &str = "THIRD-PARTY-LICENSES.txt";

/// What a release for a system is made of.
#[derive(Debug)]
pub(super) struct Papers {
    /// The licences of everything.
    pub(super) notices: PathBuf,
    /// The SBOM of the program and the page.
    pub(super) program: PathBuf,
    /// The SBOM of the Python module.
    pub(super) module: PathBuf,
}

impl Papers {
    pub(super) fn write(tools: &Tools, system: &System) -> Result<Self, String> {
        let folder = target().join("dist-tools/papers").join(system.name);
        empty(&folder)?;
        let [notices, program, module] =
            [NOTICES, "gs.cdx.json", "gaussian_splats.cdx.json"].map(|name| folder.join(name));
        tools.script("notices.py", [Path::new(system.triple), &notices, &program, &module])?;
        Ok(Self { notices, program, module })
    }
}
