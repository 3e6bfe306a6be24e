//! The trial that decides the numbers of steps and Gaussians of a run.

use gs_core::Scene3d;
use gs_cpu::CpuRasterizer;
use gs_train::{
    Outcome, TrainSettings, Trainer3d,
    train::{Start, Views},
};
use pollster::FutureExt as _;

use crate::fixture_3d::{rasterizer, short, thirty, views};

/// Settings of a run that a trial may make four times as long.
fn undecided() -> TrainSettings {
    short(100).with(|s| {
        s.lengthen_to = 400;
        s.decide_gaussians = true;
        s.rounds.every = 5;
    })
}

fn begun(cpu: &CpuRasterizer, views: Views, settings: TrainSettings) -> Trainer3d<'_, CpuRasterizer> {
    Trainer3d::from_views(cpu, views, Start::Random, settings).block_on().expect("the views can be trained on")
}

fn end(mut trainer: Trainer3d<'_, CpuRasterizer>) -> Scene3d {
    assert_eq!(trainer.run(&mut ()).block_on().unwrap(), Outcome::Finished);
    trainer.scene().block_on().unwrap()
}

#[test]
fn a_run_whose_trial_still_gains_is_lengthened_and_can_be_repeated() {
    let cpu = rasterizer();
    let trainer = begun(&cpu, views(&cpu), undecided());
    let report = *trainer.trial().expect("there are enough rounds to tell");
    let gaussians = undecided().gaussians;
    assert_eq!((report.steps, report.left_out, report.iterations), (40, 2, 400));
    assert!(report.gain_db > 0.2 && report.gain_db < 20.0, "{} dB", report.gain_db);
    let (decided, repeated) = (trainer.settings().clone(), trainer.settings_to_repeat().clone());
    assert_eq!((decided.iterations, decided.lengthen_to, decided.decide_gaussians), (400, 0, false));
    assert_eq!((report.gaussians, decided.gaussians), (Some(2 * gaussians), 2 * gaussians), "no harm, and longer");
    assert_eq!((decided.rounds.every, decided.rounds.until), (20, 200));
    assert_eq!((repeated.iterations, repeated.lengthen_to, repeated.decide_gaussians), (100, 400, true));
    assert_eq!(repeated.gaussians, gaussians);
    // The trial changes nothing but these numbers.
    let scene = end(trainer);
    assert_eq!(scene, end(begun(&cpu, views(&cpu), decided)));
    assert_eq!(scene, end(begun(&cpu, views(&cpu), repeated)));
}

#[test]
fn a_trial_comes_back_from_a_checkpoint() {
    let cpu = rasterizer();
    let mut trainer = begun(&cpu, views(&cpu), undecided());
    let checkpoint = trainer.checkpoint().block_on().unwrap();
    let resumed = Trainer3d::resume_views(&cpu, views(&cpu), checkpoint).unwrap();
    assert!(trainer.trial().is_some());
    assert_eq!(resumed.trial(), trainer.trial());
    assert_eq!(resumed.settings(), trainer.settings());
    assert_eq!(resumed.settings_to_repeat(), trainer.settings_to_repeat());
}

#[test]
fn runs_that_cannot_tell_keep_their_numbers() {
    let cpu = rasterizer();
    let with = |change: &dyn Fn(&mut TrainSettings), most: usize| {
        let mut views = views(&cpu);
        views.train.truncate(most);
        let mut settings = undecided();
        change(&mut settings);
        let trainer = begun(&cpu, views, settings);
        (trainer.trial().is_some(), trainer.iterations(), trainer.settings().lengthen_to)
    };
    assert_eq!(with(&|_| {}, 4), (false, 100, 0), "four views");
    assert_eq!(with(&|s| s.rounds.every = 30, 12), (false, 100, 0), "one measurement");
    assert_eq!(with(&|s| s.lengthen_to = 100, 12), (false, 100, 0), "no longer run to decide about");
    assert_eq!(with(&|_| {}, 12), (true, 400, 0));
    let trainer = begun(&cpu, views(&cpu), undecided().with(|s| s.decide_gaussians = false));
    assert_eq!((trainer.iterations(), trainer.settings().gaussians), (400, undecided().gaussians), "steps alone");
    assert_eq!(trainer.trial().unwrap().gaussians, None);
}

#[test]
fn a_start_with_all_the_gaussians_allowed_has_a_trial() {
    let cpu = rasterizer();
    // Half of them, for the trial, are no whole number.
    let full = undecided().with(|s| {
        (s.gaussians, s.init.random) = (16_001, 16_001);
        s.exactly = true;
    });
    let trainer = begun(&cpu, views(&cpu), full);
    assert_eq!(trainer.count(), 16_001);
    assert!(trainer.trial().is_some());
}

#[test]
fn a_run_from_a_larger_scene_makes_room_for_it_unless_its_number_was_set() {
    let cpu = rasterizer();
    let begun =
        |settings: TrainSettings| Trainer3d::from_views(&cpu, views(&cpu), Start::Scene(thirty()), settings).block_on();
    let settings = undecided().with(|s| {
        s.gaussians = 20;
        s.gaussians_per_point = 5.0;
    });
    let trainer = begun(settings.clone()).expect("there is room for the scene");
    assert_eq!((trainer.settings().gaussians, trainer.iterations()), (30, 100));
    assert!(trainer.trial().is_none(), "a scene has had its steps");
    let refused = begun(settings.with_gaussians(20)).expect_err("20 were set");
    assert!(refused.to_string().contains("at most the number of Gaussians allowed"), "{refused}");
}
