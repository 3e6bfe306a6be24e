//! The Debian package of an archive's tree.

use std::{fs, path::Path};

use super::{archive, tools::Tools};
use crate::{
    system::{VERSION, at, copy, empty, has_program},
    web::copy_folder,
};

/// The package and its command. Debian's `gs` is Ghostscript, so the names of the tree are not free.
pub(super) const NAME: &str = "gaussian-splats";

/// The file in which Debian looks for licences.
const COPYRIGHT: &str = concat!(
    "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n\nFiles: *\nCopyright: ",
    env!("CARGO_PKG_AUTHORS"),
    "\nLicense: MIT or Apache-2.0\nComment: LICENSE-MIT and LICENSE-APACHE beside this file have the texts.\n \
     THIRD-PARTY-LICENSES.txt has those of what the program contains.\n"
);

/// Packs a tree of `bin` and `share` as a package, where dpkg-deb is.
pub(super) fn pack(tools: &Tools, architecture: &str, tree: &Path, manual: &Path, out: &Path) -> Result<(), String> {
    let file = format!("{NAME}_{VERSION}_{architecture}.deb");
    if !has_program("dpkg-deb") {
        eprintln!("skipped: {file}: there is no dpkg-deb");
        return Ok(());
    }
    let root = tree.with_file_name(format!("{NAME}_{architecture}"));
    empty(&root)?;
    let (library, share) = (root.join("usr/lib").join(NAME), root.join("usr/share"));
    copy(&tree.join("bin/gs"), &library.join("bin/gs"))?;
    copy_folder(&tree.join("share/gs"), &library.join("share/gs"))?;
    let documents = share.join("doc").join(NAME);
    copy_folder(&tree.join("share/doc/gs"), &documents)?;
    archive::shells(manual, NAME, &share)?;
    let failed = at(&root);
    fs::write(documents.join("copyright"), COPYRIGHT).map_err(&failed)?;
    fs::create_dir_all(root.join("usr/bin")).map_err(&failed)?;
    link(&format!("../lib/{NAME}/bin/gs"), &root.join("usr/bin").join(NAME)).map_err(&failed)?;
    fs::create_dir_all(root.join("DEBIAN")).map_err(&failed)?;
    fs::write(root.join("DEBIAN/control"), control(architecture)).map_err(&failed)?;
    tools.script("pack.py", [&root, &out.join(file)])
}

fn control(architecture: &str) -> String {
    format!(
        "Package: {NAME}\n\
         Version: {VERSION}\n\
         Architecture: {architecture}\n\
         Maintainer: {}\n\
         Section: graphics\n\
         Priority: optional\n\
         Depends: libc6 (>= 2.28)\n\
         Recommends: libvulkan1, mesa-vulkan-drivers\n\
         Description: Gaussian-splatting engine\n \
         Turns images into 2D Gaussians and posed images into 3D scenes, on the CPU or a GPU.\n \
         The command is {NAME}, since gs is Ghostscript in Debian.\n",
        env!("CARGO_PKG_AUTHORS")
    )
}

#[cfg(unix)]
fn link(to: &str, path: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(to, path)
}

#[cfg(not(unix))]
fn link(_: &str, _: &Path) -> std::io::Result<()> {
    Err(std::io::Error::other("Debian packages are made on Unix"))
}
