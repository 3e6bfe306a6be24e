//! Between rounds of density control, a training step on a device moves the same few bytes however
//! many Gaussians and pixels there are, whatever the policy, and whether or not the images have
//! masks and alpha.

use gs_conformance::scenes::{Draw, Kind};
use gs_core::{Blend, Camera, Image, Optimizer, Scene2d, Scene3d};
use gs_density::Policy;
use gs_io::dataset::PosedImage;
use gs_train::{
    FitSettings, Rounds, Trainer,
    train::{PosedView, Start, StepBackground, Trainer3d, Views},
};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;

/// Steps whose bytes are counted.
const STEPS: u64 = 8;

/// What describes a step, and what comes back of it: two structures of half a KiB, and a camera.
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

fn of_fit(wgpu: &WgpuRasterizer, policy: Policy, count: usize, size: (u32, u32)) -> u64 {
    let scene: Scene2d = Draw::new(Kind::Typical, Blend::Over, count, size, 5).scene;
    let target = Image::from_fn(size.0, size.1, |x, y| [x as f32 / 64.0, y as f32 / 64.0, 0.5]).unwrap();
    let mut settings = FitSettings::for_image(2 * count as u32, size, 40);
    settings.render.effects.blend = Blend::Over;
    settings.policy = policy;
    settings.rounds = Rounds::NEVER;
    settings.color_solve.after_edit = 0;
    settings.color_solve.at_start = 0;
    let mut trainer = Trainer::from_scene(wgpu, &target, &scene, settings).block_on().unwrap();
    bytes_of_steps(&mut trainer, || wgpu.bytes_moved())
}

fn of_training(wgpu: &WgpuRasterizer, policy: &Policy, masked: bool, (copies, scale): (usize, u32)) -> u64 {
    let rasterizer = crate::fixture_3d::rasterizer();
    let views = crate::fixture_3d::changed(crate::fixture_3d::views(&rasterizer), |_, posed| posed);
    let larger = |view: PosedView| {
        let posed = view.image().unwrap();
        let (width, height) = (scale * posed.image.width(), scale * posed.image.height());
        let image = Image::from_fn(width, height, |x, y| posed.image.pixel(x / scale, y / scale)).unwrap();
        let pixels = (width * height) as usize;
        let alpha = masked.then(|| (0..pixels).map(|i| if i % 3 == 0 { 0.5 } else { 1.0 }).collect());
        let mask = masked.then(|| (0..pixels).map(|i| i % 5 != 0).collect());
        let by = scale as f32;
        let camera =
            Camera { width, height, focal: view.camera.focal * by, center: view.camera.center * by, ..view.camera };
        PosedView { camera, source: Box::new(PosedImage { image, alpha, mask }), ..view }
    };
    // A single view, so that all pictures are there when bytes are counted.
    let views = Views { train: views.train.into_iter().take(1).map(larger).collect(), ..views };
    let mut scene = Scene3d::default();
    for _ in 0..copies {
        let thirty = crate::fixture_3d::thirty();
        (0..30).for_each(|i| gs_core::Scene::push(&mut scene, gs_core::Scene::gaussian(&thirty, i)));
    }
    let mut settings = crate::fixture_3d::short(40);
    settings.policy = policy.clone();
    settings.rounds = Rounds::NEVER;
    if masked {
        settings.background = StepBackground::Random;
    }
    let mut trainer = Trainer3d::from_views(wgpu, views, Start::Scene(scene), settings).block_on().unwrap();
    bytes_of_steps(&mut trainer, || wgpu.bytes_moved())
}

#[test]
fn a_step_of_a_fit_moves_few_bytes_whatever_the_policy() {
    let wgpu = wgpu();
    for name in Policy::NAMES {
        let policy = Policy::from_name(name).unwrap();
        let (small, large) = (of_fit(&wgpu, policy.clone(), 40, (32, 24)), of_fit(&wgpu, policy, 160, (64, 48)));
        assert_eq!(small, large, "{name}");
        assert!((1..=MOST_BYTES).contains(&small), "{name}: {small} bytes");
    }
}

#[test]
fn a_step_of_training_moves_few_bytes_with_and_without_masks() {
    let wgpu = wgpu();
    for policy in [Policy::from_name("mcmc").unwrap(), Policy::from_name("absolute").unwrap(), Policy::None] {
        for masked in [false, true] {
            let [small, large] = [(1, 1), (4, 2)].map(|sizes| of_training(&wgpu, &policy, masked, sizes));
            assert_eq!(small, large, "{policy:?}, masked: {masked}");
            assert!((1..=MOST_BYTES).contains(&small), "{policy:?}, masked: {masked}: {small} bytes");
        }
    }
}
