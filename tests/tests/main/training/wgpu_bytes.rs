//! Between rounds of density control, a training step on a device moves the same few bytes however
//! many Gaussians and pixels there are, whatever the policy, and whether or not the images have
//! masks and alpha.

use super::fixture_3d;
use gs_conformance::scenes::{Draw, Kind2d};
use gs_core::{Blend, Camera, Image, Optimizer, Scene, Scene2d, Scene3d};
use gs_density::Policy;
use gs_io::dataset::PosedImage;
use gs_train::{
    FitSettings, Rounds, Trainer,
    train::{PosedView, Start, TrainSettings, Trainer3d, Views},
};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;

/// Steps whose bytes are counted.
const STEPS: u64 = 5;

/// Bytes that describe a step, and that come back of it: two structures of half a KiB, and a
/// camera.
const MOST_BYTES: u64 = STEPS * 2048;

fn wgpu() -> WgpuRasterizer {
    WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver")
}

/// Bytes of some steps in the middle of a run, without those of downloading the scene.
///
/// Up to four steps are under way when [`Trainer::step_once`] returns, and how many depends on
/// timing. Downloading the scene waits for all of them, so that the count begins and ends with none
/// under way.
fn bytes_of_steps<R, S>(trainer: &mut Trainer<'_, R, S>, moved: impl Fn() -> u64) -> u64
where
    R: Optimizer<S>,
    S: gs_train::Trainable,
{
    let steps = |trainer: &mut Trainer<'_, R, S>| {
        (0..STEPS).for_each(|_| {
            trainer.step_once().block_on().unwrap();
        });
    };
    let bytes_after_download = |trainer: &Trainer<'_, R, S>| {
        trainer.scene().block_on().unwrap();
        moved()
    };
    // Buffers grow, and images are uploaded.
    steps(trainer);
    let before = bytes_after_download(trainer);
    let start = bytes_after_download(trainer);
    steps(trainer);
    let end = bytes_after_download(trainer);
    (end - start) - (start - before)
}

/// A number of Gaussians, and the size in pixels of the image: little and much.
const SIZES: [(usize, (u32, u32)); 2] = [(30, (32, 24)), (120, (64, 48))];

fn target((width, height): (u32, u32)) -> Image {
    Image::from_fn(width, height, |x, y| [x as f32 / 64.0, y as f32 / 64.0, 0.5]).unwrap()
}

fn of_fit(wgpu: &WgpuRasterizer, policy: &Policy, (count, size): (usize, (u32, u32))) -> u64 {
    let scene: Scene2d = Draw::new(Kind2d::Typical, Blend::Over, count, size, 5).scene;
    let mut settings = FitSettings::for_image(2 * count as u32, size, 40);
    settings.render.effects.blend = Blend::Over;
    settings.policy = policy.clone();
    settings.rounds = Rounds::NEVER;
    settings.color_solve.after_edit = 0;
    settings.color_solve.at_start = 0;
    let mut trainer = Trainer::from_scene(wgpu, &target(size), &scene, settings).block_on().unwrap();
    bytes_of_steps(&mut trainer, || wgpu.bytes_moved())
}

/// `settings` for a number of Gaussians and a single view, so that all pictures are there when
/// bytes are counted.
fn of_training(
    wgpu: &WgpuRasterizer,
    settings: &TrainSettings,
    masked: bool,
    (count, (width, height)): (usize, (u32, u32)),
) -> u64 {
    let pixels = (width * height) as usize;
    let alpha = masked.then(|| (0..pixels).map(|i| if i % 3 == 0 { 0.5 } else { 1.0 }).collect());
    let mask = masked.then(|| (0..pixels).map(|i| i % 5 != 0).collect());
    let source = std::sync::Arc::new(PosedImage { image: target((width, height)), alpha, mask });
    let lens = Camera::looking_forward(width, height, 0.7);
    let camera = Camera { width, height, focal: lens.focal, center: lens.center, ..fixture_3d::camera(0) };
    let views = Views::new(vec![PosedView { name: "view".to_owned(), camera, source }], Vec::new());
    let thirty = fixture_3d::thirty();
    let scene = (0..count).map(|i| thirty.gaussian(i % 30)).collect::<Scene3d>();
    let mut trainer = Trainer3d::from_views(wgpu, views, Start::Scene(scene), settings.clone()).block_on().unwrap();
    bytes_of_steps(&mut trainer, || wgpu.bytes_moved())
}

/// Fits take no masks.
#[test]
fn a_step_of_a_fit_moves_few_bytes_whatever_the_policy() {
    let wgpu = wgpu();
    for name in Policy::NAMES {
        let policy = Policy::from_name(name).unwrap();
        if policy.validate_2d().is_err() {
            continue;
        }
        let [little, much] = SIZES.map(|sizes| of_fit(&wgpu, &policy, sizes));
        assert_eq!(little, much, "{name}");
        assert!((1..=MOST_BYTES).contains(&little), "{name}: {little} bytes");
    }
}

/// Policies that seed where the residual is large are for images only.
#[test]
fn a_training_step_moves_few_bytes_with_any_policy_or_mask() {
    let wgpu = wgpu();
    let mut tested = 0;
    for name in Policy::NAMES {
        let mut settings = fixture_3d::short(40).with_policy(Policy::from_name(name).unwrap());
        settings.rounds = Rounds::NEVER;
        if settings.validate().is_err() {
            continue;
        }
        for masked in [false, true] {
            let [little, much] = SIZES.map(|sizes| of_training(&wgpu, &settings, masked, sizes));
            assert_eq!(little, much, "{name}, masked: {masked}");
            assert!((1..=MOST_BYTES).contains(&little), "{name}, masked: {masked}: {little} bytes");
        }
        tested += 1;
    }
    assert_eq!(tested, Policy::NAMES.len() - 2);
}
