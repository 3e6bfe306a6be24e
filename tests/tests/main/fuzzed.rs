//! Scenes from random bytes on every backend: a short run of the fuzz targets, with negative
//! controls.

use gs_conformance::fuzzed::{check_backend, image_is_sound, scene_2d, scene_3d};
use gs_core::{Image, Scene};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Number of scenes of each kind.
const SCENES: usize = 3000;

/// Random inputs of up to 400 bytes, the same in each run.
fn inputs(count: usize, seed: u64) -> impl Iterator<Item = Vec<u8>> {
    let mut rng = Pcg64::seed_from_u64(seed);
    (0..count).map(move |_| (0..rng.random_range(20..400)).map(|_| rng.random()).collect())
}

fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(1);
        s.level = None;
    }))
    .expect("a thread can be started")
}

#[test]
fn the_cpu_backend_is_sound_for_2d_scenes() {
    let cpu = cpu();
    for input in inputs(SCENES, 1) {
        let drawn = scene_2d(&input);
        check_backend(&cpu, &drawn).unwrap_or_else(|failure| panic!("{failure}: {drawn:?}"));
    }
}

#[test]
fn the_cpu_backend_is_sound_for_3d_scenes() {
    let cpu = cpu();
    for input in inputs(SCENES, 2) {
        let drawn = scene_3d(&input);
        check_backend(&cpu, &drawn).unwrap_or_else(|failure| panic!("{failure}: {drawn:?}"));
    }
}

#[test]
fn wgpu_is_sound_for_both_kinds_of_scenes() {
    let wgpu = WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
    for input in inputs(40, 3) {
        let (flat, deep) = (scene_2d(&input), scene_3d(&input));
        check_backend(&wgpu, &flat).unwrap_or_else(|failure| panic!("{failure}: {flat:?}"));
        check_backend(&wgpu, &deep).unwrap_or_else(|failure| panic!("{failure}: {deep:?}"));
    }
}

#[test]
fn drawn_scenes_are_varied() {
    let cpu = cpu();
    let (mut scenes, mut views, mut seen) = (0, 0, 0);
    for drawn in inputs(1000, 4).map(|input| scene_3d(&input)) {
        let possible = drawn.view.validate().is_ok() && drawn.settings.validate().is_ok();
        scenes += usize::from(drawn.scene.validate().is_ok());
        views += usize::from(possible);
        if possible && drawn.scene.validate().is_ok() {
            let image =
                gs_core::Rasterizer::render(&cpu, &drawn.scene, &drawn.view, &drawn.settings).block_on().unwrap();
            let background = drawn.settings.background_color();
            seen += usize::from(image.pixels().iter().any(|pixel| *pixel != background));
        }
    }
    // Both kinds are frequent enough.
    assert!((200..900).contains(&scenes) && (400..990).contains(&views) && seen > 100, "{scenes} {views} {seen}");
}

#[test]
fn impossible_colours_are_rejected() {
    let drawn = inputs(1000, 5)
        .map(|input| scene_2d(&input))
        .find(|drawn| drawn.scene.validate().is_ok() && drawn.scene.colors.iter().all(|c| c.abs().max_element() < 10.0))
        .unwrap();
    let size = (drawn.view.width, drawn.view.height);
    let sound = |image: &Image| image_is_sound(&drawn.scene, size, &drawn.settings, image);
    let mut image = Image::filled(size.0, size.1, [0.0; 3]).unwrap();
    sound(&image).unwrap();
    for wrong in [f32::NAN, f32::INFINITY, 1e4, -1e4] {
        image.pixels_mut()[0][1] = wrong;
        assert!(sound(&image).is_err(), "{wrong}");
    }
    assert!(sound(&Image::filled(size.0 + 1, size.1, [0.0; 3]).unwrap()).is_err());
}
