//! The archive of a system: the program with everything that belongs to it.

use std::path::{Path, PathBuf};

use super::{System, VERSION, copy, debian, empty, source, staging, tools::Tools};
use crate::web::copy_folder;

/// What all archives hold, besides files of the workspace.
#[derive(Debug)]
pub(crate) struct Contents {
    /// The program for the system.
    pub(crate) program: PathBuf,
    /// The folder with `man` and `completions`.
    pub(crate) manual: PathBuf,
    /// The folder of the page.
    pub(crate) page: PathBuf,
}

/// The documents of an archive.
const DOCUMENTS: [&str; 4] = ["README.md", "CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT"];

/// The licences of what the program is made of.
pub(crate) const NOTICES: &str = "THIRD-PARTY-LICENSES.txt";

/// Packs the archive of a system, its SBOM, and its Debian package. Returns the path of the notices.
pub(crate) fn pack(tools: &Tools, system: &System, contents: &Contents, out: &Path) -> Result<PathBuf, String> {
    let tree = staging(system);
    empty(&tree)?;
    let documents = if system.is_windows() { tree.clone() } else { tree.join("share/doc/gs") };
    for name in DOCUMENTS {
        copy(&source(name), &documents.join(name))?;
    }
    if system.is_windows() {
        windows(contents, &tree)?
    } else {
        linux(contents, &tree)?
    }
    let name = format!("gs-{VERSION}-{}", system.name);
    let sbom = out.join(format!("{name}.cdx.json"));
    let notices = documents.join(NOTICES);
    tools.script("notices.py", [system.triple.as_ref(), notices.as_path(), &sbom])?;
    let ending = if system.is_windows() { "zip" } else { "tar.gz" };
    tools.script("pack.py", [&tree, &out.join(format!("{name}.{ending}"))])?;
    if let Some(architecture) = system.debian {
        debian::pack(tools, architecture, &tree, out)?;
    }
    Ok(notices)
}

/// The folders of a prefix like `/usr/local` or `~/.local`, into which the archive can be unpacked.
fn linux(contents: &Contents, tree: &Path) -> Result<(), String> {
    let share = tree.join("share");
    copy(&contents.program, &tree.join("bin/gs"))?;
    copy_folder(&contents.page, &share.join("gs/page"))?;
    copy_folder(&contents.manual.join("man"), &share.join("man/man1"))?;
    for (from, to) in [
        ("gs.bash", "bash-completion/completions/gs"),
        ("_gs", "zsh/site-functions/_gs"),
        ("gs.fish", "fish/vendor_completions.d/gs.fish"),
    ] {
        copy(&contents.manual.join("completions").join(from), &share.join(to))?;
    }
    Ok(())
}

/// A folder that is used where it is unpacked.
fn windows(contents: &Contents, tree: &Path) -> Result<(), String> {
    copy(&contents.program, &tree.join("gs.exe"))?;
    copy(&contents.manual.join("completions/_gs.ps1"), &tree.join("gs-completions.ps1"))?;
    copy_folder(&contents.page, &tree.join("page"))
}
