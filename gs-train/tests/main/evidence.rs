//! Evidence over several views: its sums are compared with renderings of single Gaussians, policies
//! that request it read no image twice, and image fits refuse policies that need it.

use std::sync::{
    Arc,
    atomic::{AtomicU32, Ordering::Relaxed},
};

use gs_core::{EditPlan, Error as CoreError, Gaussian2d, Image, Scene, Scene2d, Scene3d};
use gs_density::{DensityPolicy, EvidenceRequest, Needs, Observation, Policy, Rng};
use gs_train::{
    Error, FitSettings, Rounds, Trainer, Trainer3d,
    train::{PosedView, Start, Views},
};
use pollster::FutureExt as _;

use crate::fixture_3d::{Curious, camera, rasterizer, short, views};

/// Views that count how often their images are read.
pub(crate) fn counted(views: Views, reads: &Arc<AtomicU32>) -> Views {
    struct Counted(PosedView, Arc<AtomicU32>);
    impl gs_train::train::ImageSource for Counted {
        fn read(&self) -> Result<gs_io::dataset::PosedImage, gs_io::Error> {
            self.1.fetch_add(1, Relaxed);
            self.0.source.read()
        }
    }
    let count = |view: PosedView| PosedView {
        name: view.name.clone(),
        camera: view.camera,
        source: Arc::new(Counted(view, Arc::clone(reads))),
    };
    Views { train: views.train.into_iter().map(count).collect(), ..views }
}

/// Sums of 1, e, and whether e is high, over the pixels with these weights.
fn sums(weights: impl Iterator<Item = f32>, errors: &[f32]) -> [f64; 3] {
    weights.zip(errors).fold([0.0; 3], |[pixels, error, high], (w, &e)| {
        let w = f64::from(w);
        [pixels + w, error + w * f64::from(e), high + if e > 0.5 { w } else { 0.0 }]
    })
}

/// In pictures of white Gaussians on black, the weights of a Gaussian are what is missing without
/// its colour. Its footprint is the pixels that change when it alone is rendered. The error is the
/// difference to the view's image, scaled to 0..=1.
#[test]
fn sums_are_those_of_renderings() {
    use gs_core::Rasterizer as _;

    let rasterizer = rasterizer();
    let on = rasterizer.for_3d();
    let request = EvidenceRequest::default().with(|s| {
        s.views = 0;
        s.high_error = 0.5;
        (s.blended, s.covered, s.geometry) = (true, true, true);
    });
    let policy = Curious::new(Some(request));
    let mut settings = short(11);
    settings.render.effects.sh_degree = 0;
    let images = views(&rasterizer).train;
    let mut trainer = Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Random, settings)
        .block_on()
        .unwrap()
        .controlled_by(policy.clone());
    trainer.run(&mut ()).block_on().unwrap();
    let (scene, evidence) = policy.seen.lock().unwrap().take().expect("there was a round");
    assert_eq!((evidence.views.len(), evidence.views[0].covered.pixels.len()), (12, scene.len()));

    let shown = trainer.shown();
    let mut high = 0;
    for (number, view) in evidence.views.iter().enumerate().step_by(5) {
        let camera = camera(number);
        let draw = |scene: &Scene3d| on.render(scene, &camera, &shown).block_on().unwrap();
        let (rendered, image) = (draw(&scene), images[number].image().unwrap().image);
        let differences: Vec<f32> = (rendered.pixels().iter().zip(image.pixels()))
            .map(|(c, y)| (0..3).map(|k| (c[k] - y[k]).abs()).sum::<f32>() / 3.0)
            .collect();
        let least = differences.iter().copied().fold(f32::INFINITY, f32::min);
        let most = differences.iter().copied().fold(0.0, f32::max);
        let errors: Vec<f32> = differences.iter().map(|e| (e - least) / (most - least)).collect();
        let white = glam::Vec3::splat(0.5 / gs_core::constants::SH_C0);
        let white = Scene3d { sh: vec![white; scene.len()], ..scene.clone() };
        let all = draw(&white);
        for index in (0..scene.len()).step_by(37) {
            let mut without = white.clone();
            without.sh[index] = -white.sh[index];
            let without = draw(&without);
            let weights = all.pixels().iter().zip(without.pixels()).map(|(with, without)| with[0] - without[0]);
            let mut alone = Scene3d { sh_degree: 0, ..Scene3d::default() };
            alone.push(white.gaussian(index));
            let footprint = draw(&alone);
            let covered = footprint.pixels().iter().map(|pixel| if pixel[0] > 0.0 { 1.0 } else { 0.0 });
            for (kind, found, expected) in
                [("blended", &view.blended, sums(weights, &errors)), ("covered", &view.covered, sums(covered, &errors))]
            {
                let found = [found.pixels[index], found.error[index], found.high_error[index]].map(f64::from);
                for (found, expected) in found.into_iter().zip(expected) {
                    let near = (found - expected).abs() <= 1e-2 + 2e-3 * expected;
                    assert!(near, "view {number}, Gaussian {index}, {kind}: {found} instead of {expected}");
                }
                high += usize::from(expected[2] > 1.0);
            }
            assert!(view.covered.pixels[index] == 0.0 || view.depth[index] > 0.0 && view.radius_px[index] > 0.0);
        }
        assert!(view.loss > 0.0);
    }
    assert!(high > 5, "only {high} sums of high error");
}

/// The gradients of balls do not determine their splitting matrices, but those of the copies do:
/// they are found for every Gaussian that a view shows, and a policy grows by them.
#[test]
fn splitting_matrices_are_gathered_without_views() {
    let rasterizer = rasterizer();
    let policy = Curious::new(Some(EvidenceRequest::default().with(|s| s.splitting = true)));
    let mut trainer = Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Random, short(11))
        .block_on()
        .unwrap()
        .controlled_by(policy.clone());
    trainer.run(&mut ()).block_on().unwrap();
    let (scene, evidence) = policy.seen.lock().unwrap().take().expect("there was a round");
    assert_eq!((evidence.views.len(), evidence.splitting.len()), (0, scene.len()));
    let found = evidence.splitting.iter().filter(|matrix| matrix.iter().any(|&v| v != 0.0)).count();
    assert!(found > scene.len() / 4, "only {found} of {}", scene.len());
    assert!(evidence.splitting.iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn a_policy_that_asks_reads_no_image_again() {
    let rasterizer = rasterizer();
    let reads_with = |request: Option<EvidenceRequest>| {
        let reads = Arc::default();
        let views = counted(views(&rasterizer), &reads);
        let mut trainer = Trainer3d::from_views(&rasterizer, views, Start::Random, short(40)).block_on().unwrap();
        reads.store(0, Relaxed);
        trainer = trainer.controlled_by(Curious::new(request));
        trainer.run(&mut ()).block_on().unwrap();
        reads.load(Relaxed)
    };
    let asked = EvidenceRequest::default().with(|s| {
        s.views = 5;
        s.blended = true;
    });
    // Every image is read once, for the steps and for the rounds after steps 10 and 20.
    assert_eq!([reads_with(None), reads_with(Some(asked))], [12; 2]);
}

#[test]
fn policies_with_evidence_train_and_repeat() {
    let rasterizer = rasterizer();
    for name in ["fastgs", "taming", "improved-gs", "steep-gs", "mrnf"] {
        let run = || {
            let mut settings = short(40).with_policy(Policy::from_name(name).unwrap());
            if let Policy::FastGs(fast) = &mut settings.policy {
                (fast.pixels, fast.threshold) = (1.0, 1e-5);
            }
            if let Policy::SteepGs(steep) = &mut settings.policy {
                (steep.eigenvalue, steep.threshold) = (0.0, 1e-5);
            }
            let start = Start::Random;
            let mut trainer =
                Trainer3d::from_views(&rasterizer, views(&rasterizer), start, settings).block_on().unwrap();
            trainer.run(&mut ()).block_on().unwrap();
            assert!(trainer.edits().added() > 0, "{name}: nothing grew");
            let scene = trainer.scene().block_on().unwrap();
            scene.means.iter().flat_map(|mean| mean.to_array()).map(f32::to_bits).collect::<Vec<_>>()
        };
        assert!(run() == run(), "{name} does not repeat");
    }
}

/// A policy for image fits that needs evidence.
struct CuriousIn2d;

impl DensityPolicy for CuriousIn2d {
    fn plan(&self, _: &Observation<'_>, _: &mut Rng) -> Result<EditPlan<Gaussian2d>, CoreError> {
        Ok(EditPlan::default())
    }

    fn needs(&self) -> Needs {
        Needs { evidence: true, ..Needs::default() }
    }
}

#[test]
fn fits_of_images_refuse_policies_that_need_views() {
    let rasterizer = rasterizer();
    let target = Image::filled(16, 12, [0.4; 3]).unwrap();
    let settings = || FitSettings::standard(20).with(|s| s.rounds = Rounds::until(5, 10));
    let named = settings().with_policy(Policy::from_name("fastgs").unwrap());
    let refused = Trainer::new(&rasterizer, &target, named).block_on().err().map(|e| e.to_string()).unwrap();
    assert!(refused.contains("fastgs") && refused.contains("several views of a 3D scene"), "{refused}");
    let own: Trainer<'_, _, Scene2d> = Trainer::new(&rasterizer, &target, settings()).block_on().unwrap();
    let error = own.controlled_by(Arc::new(CuriousIn2d)).step_once().block_on().unwrap_err();
    assert!(matches!(&error, Error::Core(CoreError::State(_))), "{error:?}");
}
