//! Trouble in training is counted by cause in progress, metrics and summary.

use crate::fixture_2d::{rasterizer, small_fit, small_target};
use gs_core::{Blend, Parameterization, Scene};
use gs_density::Policy;
use gs_train::{Clamped, Control, MetricsLog, Observer, Progress, Recovery, Rounds, fit};
use pollster::FutureExt as _;

/// The reports that an observer gets about Gaussians that are not finite.
#[derive(Default)]
struct Reports {
    left_out: u32,
    removed: u32,
}

impl Observer for Reports {
    fn on_step(&mut self, progress: &Progress) -> Control {
        self.left_out = self.left_out.max(progress.quality.as_ref().map_or(0, |quality| quality.culled.not_finite));
        self.removed += progress.edits.map_or(0, |counts| counts.pruned_not_finite);
        Control::Continue
    }
}

#[test]
fn gaussians_that_stop_being_finite_are_counted_everywhere_and_removed() {
    for blend in [Blend::Sum, Blend::Over] {
        for rounds in [Rounds::NEVER, Rounds::until(10, 30)] {
            // Each step is as long as numbers go: after two, means are infinite, and nothing is
            // drawn; the loss is that of an empty image.
            let recovery = Recovery::Never;
            let mut settings = small_fit(blend).with(|s| {
                s.rounds = rounds;
                s.recovery = recovery;
                s.parameterization = Parameterization::ScaleRotation;
            });
            settings.adam.mean.learning_rate = 2e38;
            let (mut log, mut reports) = (MetricsLog::new(1), Reports::default());
            let result =
                fit(&rasterizer(), &small_target(), settings, &mut (&mut log, &mut reports)).block_on().unwrap();
            assert!(
                reports.left_out > 0 && reports.removed > 0,
                "{blend:?}, {rounds:?}: {}, {}",
                reports.left_out,
                reports.removed
            );
            assert_eq!(result.summary.edits.pruned_not_finite, reports.removed, "{blend:?}, {rounds:?}");
            let of_rows = |of: fn(&gs_train::MetricsRow) -> u32| log.rows().iter().map(of).collect::<Vec<u32>>();
            assert_eq!(of_rows(|row| row.edits.pruned_not_finite).iter().sum::<u32>(), reports.removed);
            assert_eq!(of_rows(|row| row.culled.map_or(0, |c| c.not_finite)).into_iter().max(), Some(reports.left_out));
            result.scene.validate().unwrap();
            assert_eq!(result.summary.culled.not_finite, 0, "none is left in the end");
        }
    }
}

#[test]
fn scales_that_bounds_hold_are_counted() {
    let clamped = |bounds: (f32, f32)| {
        let mut settings = small_fit(Blend::Sum).with(|s| {
            s.policy = Policy::None;
            s.rounds = Rounds::NEVER;
        });
        (settings.adam.min_scale, settings.adam.max_scale) = bounds;
        let mut log = MetricsLog::new(10);
        let result = fit(&rasterizer(), &small_target(), settings, &mut log).block_on().unwrap();
        assert_eq!(log.rows().last().unwrap().clamped, Some(result.summary.clamped));
        result.summary.clamped
    };
    assert_eq!(clamped((1e-3, 1e4)), Clamped::default());
    let held = clamped((2.0, 2.5));
    assert!(held.smallest > 0 && held.largest > 0 && held.smallest + held.largest <= 40, "{held:?}");
}
