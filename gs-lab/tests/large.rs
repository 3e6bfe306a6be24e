//! The capture of the bench on large captures, whose program runs no tests itself.

#[path = "../benches/large/city/mod.rs"]
mod city;

use std::num::NonZeroU32;

use gs_core::{Image, Parameterization, Rasterizer as _, Scene as _, metrics::mean};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_io::{
    WorldFrame,
    dataset::{Dataset, DatasetSettings, Split, read_dataset},
};
use pollster::FutureExt as _;

use self::city::{Capture, City};

const SMALL: Capture =
    Capture { city: City { blocks: 1, gaussians: 4_000, seed: 5 }, views: 10, width: 96, points: 200 };

fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| s.threads = Some(1))).unwrap()
}

fn written(capture: &Capture) -> (tempfile::TempDir, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    let mut heard = Vec::new();
    capture.write(cpu().for_3d(), folder.path(), |done| heard.push(done)).unwrap();
    assert_eq!(heard, (1..=capture.views).collect::<Vec<_>>());
    let settings =
        DatasetSettings::default().with(|s| (s.test_every, s.frame) = (NonZeroU32::new(5), Some(WorldFrame::WORLD)));
    let dataset = read_dataset(folder.path(), &settings).unwrap();
    (folder, dataset)
}

/// Correlation of all values: it does not depend on exposure.
fn correlation(a: &Image, b: &Image) -> f64 {
    let values = |image: &Image| image.pixels().as_flattened().iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
    let centred = |values: Vec<f64>| {
        let middle = mean(&values);
        values.into_iter().map(|value| value - middle).collect::<Vec<_>>()
    };
    let [a, b] = [a, b].map(|image| centred(values(image)));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt()
}

#[test]
fn a_city_has_as_many_gaussians_as_asked_for_wherever_there_is_a_surface() {
    for gaussians in [1, 777, 4_000] {
        let scene = City { gaussians, ..SMALL.city }.scene();
        assert_eq!(scene.means.len(), gaussians);
        scene.validate().unwrap();
    }
    let scene = SMALL.city.scene();
    let above = scene.means.iter().filter(|mean| mean.y < -3.0).count();
    assert!((100..1_000).contains(&above), "{above} of 4,000 are on buildings");
}

#[test]
fn photographs_show_the_city_from_the_cameras_of_the_model() {
    let (_folder, dataset) = written(&SMALL);
    let count = |split| dataset.views_of(split).count();
    assert_eq!((count(Split::Train), count(Split::Test)), (8, 2));
    assert!((150..=250).contains(&dataset.points.len()), "{} points", dataset.points.len());

    let cpu = cpu();
    let on = cpu.for_3d();
    let splats = on.upload(&SMALL.city.scene(), Parameterization::ScaleRotation).unwrap();
    for view in &dataset.views {
        assert_ne!(view.source.lens_name(), "pinhole", "{}", view.name);
        let (rendered, _) = on.draw(&splats, &view.camera, &SMALL.city.render()).block_on().unwrap();
        let found = correlation(&view.read_image().unwrap().image, &rendered);
        assert!(found > 0.97, "{}: {found}", view.name);
    }
}
