//! A run that has become worse than it was at first begins again, says so wherever a run is told of, and ends no worse.

mod scenes;

use gs_core::{Blend, Chart};
use gs_density::Policy;
use gs_train::{Control, FitSettings, FreshStart, MetricsLog, Observer, Progress, Recovery, Rounds, Trainer, fit};
use scenes::{rasterizer, small_fit, small_target};

/// Two windows, whose first begins with steps longer than the picture.
fn hasty(recovery: Recovery) -> FitSettings {
    let mut settings = FitSettings {
        iterations: 100,
        recovery,
        rounds: Rounds::NEVER,
        policy: Policy::None,
        chart: Chart::ScaleRotation,
        ..small_fit(Blend::Over)
    };
    settings.adam.mean.learning_rate = 200.0;
    settings
}

#[derive(Default)]
struct Told(Vec<FreshStart>);

impl Observer for Told {
    fn on_fresh_start(&mut self, progress: &Progress, fresh_start: &FreshStart) {
        assert_eq!((progress.fresh_start, progress.step), (Some(*fresh_start), fresh_start.step));
        self.0.push(*fresh_start);
    }
}

#[test]
fn a_failed_fit_begins_again_and_says_so() {
    let (mut log, mut told) = (MetricsLog::new(1), Told::default());
    let fitted = fit(&rasterizer(), &small_target(), hasty(Recovery::BeginAgain), &mut (&mut log, &mut told)).unwrap();
    assert_eq!(told.0.iter().map(|start| start.step).collect::<Vec<_>>(), [50]);
    assert_eq!(fitted.summary.fresh_starts, told.0);
    assert_eq!(log.rows().iter().filter_map(|row| row.fresh_start).collect::<Vec<_>>(), told.0);
    assert!(told.0.iter().all(|start| start.loss > start.first && start.first > 0.0));
    let never = fit(&rasterizer(), &small_target(), hasty(Recovery::Never), &mut ()).unwrap();
    assert!(never.summary.fresh_starts.is_empty());
    assert!(never.summary.l1 > 1.2 * fitted.summary.l1, "{} and {}", never.summary.l1, fitted.summary.l1);
}

#[test]
fn a_fit_that_has_failed_at_its_end_ends_with_its_first_gaussians() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let settings = FitSettings { iterations: 50, ..hasty(Recovery::BeginAgain) };
    let mut trainer = Trainer::new(&rasterizer, &target, settings).unwrap();
    let start = trainer.scene().unwrap();
    trainer.run(&mut ()).unwrap();
    assert_eq!(trainer.fresh_starts().len(), 1);
    assert_eq!(trainer.scene().unwrap(), start);
}

#[test]
fn a_fit_that_goes_well_is_bit_for_bit_that_which_nobody_watches() {
    for blend in [Blend::Sum, Blend::Over] {
        let watched = FitSettings { iterations: 120, ..small_fit(blend) };
        let alone = FitSettings { recovery: Recovery::Never, ..watched.clone() };
        let [watched, alone] = [watched, alone].map(|it| fit(&rasterizer(), &small_target(), it, &mut ()).unwrap());
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
fn a_resumed_fit_is_judged_by_its_start_and_goes_back_to_what_it_was_resumed_with() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let settings = FitSettings { rebin_every: 1, iterations: 50, ..hasty(Recovery::BeginAgain) };
    let mut trainer = Trainer::new(&rasterizer, &target, settings).unwrap();
    trainer.run(&mut StopAt(7)).unwrap();
    let (begun, kept) = (trainer.checkpoint().unwrap(), trainer.scene().unwrap());
    trainer.run(&mut ()).unwrap();
    let mut resumed = Trainer::resume(&rasterizer, &target, begun).unwrap();
    resumed.run(&mut ()).unwrap();
    assert_eq!(
        resumed.fresh_starts(),
        trainer.fresh_starts(),
        "the losses are the same, those of the start among them"
    );
    assert_eq!(resumed.scene().unwrap(), kept);
    let again = Trainer::resume(&rasterizer, &target, resumed.checkpoint().unwrap()).unwrap();
    assert_eq!(again.fresh_starts(), trainer.fresh_starts(), "a checkpoint knows of them");
}
