//! Whole trainings in 3D: a scene comes back from its pictures, and runs repeat and resume bit for
//! bit.

use std::sync::{Arc, atomic::Ordering::Relaxed};

use crate::evidence::counted;
use crate::fixture_3d::{LENS, changed, rasterizer, render, short, thirty, views};
use gs_core::{
    Adam, Image, Participants, Scene, Scene3d, TensorData,
    adam::{Group, Schedule},
};
use gs_density::Policy;
use gs_io::dataset::{Point, PosedImage};
use gs_train::{
    Control, Error, MetricsLog, Observer, Outcome, Progress, TrainPreset, TrainSettings, Trainer3d,
    limits::Speed,
    train::{DRIFT_DB, Evaluation, Exposure, ImageSource, PosedView, Resolution, Start, TrainSummary, Views, evaluate},
};
use pollster::FutureExt as _;

pub(crate) fn trained(settings: TrainSettings, views: Views, start: Start) -> (Scene3d, Evaluation) {
    let rasterizer = rasterizer();
    let mut trainer = Trainer3d::from_views(&rasterizer, views, start, settings).block_on().unwrap();
    assert_eq!(trainer.run(&mut ()).block_on().unwrap(), Outcome::Finished);
    (trainer.scene().block_on().unwrap(), trainer.evaluate(&|_, _, _| Ok(())).block_on().unwrap())
}

/// The parameters' bits, so that −0 is not 0 and NaN is itself.
fn bits(scene: &Scene3d) -> Vec<u32> {
    let vectors = scene.means.iter().chain(&scene.log_scales).chain(&scene.sh).flat_map(|v| v.to_array());
    let rest = scene.rotations.iter().flatten().chain(&scene.opacity_logits).copied();
    vectors.chain(rest).map(f32::to_bits).collect()
}

#[test]
fn a_scene_comes_back_from_its_pictures() {
    let mut settings = short(900);
    settings.render.effects.sh_degree = 0;
    // A run this short takes larger steps.
    let faster = |group: Group| group.with(|s| s.learning_rate = 4.0 * group.learning_rate);
    let Adam { mean, scale, rotation, color, .. } = settings.adam;
    settings.adam = settings.adam.with(|s| {
        s.mean = faster(mean);
        s.scale = faster(scale);
        s.rotation = faster(rotation);
        s.color = faster(color);
    });
    let (scene, evaluation) = trained(settings, views(&rasterizer()), Start::Random);
    scene.validate().unwrap();
    assert_eq!(evaluation.views.len(), 3);
    assert!(evaluation.psnr > 30.0, "{:.2} dB with {} Gaussians", evaluation.psnr, scene.len());
    assert!(evaluation.ssim > 0.9, "{}", evaluation.ssim);
}

/// A face of a wider image.
struct FaceOf(PosedImage);

impl ImageSource for FaceOf {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        Ok(self.0.clone())
    }

    fn is_face(&self) -> bool {
        true
    }
}

#[test]
fn points_get_a_shell_on_request_and_among_faces_of_wide_images() {
    let rasterizer = rasterizer();
    let points: Vec<Point> = thirty().means.iter().map(|mean| Point { position: *mean, color: [0.5; 3] }).collect();
    let count = |far_points: Option<bool>, faces: bool, start: Start| {
        let mut settings = short(0);
        settings.init.far_points = far_points;
        let mut views = views(&rasterizer);
        if faces {
            let face = |view: PosedView| PosedView { source: Arc::new(FaceOf(view.image().unwrap())), ..view };
            views.train = views.train.into_iter().map(face).collect();
        }
        Trainer3d::from_views(&rasterizer, views, start, settings).block_on().unwrap().count()
    };
    let points = || Start::Points(points.clone());
    let with_shell = count(Some(true), false, points());
    assert!(with_shell > 60);
    assert_eq!(count(None, true, points()), with_shell);
    assert_eq!([count(None, false, points()), count(Some(false), true, points())], [30; 2]);
    assert_eq!(count(Some(true), false, Start::Scene(thirty())), 30);
}

#[test]
fn the_true_scene_is_perfect_and_stays_so() {
    let rasterizer = rasterizer();
    let judged = evaluate(&rasterizer, &thirty(), &views(&rasterizer).test, &render()).block_on().unwrap();
    // The images are floats; rounding to 8 bits alone is 58.9 dB away from them.
    assert!(judged.psnr > 58.5, "{judged:?}");
    let mut settings = short(30);
    settings.policy = Policy::None;
    let (_, kept) = trained(settings, views(&rasterizer), Start::Scene(thirty()));
    assert!(kept.psnr > 35.0, "{} dB", kept.psnr);
}

#[test]
fn equal_seeds_give_equal_scenes_and_watching_changes_nothing() {
    let rasterizer = rasterizer();
    let run = |seed: u32, observer: &mut dyn Observer| {
        let settings = short(60).with(|s| s.seed = seed);
        let mut trainer =
            Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Random, settings).block_on().unwrap();
        trainer.run(observer).block_on().unwrap();
        assert!(trainer.edits().added() > 0, "nothing grew");
        bits(&trainer.scene().block_on().unwrap())
    };
    let mut log = MetricsLog::new(7);
    let scene = run(1, &mut ());
    assert!(scene == run(1, &mut log), "watching changes the training");
    assert!(scene != run(2, &mut ()), "the seed makes no difference");
    let last = log.rows().last().unwrap();
    assert!(last.psnr.is_some() && last.culled.is_some() && last.step == 60, "{last:?}");
    assert!(log.rows().iter().any(|row| row.edits.added() > 0));
}

/// Stops at the given steps.
struct StopAt(Vec<u32>);

impl Observer for StopAt {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if self.0.contains(&progress.step) { Control::Stop } else { Control::Continue }
    }
}

#[test]
fn a_resumed_training_ends_bit_identical() {
    let bits_of = |trainer: &mut Trainer3d<'_, gs_cpu::CpuRasterizer>| -> Vec<(String, Vec<u32>)> {
        let state = trainer.checkpoint().block_on().unwrap().state;
        let bits = |data: &TensorData| match data {
            TensorData::F32(values) => values.iter().map(|v| v.to_bits()).collect(),
            TensorData::U32(values) => values.clone(),
        };
        state.tensors.iter().map(|(name, tensor)| (name.clone(), bits(&tensor.data))).collect()
    };
    for (name, exposure) in [("absolute", Exposure::Affine), ("mcmc", Exposure::Off)] {
        let mut settings = short(60).with_policy(Policy::from_name(name).unwrap());
        settings.exposure = exposure;
        settings.dropout = 0.2;
        settings.average_last = 0.5;
        settings.resolution = Resolution::CoarseToFine { from: 2, full_after: 0.5 };
        let first = rasterizer();
        let mut whole =
            Trainer3d::from_views(&first, views(&first), Start::Random, settings.clone()).block_on().unwrap();
        whole.run(&mut ()).block_on().unwrap();

        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("checkpoint.safetensors");
        let mut stops = StopAt(vec![1, 17, 30, 44]);
        let mut trainer = Trainer3d::from_views(&first, views(&first), Start::Random, settings).block_on().unwrap();
        let mut outcome = trainer.run(&mut stops).block_on().unwrap();
        let mut checkpoint = trainer.checkpoint().block_on().unwrap();
        let mut pieces = 1;
        let last = loop {
            gs_io::write_checkpoint(&file, &checkpoint).unwrap();
            let other = rasterizer();
            let read = gs_io::read_checkpoint(&file).unwrap();
            let mut resumed = Trainer3d::resume_views(&other, views(&other), read).unwrap();
            if outcome == Outcome::Finished {
                break bits_of(&mut resumed);
            }
            outcome = resumed.run(&mut stops).block_on().unwrap();
            checkpoint = resumed.checkpoint().block_on().unwrap();
            pieces += 1;
        };
        assert_eq!(pieces, 5);
        assert!(last == bits_of(&mut whole), "{name}");
    }
}

#[test]
fn a_run_may_end_earlier_or_later_than_planned() {
    let rasterizer = rasterizer();
    let mut settings = short(60);
    settings.average_last = 0.5;
    for (end, expected) in [(40, 40), (90, 90), (3, 46)] {
        let mut trainer =
            Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Random, settings.clone()).block_on().unwrap();
        trainer.run(&mut StopAt(vec![if end == 40 { 35 } else { 45 }])).block_on().unwrap();
        trainer.end_after(end);
        // The mean of the last scenes, and the rest of the run, are those of a run of this length.
        let checkpoint = trainer.checkpoint().block_on().unwrap();
        trainer.run(&mut ()).block_on().unwrap();
        assert_eq!((trainer.step(), trainer.settings().iterations), (expected, expected));
        let mut resumed = Trainer3d::resume_views(&rasterizer, views(&rasterizer), checkpoint).unwrap();
        resumed.run(&mut ()).block_on().unwrap();
        assert_eq!(resumed.scene().block_on().unwrap(), trainer.scene().block_on().unwrap(), "{end}");
    }
}

/// Steps of a constant length leave a scene that jumps; the mean of such scenes is nearer to the
/// pictures.
#[test]
fn the_mean_of_the_last_scenes_is_better_than_the_last() {
    let rasterizer = rasterizer();
    let quality = |average_last: f32| {
        let mut settings = short(120);
        settings.policy = Policy::None;
        settings.adam = settings.adam.with(|adam| {
            adam.mean.schedule = Schedule::Constant;
            adam.mean.learning_rate *= 8.0;
            adam.color.learning_rate *= 8.0;
        });
        settings.average_last = average_last;
        trained(settings, views(&rasterizer), Start::Scene(thirty())).1.psnr
    };
    let [last, mean] = [0.0, 0.5].map(quality);
    assert!(mean > last + 1.0, "{last} dB, as a mean {mean} dB");
}

#[test]
fn many_points_raise_the_number_of_gaussians() {
    let rasterizer = rasterizer();
    let points: Vec<Point> = thirty().means.iter().map(|mean| Point { position: *mean, color: [0.5; 3] }).collect();
    let allowed = |start: Start, most_points: Option<u32>| {
        let mut settings = short(0).with_gaussians(70);
        settings.gaussians_per_point = 4.0;
        settings.init.most_points = most_points;
        let trainer = Trainer3d::from_views(&rasterizer, views(&rasterizer), start, settings).block_on().unwrap();
        assert_eq!(trainer.settings().gaussians_per_point, 0.0);
        trainer.settings().gaussians
    };
    assert_eq!(allowed(Start::Points(points.clone()), None), 120);
    assert_eq!(allowed(Start::Points(points), Some(20)), 80);
    assert_eq!([allowed(Start::Random, None), allowed(Start::Scene(thirty()), None)], [70, 70]);
}

#[test]
fn a_checkpoint_of_other_views_or_of_an_image_is_refused() {
    let rasterizer = rasterizer();
    let start = || Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Random, short(20)).block_on().unwrap();
    let checkpoint = start().checkpoint().block_on().unwrap();
    let mut fewer = views(&rasterizer);
    fewer.train.pop();
    let refused = Trainer3d::resume_views(&rasterizer, fewer, checkpoint.clone()).unwrap_err();
    assert!(matches!(refused, Error::WrongTarget { .. }), "{refused}");
    let all = |_, posed: PosedImage| {
        let mask = Some(vec![true; posed.image.pixels().len()]);
        PosedImage { mask, ..posed }
    };
    let masked = changed(views(&rasterizer), all);
    let refused = Trainer3d::resume_views(&rasterizer, masked, checkpoint.clone()).unwrap_err();
    assert!(matches!(refused, Error::WrongTarget { .. }), "{refused}");
    let replaced = |i, mut posed: PosedImage| {
        if i == 3 {
            posed.image.pixels_mut()[5][1] += 1.0 / 255.0;
        }
        posed
    };
    let refused = Trainer3d::resume_views(&rasterizer, changed(views(&rasterizer), replaced), checkpoint.clone());
    let Err(Error::OtherImages { count: 1, first }) = refused else { panic!("{refused:?}") };
    assert_eq!(first, "view-03");
    // Without checksums, images could not be compared.
    let mut without = checkpoint.clone();
    without.metadata.remove("image-digests").unwrap();
    let refused = Trainer3d::resume_views(&rasterizer, views(&rasterizer), without).unwrap_err();
    assert!(matches!(&refused, Error::Checkpoint(text) if text.contains("image-digests")), "{refused}");
    let mut flat = checkpoint;
    flat.metadata.insert("format".to_owned(), "fit-2d-1".to_owned());
    let refused = Trainer3d::resume_views(&rasterizer, views(&rasterizer), flat).unwrap_err();
    assert!(matches!(refused, Error::Checkpoint(_)), "{refused}");
}

#[test]
fn every_policy_trains_within_its_budget() {
    let rasterizer = rasterizer();
    let of = |settings: TrainSettings| trained(settings, views(&rasterizer), Start::Random);
    let before = of(short(60).with(|s| s.iterations = 0)).1.psnr;
    for name in Policy::NAMES {
        let settings = short(60).with_policy(Policy::from_name(name).unwrap());
        if ["residual", "image-gs"].contains(&name) {
            let refused = Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Random, settings);
            assert!(refused.block_on().unwrap_err().to_string().contains(name));
            continue;
        }
        let (scene, evaluation) = of(settings);
        scene.validate().unwrap();
        assert!((1..=600).contains(&scene.len()), "{name}: {}", scene.len());
        assert!(evaluation.psnr > before + 1.0, "{name}: {before} dB became {} dB", evaluation.psnr);
    }
}

#[test]
fn a_governed_training_ends_with_exactly_its_budget() {
    let rasterizer = rasterizer();
    for (name, budget) in [("absolute", 500), ("mcmc", 333), ("none", 150), ("percentile", 60), ("taming", 400)] {
        let settings = short(60).with_policy(Policy::from_name(name).unwrap()).with(|s| {
            s.gaussians = budget;
            s.exactly = true;
        });
        let (scene, _) = trained(settings, views(&rasterizer), Start::Random);
        assert_eq!(scene.len(), budget as usize, "{name}");
    }
}

#[test]
fn a_trial_measures_the_speed_of_steps() {
    let rasterizer = rasterizer();
    let settings = TrainPreset::Standard.settings(None).with(|s| s.gaussians = 600);
    let speed =
        Speed::measure(&rasterizer, views(&rasterizer), Start::Random, &settings, f64::INFINITY).block_on().unwrap();
    let seconds = |iterations: u32| speed.seconds(&TrainPreset::Standard.settings(Some(iterations)), [0; 2]);
    // By how much depends on the machine: a run's rounds, which are as many, may take most of its time.
    let (short, long) = (seconds(1_000), seconds(2_000));
    assert!(0.0 < short && short < long, "{short} s, {long} s");
    assert!(speed.view_seconds(&settings) > 0.0 && speed.evaluation_seconds(&settings) > 0.0);
}

#[test]
fn sparse_steps_train_too() {
    let rasterizer = rasterizer();
    let mut settings = short(120);
    settings.adam.participants = Participants::Visible;
    let (_, sparse) = trained(settings, views(&rasterizer), Start::Random);
    assert!(sparse.psnr > 18.0, "{}", sparse.psnr);
}

#[test]
fn views_that_see_nothing_and_steps_that_are_over_are_errors() {
    let rasterizer = rasterizer();
    let behind = Start::Points(vec![Point { position: glam::Vec3::new(0.0, 0.0, 1e3), color: [0.5; 3] }]);
    let refused = Trainer3d::from_views(&rasterizer, views(&rasterizer), behind, short(20)).block_on().unwrap_err();
    assert!(matches!(refused, Error::NothingInView { .. }), "{refused}");
    // The coordinates of another data set: in front of some view, and too far away to be seen.
    let mut elsewhere = thirty();
    elsewhere.means.iter_mut().for_each(|mean| *mean += glam::Vec3::new(4.5e6, 4.5e6, 4.5e6));
    let start = Start::Scene(elsewhere);
    let refused = Trainer3d::from_views(&rasterizer, views(&rasterizer), start, short(20)).block_on().unwrap_err();
    assert!(matches!(refused, Error::NothingInView { .. }), "{refused}");
    let none = Views::new(Vec::new(), Vec::new());
    let refused = Trainer3d::from_views(&rasterizer, none, Start::Random, short(20)).block_on().unwrap_err();
    assert!(refused.to_string().contains("views to train with"), "{refused}");
    let mut trainer =
        Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Random, short(1)).block_on().unwrap();
    trainer.step_once().block_on().unwrap();
    assert!(matches!(trainer.step_once().block_on(), Err(Error::Finished { iterations: 1 })));
}

#[test]
fn images_in_memory_and_in_a_file_give_the_same_bits() {
    let (rasterizer, place) = (rasterizer(), tempfile::tempdir().unwrap());
    let with = |keep_bytes, is_file: bool| {
        let (reads, cache_folder) = (Arc::default(), is_file.then(|| place.path().to_owned()));
        let views = counted(Views { keep_bytes, cache_folder, ..views(&rasterizer) }, &reads);
        (bits(&trained(short(30), views, Start::Random).0), reads.load(Relaxed))
    };
    let in_memory = with(u64::MAX, true);
    assert_eq!(in_memory.1, 12, "each image is read once");
    // An image of these views takes 7 kB.
    assert!(with(20_000, true) == in_memory && with(0, true) == in_memory);
    let without_file = with(0, false);
    assert!(without_file.0 == in_memory.0 && without_file.1 >= 30);
}

#[test]
fn few_held_out_views_are_measured_while_all_are_evaluated() {
    let rasterizer = rasterizer();
    let mut all = views(&rasterizer);
    all.test = all.train.iter().cloned().enumerate().map(|(k, v)| PosedView { name: format!("{k}"), ..v }).collect();
    let with = |most_measured| {
        let views = Views { most_measured, ..all.clone() };
        let trainer = Trainer3d::from_views(&rasterizer, views, Start::Random, short(1)).block_on().unwrap();
        let names: Vec<String> = trainer.measured_views().iter().map(|view| view.name.clone()).collect();
        (names.join(" "), trainer.quality().block_on().unwrap().views.len(), trainer.evaluation_views().len())
    };
    assert_eq!(with(8), ("0 1 3 4 6 7 9 10".to_owned(), 8, 12));
    assert_eq!(with(5), ("0 2 4 7 9".to_owned(), 5, 12));
    assert_eq!(with(usize::MAX).1, 12);
}

#[test]
fn the_summary_holds_how_well_the_views_are_fitted_that_it_trained_with() {
    let rasterizer = rasterizer();
    let mut fainter = thirty();
    fainter.opacity_logits.iter_mut().for_each(|logit| *logit -= 0.5);
    let summary = |views: Views, iterations| {
        let start = Start::Scene(fainter.clone());
        let mut trainer = Trainer3d::from_views(&rasterizer, views, start, short(iterations)).block_on().unwrap();
        trainer.run(&mut ()).block_on().unwrap();
        let evaluation = trainer.evaluate(&|_, _, _| Ok(())).block_on().unwrap();
        TrainSummary::new(&trainer, evaluation).block_on().unwrap()
    };
    let usual = summary(views(&rasterizer), 0);
    let training = usual.training.unwrap();
    let (sampled, expected) = (views(&rasterizer), [0, 4, 8]);
    let sample: Vec<PosedView> =
        sampled.train.into_iter().enumerate().filter_map(|(i, view)| expected.contains(&i).then_some(view)).collect();
    let mut shown = render();
    shown.effects.sh_degree = 0;
    let judged = evaluate(&rasterizer, &fainter, &sample, &shown).block_on().unwrap();
    assert_eq!(training.views, 3, "as many as are held out");
    assert!((training.psnr.unwrap() - judged.psnr).abs() < 1e-3, "{training:?} {judged:?}");
    assert!(usual.loss == Some(training.loss) && training.loss > 0.0 && usual.drift().is_none(), "{training:?}");

    // Held-out images that show something else are not fitted, however long it trains.
    let mut others = views(&rasterizer);
    for view in &mut others.test {
        let posed = view.image().unwrap();
        let image = Image::filled(LENS.0, LENS.1, [0.9, 0.1, 0.5]).unwrap();
        view.source = Arc::new(PosedImage { image, ..posed });
    }
    let drifted = summary(others, 20);
    let apart = drifted.training.unwrap().psnr.unwrap() - drifted.evaluation.psnr;
    assert!(apart > DRIFT_DB && drifted.drift() == Some(apart), "{apart}");

    let trainer = Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Scene(thirty()), short(20));
    let mut trainer = trainer.block_on().unwrap().controlled_by(Arc::new(Policy::None));
    trainer.run(&mut ()).block_on().unwrap();
    let custom = trainer.shortfall().expect("it adds none");
    assert_eq!(custom.reason, "the custom policy added no Gaussians in 1 round");

    // A default bound need not be reached.
    let shortfall = drifted.shortfall.as_ref().expect("one round is too few");
    assert_eq!((shortfall.gaussians, shortfall.budget), (drifted.gaussians, 600));
    let settings = short(4).with(|s| s.gaussians = TrainSettings::default().gaussians);
    let trainer =
        Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Scene(thirty()), settings).block_on().unwrap();
    let evaluation = trainer.evaluate(&|_, _, _| Ok(())).block_on().unwrap();
    assert_eq!(TrainSummary::new(&trainer, evaluation).block_on().unwrap().shortfall, None);
}

#[test]
fn a_3d_training_that_diverges_names_step_and_gaussian() {
    let rasterizer = rasterizer();
    let mut settings = short(40);
    (settings.adam.color.learning_rate, settings.rounds) = (1e38, gs_train::Rounds::NEVER);
    let mut trainer =
        Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Scene(thirty()), settings).block_on().unwrap();
    let Err(Error::Diverged { step, loss, suspect }) = trainer.run(&mut ()).block_on() else {
        panic!("it did not diverge")
    };
    assert!(!loss.is_finite() && (1..=40).contains(&step));
    let suspect = suspect.expect("there are Gaussians");
    assert!(suspect.index < 30 && suspect.to_string().contains("SH"), "{suspect}");
    // No checkpoint is made of the result.
    assert!(matches!(trainer.checkpoint().block_on(), Err(Error::Diverged { .. })));
}
