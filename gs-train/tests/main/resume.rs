//! A run that was stopped and resumed ends bit for bit as one that never was.

use crate::fixture_2d::{rasterizer, small_fit, small_target};
use gs_conformance::bits::bits;
use gs_core::{Blend, Image, Parameterization, SplatsState};
use gs_density::Policy;
use gs_io::Checkpoint;
use gs_train::{Control, Error, FitSettings, MetricsLog, Observer, Outcome, Progress, Rounds, Trainer, Tune};
use pollster::FutureExt as _;

/// Stops at given steps, or at the first possible one after.
struct StopAt(Vec<u32>);

impl Observer for StopAt {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if self.0.contains(&progress.step) { Control::Stop } else { Control::Continue }
    }
}

fn end_state(settings: FitSettings, target: &Image) -> SplatsState {
    let rasterizer = rasterizer();
    let mut trainer = Trainer::new(&rasterizer, target, settings).block_on().unwrap();
    assert_eq!(trainer.run(&mut ()).block_on().unwrap(), Outcome::Finished);
    trainer.checkpoint().block_on().unwrap().state
}

/// Stops and resumes, through a file each time and on a rasterizer of its own, until the end.
fn end_state_in_pieces(settings: FitSettings, target: &Image, stops: &[u32]) -> SplatsState {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("checkpoint.safetensors");
    let mut observer = StopAt(stops.to_vec());
    let first = rasterizer();
    let mut trainer = Trainer::new(&first, target, settings).block_on().unwrap();
    let mut outcome = trainer.run(&mut observer).block_on().unwrap();
    let mut checkpoint = trainer.checkpoint().block_on().unwrap();
    let mut pieces = 1;
    while outcome == Outcome::Stopped {
        gs_io::write_checkpoint(&file, &checkpoint).unwrap();
        let rasterizer = rasterizer();
        let mut trainer = Trainer::resume(&rasterizer, target, gs_io::read_checkpoint(&file).unwrap()).unwrap();
        outcome = trainer.run(&mut observer).block_on().unwrap();
        checkpoint = trainer.checkpoint().block_on().unwrap();
        pieces += 1;
    }
    assert_eq!(pieces, stops.len() + 1);
    checkpoint.state
}

#[test]
fn a_resumed_run_ends_bit_identical_in_both_parameterizations_and_blends() {
    let target = small_target();
    for blend in [Blend::Sum, Blend::Over] {
        for parameterization in [Parameterization::ScaleRotation, Parameterization::CovarianceFactor] {
            for (policy, tune) in [
                ("residual", Tune::Psnr),
                ("residual", Tune::Ssim),
                ("paper", Tune::Psnr),
                ("mcmc", Tune::Psnr),
                ("absolute-error", Tune::Psnr),
            ] {
                let policy = Policy::from_name(policy).unwrap();
                let settings = small_fit(blend).with(|s| {
                    s.parameterization = parameterization;
                    s.policy = policy;
                    s.tune = tune;
                    s.seed = 3;
                });
                let whole = end_state(settings.clone(), &target);
                // Within, on and right after rounds (every 10 steps), on and off the steps that bin
                // afresh (every 4).
                let pieces = end_state_in_pieces(settings, &target, &[1, 10, 23, 37]);
                assert_eq!(bits(&whole), bits(&pieces), "{blend:?} {parameterization:?}");
            }
        }
    }
}

#[test]
fn stopping_waits_for_a_step_that_bins_afresh() {
    let rasterizer = rasterizer();
    let settings = small_fit(Blend::Sum).with(|s| s.rounds = Rounds::NEVER);
    let mut trainer = Trainer::new(&rasterizer, &small_target(), settings).block_on().unwrap();
    assert_eq!(trainer.run(&mut StopAt(vec![5])).block_on().unwrap(), Outcome::Stopped);
    assert_eq!(trainer.step(), 8);
    trainer.step_once().block_on().unwrap();
    assert!(matches!(trainer.checkpoint().block_on(), Err(Error::BetweenCheckpoints { step: 9, next: 12 })));
}

#[test]
fn another_target_is_refused() {
    let rasterizer = rasterizer();
    let target = small_target();
    let mut trainer = Trainer::new(&rasterizer, &target, small_fit(Blend::Sum)).block_on().unwrap();
    let checkpoint = trainer.checkpoint().block_on().unwrap();
    let mut other = target.clone();
    other.pixels_mut()[7][1] += 0.25;
    let wider = Image::filled(target.width() + 1, target.height(), [0.5; 3]).unwrap();
    for wrong in [other, wider] {
        let error = Trainer::resume(&rasterizer, &wrong, checkpoint.clone()).unwrap_err();
        assert!(matches!(error, Error::WrongTarget { .. }), "{error}");
    }
    Trainer::resume(&rasterizer, &target, checkpoint).unwrap();
}

#[test]
fn a_checkpoint_of_something_else_is_refused() {
    let rasterizer = rasterizer();
    let target = small_target();
    let checkpoint =
        Trainer::new(&rasterizer, &target, small_fit(Blend::Sum)).block_on().unwrap().checkpoint().block_on().unwrap();
    let mut foreign = checkpoint.clone();
    foreign.metadata.clear();
    assert!(matches!(Trainer::resume(&rasterizer, &target, foreign), Err(Error::Checkpoint(_))));
    let mut hollow = checkpoint;
    hollow.state.tensors.clear();
    assert!(matches!(Trainer::resume(&rasterizer, &target, hollow), Err(Error::Core(gs_core::Error::State(_)))));
}

#[test]
fn the_log_of_a_resumed_fit_begins_with_the_rows_of_its_checkpoint() {
    /// The table but for the times.
    fn table(log: &MetricsLog) -> Vec<Vec<String>> {
        let cells =
            |row: &str| row.split(',').enumerate().filter(|&(k, _)| k != 1).map(|(_, c)| c.to_owned()).collect();
        log.to_csv().lines().map(cells).collect()
    }
    let (rasterizer, target, settings) = (rasterizer(), small_target(), small_fit(Blend::Sum));
    let mut whole = MetricsLog::new(7);
    Trainer::new(&rasterizer, &target, settings.clone()).block_on().unwrap().run(&mut whole).block_on().unwrap();

    let mut log = MetricsLog::new(7);
    let mut trainer = Trainer::new(&rasterizer, &target, settings).block_on().unwrap();
    assert_eq!(trainer.run(&mut (&mut log, StopAt(vec![15]))).block_on().unwrap(), Outcome::Stopped);
    let unwatched = trainer.checkpoint().block_on().unwrap();
    let mut saved = trainer.saved().block_on().unwrap();
    log.on_checkpoint(&mut saved).unwrap();
    let mut checkpoint = Checkpoint { state: saved.state.collect(), metadata: saved.metadata };

    let mut resumed = MetricsLog::new(7).resumed(&checkpoint.metadata).unwrap();
    assert_eq!(table(&resumed), table(&log));
    Trainer::resume(&rasterizer, &target, checkpoint.clone()).unwrap().run(&mut resumed).block_on().unwrap();
    assert_eq!(table(&resumed), table(&whole));

    assert!(MetricsLog::new(7).resumed(&unwatched.metadata).unwrap().rows().is_empty());
    checkpoint.metadata.insert("step".to_owned(), "1".to_owned());
    assert!(
        matches!(MetricsLog::new(7).resumed(&checkpoint.metadata), Err(Error::Checkpoint(_))),
        "rows beyond its step"
    );
}
