//! The same bits from the programs of all systems.

use std::path::{Path, PathBuf};

use super::{
    bench::{Bench, Outcome, expect},
    program::{Program, equal},
};
use xtask::system::empty;

/// The files that are compared: a fit, a compressed image and a trained scene.
const FILES: [&str; 3] = ["fit/scene.gs2d.safetensors", "image.gsi", "scene/scene.ply"];

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    let folder = bench.folder("bits")?;
    let Some(linux) = Program::linux(bench, &folder)? else {
        return Ok(Outcome::Skipped("this is not x86-64 Linux".to_owned()));
    };
    let on_linux = results(&linux, &folder.join("linux"), &bench.image, &bench.dataset)?;
    let Some(windows) = Program::windows(bench, &folder)? else {
        return Ok(Outcome::Skipped("there is no Wine; --install installs it".to_owned()));
    };
    let on_windows = results(&windows, &folder.join("windows"), &bench.image, &bench.dataset)?;
    for file in FILES {
        expect(equal(&on_linux.join(file), &on_windows.join(file))?, || {
            format!("{file} differs on Linux and Windows")
        })?;
    }
    Ok(Outcome::Passed(format!("{} of Linux and Windows, x86-64, at the lowest SIMD level", FILES.join(", "))))
}

/// Makes the files in a new folder.
fn results(gs: &Program, folder: &Path, image: &Path, dataset: &Path) -> Result<PathBuf, String> {
    empty(folder)?;
    let [image, dataset] = [image, dataset].map(|path| path.display().to_string());
    let level = ["--simd", "baseline"];
    gs.run(folder, &[&["fit", &image, "-o", "fit", "-n", "2000", "-i", "100"], &level[..]].concat())?;
    gs.run(folder, &[&["encode", &image, "-o", "image.gsi", "--bpp", "0.3"], &level[..]].concat())?;
    gs.run(folder, &[&["train", &dataset, "-o", "scene", "-i", "50"], &level[..]].concat())?;
    Ok(folder.to_owned())
}
