//! A diverging run restarts, reports it in progress, metrics, summary and checkpoint, and ends no
//! worse than it began.

use crate::fixture_2d::{rasterizer, small_fit, small_target};
use gs_core::{Blend, Parameterization, edit::EditCounts};
use gs_density::Policy;
use gs_train::{
    Control, FitSettings, FreshStart, MetricsLog, Observer, Outcome, Progress, Recovery, Rounds, Trainer, Trainer3d,
    fit, train::Start,
};
use pollster::FutureExt as _;

/// Two windows, whose first begins with steps longer than the picture.
fn hasty(recovery: Recovery) -> FitSettings {
    let mut settings = small_fit(Blend::Over).with(|s| {
        s.iterations = 100;
        s.recovery = recovery;
        s.rounds = Rounds::NEVER;
        s.policy = Policy::None;
        s.parameterization = Parameterization::ScaleRotation;
    });
    settings.adam.mean.learning_rate = 200.0;
    settings
}

#[derive(Default)]
struct Reports(Vec<FreshStart>);

impl Observer for Reports {
    fn on_step(&mut self, progress: &Progress) -> Control {
        assert!(progress.fresh_start.is_none_or(|start| start.step == progress.step));
        self.0.extend(progress.fresh_start);
        Control::Continue
    }
}

#[test]
fn a_failed_fit_begins_again_and_says_so() {
    let (mut log, mut reports) = (MetricsLog::new(1), Reports::default());
    let fitted = fit(&rasterizer(), &small_target(), hasty(Recovery::BeginAgain), &mut (&mut log, &mut reports))
        .block_on()
        .unwrap();
    assert_eq!(reports.0.iter().map(|start| start.step).collect::<Vec<_>>(), [50]);
    assert_eq!(fitted.summary.fresh_starts, reports.0);
    assert_eq!(log.rows().iter().filter_map(|row| row.fresh_start).collect::<Vec<_>>(), reports.0);
    assert!(reports.0.iter().all(|start| start.loss > start.first && start.first > 0.0));
    let never = fit(&rasterizer(), &small_target(), hasty(Recovery::Never), &mut ()).block_on().unwrap();
    assert!(never.summary.fresh_starts.is_empty());
    assert!(never.summary.l1 > 1.2 * fitted.summary.l1, "{} and {}", never.summary.l1, fitted.summary.l1);
}

#[test]
fn a_fit_that_has_failed_at_its_end_ends_with_its_first_gaussians() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let settings = hasty(Recovery::BeginAgain).with(|s| s.iterations = 50);
    let mut trainer = Trainer::new(&rasterizer, &target, settings).block_on().unwrap();
    let start = trainer.scene().block_on().unwrap();
    trainer.run(&mut ()).block_on().unwrap();
    assert_eq!(trainer.fresh_starts().len(), 1);
    assert_eq!(trainer.scene().block_on().unwrap(), start);
}

#[test]
fn the_summary_after_a_restart_describes_the_restored_scene() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let mut settings = hasty(Recovery::BeginAgain).with(|s| s.iterations = 50);
    (settings.adam.color.learning_rate, settings.adam.mean.learning_rate) = (1e6, 0.2);
    (settings.rounds, settings.policy) = (Rounds::until(10, 40), Policy::from_name("percentile").unwrap());
    let mut trainer = Trainer::new(&rasterizer, &target, settings.clone()).block_on().unwrap();
    let (start, first) = (trainer.scene().block_on().unwrap(), trainer.summary().block_on().unwrap());
    trainer.run(&mut ()).block_on().unwrap();
    let last = trainer.summary().block_on().unwrap();
    assert_eq!((trainer.scene().block_on().unwrap(), last.fresh_starts.len()), (start, 1));
    assert!(trainer.loss() > last.loss, "that of the Gaussians that were thrown away");
    assert_eq!((last.loss, last.edits, last.gaussians), (first.loss, EditCounts::default(), 20));
    assert_eq!(
        (last.psnr, last.ssim, last.clamped, last.culled),
        (first.psnr, first.ssim, first.clamped, first.culled)
    );
    let shortfall = last.shortfall.expect("20 of 60");
    assert!(shortfall.reason.starts_with("it restarted with its first 20 Gaussians after step 50"), "{shortfall}");
}

#[test]
fn a_scene_that_shows_no_error_has_not_failed() {
    let (rasterizer, grey) = (rasterizer(), gs_core::Image::filled(40, 30, [0.25, 0.5, 0.75]).unwrap());
    let settings = FitSettings::for_image(60, grey.size(), 100).before_flat_color(&grey);
    let summary = fit(&rasterizer, &grey, settings, &mut ()).block_on().unwrap().summary;
    assert_eq!((summary.fresh_starts.len(), summary.gaussians), (0, 60), "{summary:?}");
}

#[test]
fn a_fit_that_goes_well_is_bit_for_bit_that_which_nobody_watches() {
    for blend in [Blend::Sum, Blend::Over] {
        let watched = small_fit(blend).with(|s| s.iterations = 120);
        let alone = watched.clone().with(|s| s.recovery = Recovery::Never);
        let [watched, alone] =
            [watched, alone].map(|it| fit(&rasterizer(), &small_target(), it, &mut ()).block_on().unwrap());
        assert_eq!(watched.scene, alone.scene);
        assert!(watched.summary.fresh_starts.is_empty());
    }
}

/// Stops after a step.
struct StopAt(u32);

impl Observer for StopAt {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if progress.step >= self.0 { Control::Stop } else { Control::Continue }
    }
}

#[test]
fn a_training_whose_opacities_are_reset_is_not_taken_for_one_that_failed() {
    let rasterizer = crate::fixture_3d::rasterizer();
    let mut settings = crate::fixture_3d::short(1200).with(|s| s.iterations = 1200);
    settings.rounds = Rounds::until(100, 900);
    settings.policy.actions_mut().expect("that of 3DGS has actions").reset.every = 300;
    let alone = settings.clone().with(|s| s.recovery = Recovery::Never);
    let [watched, alone] = [settings, alone].map(|settings| {
        let views = crate::fixture_3d::views(&rasterizer);
        let mut trainer = Trainer3d::from_views(&rasterizer, views, Start::Random, settings).block_on().unwrap();
        trainer.run(&mut ()).block_on().unwrap();
        (trainer.scene().block_on().unwrap(), trainer.fresh_starts().len())
    });
    assert_eq!(watched.1, 0);
    assert!(watched.0 == alone.0);
}

#[test]
fn a_fit_that_fails_again_and_again_goes_on_without_density_control() {
    #[derive(Default)]
    struct Steps {
        rounds: Vec<u32>,
        fresh_starts: Vec<u32>,
    }
    impl Observer for Steps {
        fn on_step(&mut self, progress: &Progress) -> Control {
            self.rounds.extend(progress.edits.map(|_| progress.step));
            self.fresh_starts.extend(progress.fresh_start.map(|_| progress.step));
            Control::Continue
        }
    }
    let mut settings = hasty(Recovery::BeginAgain).with(|s| s.iterations = 250);
    settings.rounds = Rounds::until(20, 240);
    settings.adam.mean.learning_rate = 1e6;
    let mut steps = Steps::default();
    let rasterizer = rasterizer();
    let mut trainer = Trainer::new(&rasterizer, &small_target(), settings).block_on().unwrap();
    let start = trainer.scene().block_on().unwrap();
    trainer.run(&mut steps).block_on().unwrap();
    assert_eq!(steps.fresh_starts, [50, 100, 150, 200, 250], "a thousandth of these rates is too much, too");
    assert_eq!(steps.rounds, [20, 40, 60, 80, 100]);
    assert_eq!(trainer.scene().block_on().unwrap(), start);
}

#[test]
fn resuming_after_a_restart_ends_like_an_uninterrupted_fit() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let settings = hasty(Recovery::BeginAgain).with(|s| s.rebin_every = 1);
    let mut trainer = Trainer::new(&rasterizer, &target, settings).block_on().unwrap();
    assert_eq!(trainer.run(&mut StopAt(60)).block_on().unwrap(), Outcome::Stopped);
    assert_eq!(trainer.fresh_starts().len(), 1);
    let checkpoint = trainer.checkpoint().block_on().unwrap();
    trainer.run(&mut ()).block_on().unwrap();
    let mut resumed = Trainer::resume(&rasterizer, &target, checkpoint).unwrap();
    resumed.run(&mut ()).block_on().unwrap();
    assert_eq!(resumed.scene().block_on().unwrap(), trainer.scene().block_on().unwrap(), "its steps are as short");
    assert_eq!(resumed.fresh_starts(), trainer.fresh_starts());
}

#[test]
fn a_resumed_fit_goes_back_to_what_it_was_resumed_with() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let calm = hasty(Recovery::BeginAgain).with(|s| {
        s.rebin_every = 1;
        s.iterations = 50;
    });
    let mut settings = calm.clone();
    settings.adam.mean.learning_rate = 0.2;
    let mut trainer = Trainer::new(&rasterizer, &target, settings.clone()).block_on().unwrap();
    trainer.run(&mut StopAt(7)).block_on().unwrap();
    let (mut checkpoint, kept) = (trainer.checkpoint().block_on().unwrap(), trainer.scene().block_on().unwrap());
    // The learning rate is too high from here on.
    let hasty = checkpoint.metadata["settings"].replace("learning-rate = 0.2", "learning-rate = 200.0");
    assert_ne!(checkpoint.metadata["settings"], hasty);
    checkpoint.metadata.insert("settings".to_owned(), hasty);
    let mut resumed = Trainer::resume(&rasterizer, &target, checkpoint).unwrap();
    resumed.run(&mut ()).block_on().unwrap();
    assert_eq!(resumed.fresh_starts().len(), 1);
    assert_eq!(resumed.scene().block_on().unwrap(), kept);
}
