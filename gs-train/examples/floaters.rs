//! Measures how many planted floaters are found, a twentieth of a scene's Gaussians, and how much of the scene is lost:
//! `cargo run --release -p gs-train --example floaters -- SCENE DATASET MAX_SIDE world`.

#![allow(clippy::print_stdout)]

use std::{num::NonZeroU32, path::Path, time::Instant};

use gs_core::{RenderSettings, Scene as _, Scene3d, examination::Examinable as _};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_io::dataset::{DatasetSettings, read_dataset};
use gs_train::{
    edit::Floaters,
    train::{Views, evaluate},
};
use pollster::FutureExt as _;

#[path = "../tests/main/planted.rs"]
mod planted;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, dataset, side, sizes] = &arguments[..] else {
        return Err("name a scene, a data set, a size of images, and the sizes of floaters: world or picture".into());
    };
    let sizes = if sizes == "picture" { planted::Sizes::Picture } else { planted::Sizes::World };
    let file = gs_io::read_3d(scene)?;
    let settings = DatasetSettings::default()
        .with(|s| (s.max_side, s.frame) = (side.parse().ok().and_then(NonZeroU32::new), Some(file.trained_with.frame)));
    let dataset = read_dataset(Path::new(dataset), &settings)?;
    let (views, render) = (Views::of_dataset(&dataset).cached(), file.render_settings(Some(&dataset)));
    let on = CpuRasterizer::new(CpuSettings::default())?;
    let psnr = |scene: &Scene3d, render: &RenderSettings| -> Result<f64, gs_train::Error> {
        Ok(evaluate(&on, scene, views.test_or_train(), render).block_on()?.psnr)
    };
    let (real, mut scene) = (file.scene.len(), file.scene);
    println!("{real} Gaussians: {:.3} dB over the held-out views", psnr(&scene, &render)?);
    planted::plant(&on, &mut scene, &views.train, &render, (real / 20, sizes));
    println!("with {} planted: {:.3} dB", scene.len() - real, psnr(&scene, &render)?);
    let start = Instant::now();
    let found = Floaters::find(&on, &scene, &views, &render, 0.05).block_on()?;
    println!("{found} ({:.1} s)", start.elapsed().as_secs_f64());
    let gone = |of: &[bool]| 100.0 * of.iter().filter(|keep| !**keep).count() as f64 / of.len() as f64;
    let (first, last) = found.keep.split_at(real);
    println!("found {:.2} % of the planted, lost {:.2} % of the others", gone(last), gone(first));
    scene.retain(&found.keep);
    println!("without the floaters: {:.3} dB", psnr(&scene, &render)?);
    Ok(())
}
