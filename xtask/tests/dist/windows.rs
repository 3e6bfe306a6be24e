//! The Windows program under Wine: each kind of command, in folders with names that are not ASCII.

use std::{fs, path::Path};

use super::{
    bench::{Bench, Outcome, expect},
    program::Program,
};
use xtask::system::{at, copy};

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    let folder = bench.folder("windows")?.join("Größe 図");
    fs::create_dir_all(folder.join("Bilder")).map_err(at(&folder))?;
    let Some(gs) = Program::windows(bench, &folder)? else {
        return Ok(Outcome::Skipped("there is no Wine; --install installs it".to_owned()));
    };
    copy(&bench.image, &folder.join("Bilder").join("Fähre 七.png"))?;
    let photo = r"Bilder\Fähre 七.png";
    images(&gs, &folder, photo)?;
    training(&gs, &folder, &format!("Z:{}", bench.dataset.display()).replace('/', r"\"))?;
    // A second run into the folder of one at work, and one into the folder of one that has ended.
    let run = ["fit", photo, "-o", r"aus\lang", "-n", "9000", "-i", "40000"];
    let busy = gs.start(&folder, &run)?;
    gs.refuses(&folder, &run, 1, "another run of gs is at work in this folder")?;
    busy.interrupt()?;
    expect(folder.join("aus/lang/checkpoint.safetensors").is_file(), || "Ctrl-C kept no checkpoint".to_owned())?;
    gs.run(&folder, &["fit", photo, "-o", r"aus\lang", "-n", "500", "-i", "20"])?;
    gs.refuses(&folder, &["fit", photo, "-o", "Bilder", "--gaussian"], 2, "--gaussians")?;
    Ok(Outcome::Passed("fit, encode, decode, eval, train, convert, page, a second run, Ctrl-C".to_owned()))
}

fn images(gs: &Program, folder: &Path, photo: &str) -> Result<(), String> {
    gs.run(folder, &["fit", photo, "-o", r"aus\fit", "-n", "1000", "-i", "50"])?;
    gs.run(folder, &["encode", photo, "-o", r"aus\é.gsi", "--bpp", "0.3"])?;
    gs.run(folder, &["decode", r"aus\é.gsi", "-o", r"aus\é.png"])?;
    let quality = gs.run(folder, &["eval", photo, r"aus\é.png"])?;
    expect(psnr(&quality).is_some_and(|psnr| psnr > 30.0), || format!("the decoded image is poor: {quality}"))?;
    gs.run(folder, &["page", r"aus\fit", "-o", r"aus\é.html"]).map(drop)
}

/// The first number after "PSNR".
fn psnr(text: &str) -> Option<f64> {
    text.split("PSNR").nth(1)?.split_whitespace().next()?.parse().ok()
}

fn training(gs: &Program, folder: &Path, dataset: &str) -> Result<(), String> {
    gs.run(folder, &["train", dataset, "-i", "50", "-o", r"aus\scène"])?;
    for format in ["spz", "sog", "splat"] {
        gs.run(folder, &["convert", r"aus\scène", &format!(r"aus\scène.{format}")])?;
    }
    let info = gs.run(folder, &["info", r"aus\scène.spz"])?;
    expect(info.contains("Gaussians"), || format!("info of the converted scene: {info}"))
}
