//! The archive of a system: the program with everything that belongs to it.

use std::path::{Path, PathBuf};

use super::{
    debian,
    papers::{NOTICES, Papers},
    systems::System,
    tools::Tools,
};
use crate::{
    system::{VERSION, copy, empty, target, workspace},
    web::copy_folder,
};

/// What all archives hold, besides files of the workspace.
#[derive(Debug)]
pub(super) struct Contents {
    /// The program for the system.
    pub(super) program: PathBuf,
    /// The folder with `man` and `completions`.
    pub(super) manual: PathBuf,
    /// The same for the name of the command in the Debian package.
    pub(super) debian_manual: PathBuf,
    /// The folder of the page.
    pub(super) page: PathBuf,
}

/// The documents of an archive.
const DOCUMENTS: [&str; 4] = ["README.md", "CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT"];

/// Packs the archive of a system, its SBOM, and its Debian package.
pub(super) fn pack(
    tools: &Tools,
    system: &System,
    contents: &Contents,
    papers: &Papers,
    out: &Path,
) -> Result<(), String> {
    let tree = staging(system);
    empty(&tree)?;
    let documents = if system.is_windows() { tree.clone() } else { tree.join("share/doc/gs") };
    for name in DOCUMENTS {
        copy(&workspace().join(name), &documents.join(name))?;
    }
    if system.is_windows() {
        windows(contents, &tree)?
    } else {
        linux(contents, &tree)?
    }
    let name = format!("gs-{VERSION}-{}", system.name);
    copy(&papers.notices, &documents.join(NOTICES))?;
    copy(&papers.program, &out.join(format!("{name}.cdx.json")))?;
    let ending = if system.is_windows() { "zip" } else { "tar.gz" };
    tools.script("pack.py", [&tree, &out.join(format!("{name}.{ending}"))])?;
    if let Some(architecture) = system.debian {
        debian::pack(tools, architecture, &tree, &contents.debian_manual, out)?;
    }
    Ok(())
}

/// The folders of a prefix like `/usr/local` or `~/.local`, into which the archive can be unpacked.
fn linux(contents: &Contents, tree: &Path) -> Result<(), String> {
    let share = tree.join("share");
    copy(&contents.program, &tree.join("bin/gs"))?;
    copy_folder(&contents.page, &share.join("gs/page"))?;
    shells(&contents.manual, "gs", &share)
}

/// Man pages and completions, where man and the shells look for them.
pub(super) fn shells(manual: &Path, name: &str, share: &Path) -> Result<(), String> {
    copy_folder(&manual.join("man"), &share.join("man/man1"))?;
    for (from, to) in [
        (format!("{name}.bash"), format!("bash-completion/completions/{name}")),
        (format!("_{name}"), format!("zsh/site-functions/_{name}")),
        (format!("{name}.fish"), format!("fish/vendor_completions.d/{name}.fish")),
    ] {
        copy(&manual.join("completions").join(from), &share.join(to))?;
    }
    Ok(())
}

/// A folder that is used where it is unpacked.
fn windows(contents: &Contents, tree: &Path) -> Result<(), String> {
    copy(&contents.program, &tree.join("gs.exe"))?;
    copy(&contents.manual.join("completions/_gs.ps1"), &tree.join("gs-completions.ps1"))?;
    copy_folder(&contents.page, &tree.join("page"))
}

/// Where the trees of the archives are put together.
fn staging(system: &System) -> PathBuf {
    target().join("dist-tools").join("trees").join(format!("gs-{VERSION}-{}", system.name))
}
