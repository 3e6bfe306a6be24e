//! Studies of 3D scenes from end to end, on two small synthetic data sets.

use pollster::FutureExt as _;
use std::{
    fs,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use crate::{
    Error, Existing, Places, Plan, Results, Study, StudyFolder, conduct, report,
    result::{EffectOf, Interval, Metric, ResultRemark, Verdict, remark::Pairing, write_tables},
    run::{Conducted, Finished, Record, RunOutcome, ViewResult, Watcher},
    study::{Arm, ArmSettings, Matching, Run, digest::of_scene_3d as scene_digest_3d},
};
use gs_conformance::posed::{small_scene, write_dataset};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_density::Policy;
use gs_io::dataset::{DatasetSettings, read_dataset};
use gs_jobs::WorkSettings;
use gs_train::{
    MetricsRow, Trainer3d,
    train::{StartName, Views, evaluate},
};

pub(crate) const STUDY: &str = "name = 'small-3d'\nscenes = ['one', 'two']\nbudgets = [60]\nseeds = [0, 1, 2]\npreset = 'quick'\n\
    iterations = 20\n[dataset]\nholdout = 4\n[settings]\nrender.effects.sh-degree = 1\nrounds = { every = 4, from = 4, until = 16 }\n\
    [[arm]]\nname = 'none'\npolicy = 'none'\n[[arm]]\nname = 'grown'\npolicy = 'percentile'\nsettings.exactly = true\n";

pub(crate) fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(1);
        s.level = None;
    }))
    .unwrap()
}

/// A folder with the data sets `one`, `two`, … , with points.
pub(crate) fn place(count: u32) -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    let names = ["one", "two", "three", "four", "five", "six"];
    for (variant, name) in (0..count).zip(names) {
        write_dataset(&place.path().join(name), &small_scene(variant), &cpu(), true).unwrap();
    }
    place
}

pub(crate) fn laid_out(text: &str, place: &Path) -> Result<Plan, Error> {
    let places = Places { data: Some(place.to_owned()), ..Places::default() };
    Plan::new(Study::from_toml(text, "small.toml")?, &places, "test")
}

fn outputs(folder: &StudyFolder) -> Vec<String> {
    let names = ["runs.csv", "quality.csv", "differences.csv", "views.csv"];
    names.iter().map(|name| fs::read_to_string(folder.file(name)).unwrap()).collect()
}

fn written(plan: &Plan, folder: &StudyFolder) {
    let results = Results::read(plan, folder).unwrap();
    assert_eq!(results.missing().count(), 0);
    write_tables(&results, folder).unwrap();
    report::write(&results, folder, "gs study small.toml").unwrap();
}

/// Stops the study in the middle of the run after this many.
struct StopAfter {
    whole: usize,
    ended: AtomicUsize,
    asked: AtomicUsize,
}

impl Watcher for StopAfter {
    fn ended(&self, _: &Run, _: &RunOutcome) {
        self.ended.fetch_add(1, Ordering::Relaxed);
    }

    fn wants_stop(&self) -> bool {
        let is_due = self.ended.load(Ordering::Relaxed) >= self.whole;
        is_due && self.asked.fetch_add(1, Ordering::Relaxed) > 5
    }
}

#[test]
fn a_study_of_scenes_runs_and_resumes() {
    let place = place(2);
    let plan = laid_out(STUDY, place.path()).unwrap();
    assert_eq!((plan.runs.len(), plan.targets[0].dataset().unwrap().views.len()), (12, 8));
    let alone = StudyFolder::prepare(&place.path().join("alone"), &plan, Existing::Refuse).unwrap();
    assert_eq!(conduct(&plan, &[&cpu()], &alone, &WorkSettings::default(), &()).unwrap(), Conducted::Whole);
    written(&plan, &alone);

    // Stopped within a run, and resumed by two workers.
    let paused = StudyFolder::prepare(&place.path().join("paused"), &plan, Existing::Refuse).unwrap();
    let watcher = StopAfter { whole: 3, ended: AtomicUsize::new(0), asked: AtomicUsize::new(0) };
    assert_eq!(conduct(&plan, &[&cpu()], &paused, &WorkSettings::default(), &watcher).unwrap(), Conducted::Stopped);
    assert_eq!(Results::read(&plan, &paused).unwrap().records.iter().flatten().count(), 3);
    conduct(&plan, &[&cpu(), &cpu()], &paused, &WorkSettings::default(), &()).unwrap();
    written(&plan, &paused);
    assert_eq!(outputs(&alone), outputs(&paused));

    // A row is the training that its settings and start describe, to the bit.
    let (run, record) = (&plan.runs[1], alone.record(&plan.runs[1]).unwrap().unwrap());
    let end = record.outcome.finished().unwrap();
    let data = place.path().join("one");
    let settings = DatasetSettings::default().with(|s| s.test_every = std::num::NonZeroU32::new(4));
    let dataset = read_dataset(data, &settings).unwrap();
    let rasterizer = cpu();
    let start = StartName::Points.of(&dataset).unwrap();
    let settings = run.settings.of_scene().clone();
    let mut trainer =
        Trainer3d::from_views(&rasterizer, Views::of_dataset(&dataset), start, settings).block_on().unwrap();
    trainer.run(&mut ()).block_on().unwrap();
    let scene = trainer.scene().block_on().unwrap();
    assert_eq!(end.scene, scene_digest_3d(&scene));
    // Its numbers are those of the evaluation of the scene.
    let held_out = Views::of_dataset(&dataset).test;
    let evaluation = evaluate(&rasterizer, &scene, &held_out, &trainer.shown()).block_on().unwrap();
    assert_eq!((end.psnr, end.ssim, end.gaussians), (evaluation.psnr, evaluation.ssim, 60));
    // 3 + 3 + 4 + 1 numbers and four coefficients of SH for three channels.
    assert_eq!((end.bytes, end.views.len()), (4 * 23 * 60, 2));
    for (view, expected) in end.views.iter().zip(&evaluation.views) {
        assert_eq!((&view.name, view.psnr, view.curve.last()), (&expected.name, expected.psnr, Some(&expected.psnr)));
    }
    let measured = end.trajectory.iter().filter(|row| row.psnr.is_some()).count();
    assert!(measured >= 5 && end.views.iter().all(|view| view.curve.len() == measured), "{measured}");
}

#[test]
fn the_report_shows_held_out_views_with_their_errors() {
    let place = place(2);
    let plan = laid_out(STUDY, place.path()).unwrap();
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    conduct(&plan, &[&cpu()], &folder, &WorkSettings::default(), &()).unwrap();
    written(&plan, &folder);
    let page = fs::read_to_string(folder.file("report.html")).unwrap();
    for expected in [
        "one, view images/0.png",
        "two, view images/4.png",
        "other seeds and views of these scenes",
        "2 scenes",
        "3 seeds on 2 scenes are too few (an interval needs 4 seeds, or 6 scenes)",
        "one (6 views and 2 held out, 32×24 px, 8 points)",
        "<dt>Scenes</dt>",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    // Two views of each scene: the view itself, and for each of two arms picture and error.
    assert_eq!(page.matches("src=\"data:").count(), 2 * 2 * (1 + 2 * 2));
    for plot in ["quality-over-steps-60", "quality-over-time-60", "growth-60", "growth-over-time-60"] {
        assert!(folder.file("plots").join(format!("{plot}.svg")).is_file(), "{plot}");
    }
    let views = fs::read_to_string(folder.file("views.csv")).unwrap();
    assert_eq!(views.lines().count(), 1 + 12 * 2, "{views}");
    let runs = fs::read_to_string(folder.file("runs.csv")).unwrap();
    assert!(runs.starts_with("row,arm,data_set,budget,"), "{runs}");
}

/// Results of made-up runs, whose views differ from 30 dB by these gains.
fn made_up<'p>(plan: &'p Plan, gain: impl Fn(&Run) -> Vec<f64>) -> Results<'p> {
    let row = |psnr: f64| MetricsRow {
        step: 20,
        seconds: 1.0,
        count: 60,
        edits: Default::default(),
        loss: 0.5,
        l1: None,
        psnr: Some(psnr),
        culled: None,
        clamped: None,
        fresh_start: None,
    };
    let record = |run: &Run| {
        let psnrs: Vec<f64> = gain(run).into_iter().map(|gain| 30.0 + gain).collect();
        let mean = psnrs.iter().sum::<f64>() / psnrs.len() as f64;
        let view = |(index, &psnr): (usize, &f64)| ViewResult {
            name: index.to_string(),
            psnr,
            ssim: 0.5,
            ms_ssim: None,
            l1: 0.1,
            curve: vec![psnr],
            is_shown: false,
        };
        let finished = Finished {
            gaussians: 60,
            bytes: 0,
            iterations: 20,
            psnr: mean,
            ssim: 0.5,
            ms_ssim: None,
            l1: 0.1,
            loss: None,
            edits: Default::default(),
            culled: Default::default(),
            scene: String::new(),
            seconds: 1.0,
            backend: "test".to_owned(),
            side_by_side: 1,
            trajectory: vec![row(mean)],
            views: psnrs.iter().enumerate().map(view).collect(),
            measured: Default::default(),
        };
        Some(Record {
            address: run.address.clone(),
            version: String::new(),
            machine: "test".into(),
            image: String::new(),
            target: String::new(),
            policy: None,
            settings: String::new(),
            outcome: RunOutcome::Finished(Box::new(finished)),
        })
    };
    Results { plan, records: plan.runs.iter().map(record).collect() }
}

#[test]
fn intervals_over_few_scenes_are_about_these_scenes() {
    let place = place(2);
    let plan = laid_out(&STUDY.replace("seeds = [0, 1, 2]", "seeds = [0, 1, 2, 3]"), place.path()).unwrap();
    // The arm gains 1 dB on the first scene and 2 on the second, and 0.1 more with each seed; views
    // are 5 dB apart in both arms, which pairing takes away.
    let gain = |run: &Run| {
        let arm = run.arm as f64 * (1.0 + run.target as f64 + 0.1 * f64::from(run.seed));
        vec![arm - 2.5, arm + 2.5]
    };
    let results = made_up(&plan, gain);
    for matching in Matching::ALL {
        let difference = results.difference(matching, Metric::Psnr, 60, 1, 0);
        assert_eq!((difference.pairing, difference.pairs), (Pairing::SeedsOfScenes, 16));
        assert_eq!(difference.verdict, Verdict::Better);
        assert_eq!(difference.remarks, [ResultRemark::FewScenes { scenes: 2 }]);
        // By hand: the mean is 1.15 and 2.15 on the scenes. Each resample is the mean of four of
        // 0, 0.1, 0.2 and 0.3 on each, so its standard deviation is 0.1118/2/√2 = 0.0395. Student's
        // quantile of 6 degrees of freedom is 2.447, times the root of 4/3 is 2.826: ±0.1117, in steps
        // of 0.0125.
        assert!((difference.mean.unwrap() - 1.65).abs() < 1e-9, "{difference:?}");
        let Interval { low, high } = difference.interval.unwrap();
        assert!((low - (1.65 - 0.1117)).abs() < 0.013 && (high - (1.65 + 0.1117)).abs() < 0.013, "{low} {high}");
    }
    let three = laid_out(STUDY, place.path()).unwrap();
    let results = made_up(&three, gain);
    let difference = results.difference(Matching::Count, Metric::Psnr, 60, 1, 0);
    assert_eq!((difference.interval, difference.verdict), (None, Verdict::None));
    assert_eq!(difference.remarks, [ResultRemark::TooFewSeeds { seeds: 3, scenes: 2, needed: 4 }]);
}

#[test]
fn intervals_over_many_scenes_are_as_wide_as_the_scenes_differ() {
    let place = place(6);
    let names = "scenes = ['one', 'two', 'three', 'four', 'five', 'six']";
    let plan = laid_out(&STUDY.replace("scenes = ['one', 'two']", names), place.path()).unwrap();
    // Scenes gain -0.5 to 0.5 dB, all views and seeds of a scene the same.
    let results = made_up(&plan, |run| vec![run.arm as f64 * (run.target as f64 * 0.2 - 0.5); 4]);
    let difference = results.difference(Matching::Count, Metric::Psnr, 60, 1, 0);
    assert_eq!((difference.pairing, difference.pairs), (Pairing::Scenes, 24));
    assert_eq!(difference.verdict, Verdict::CannotTell, "72 views that are no more than six scenes");
    let Interval { low, high } = difference.interval.unwrap();
    // By hand: the standard deviation of a resample is 0.3416/√6 = 0.1394; Student's quantile of 5
    // degrees is 2.571, times the root of 6/5 is 2.816: ±0.393, a little less as the tails are short.
    assert!((low + 0.385).abs() < 0.03 && (high - 0.385).abs() < 0.03, "{low} {high}");
    assert_eq!(difference.remarks, [ResultRemark::FewSeeds { seeds: 3 }]);
    let missing = Results {
        records: results.records.iter().zip(&plan.runs).map(|(r, run)| r.clone().filter(|_| run.target != 2)).collect(),
        plan: &plan,
    };
    let difference = missing.difference(Matching::Count, Metric::Psnr, 60, 1, 0);
    assert_eq!(difference.remarks[0], ResultRemark::ScenesMissing { missing: 1, of: 6 });
}

#[test]
fn an_arm_like_gs_train_has_the_number_and_the_start_of_its_preset() {
    let place = place(2);
    let arms = "preset = 'standard'\n[[arm]]\nname = 'equal'\n\
        [[arm]]\nname = 'alike'\nlike-gs-train = true\n\
        [[arm]]\nname = 'both'\nlike-gs-train = true\nstart = 'points-and-images'\n";
    let study = |budget: u32| {
        format!("name = 'x'\nscenes = ['one']\nbudgets = [{budget}]\nseeds = [0]\niterations = 20\n{arms}")
    };
    let plan = laid_out(&study(1_000_000), place.path()).unwrap();
    let counts = |plan: &Plan| -> Vec<u32> {
        plan.runs
            .iter()
            .map(|run| match &run.settings {
                ArmSettings::Scene(settings) => settings.gaussians,
                _ => 0,
            })
            .collect()
    };
    // The preset has 20,000 for images as small as these.
    assert_eq!(counts(&plan), [1_000_000, 20_000, 20_000]);
    assert_eq!(plan.runs[1].address, plan.runs[2].address, "a start of the preset's own");
    // The budget is a bound still.
    assert_eq!(counts(&laid_out(&study(500), place.path()).unwrap()), [500; 3]);
    let image = study(500).replace("scenes = ['one']", "images = ['paper']");
    let message = laid_out(&image, place.path()).unwrap_err().to_string();
    assert!(message.contains("arm `alike`: like-gs-train: is for scenes"), "{message}");
}

#[test]
fn an_arm_may_have_wrong_poses() {
    let place = place(2);
    let study = |percent: &str| {
        format!(
            "name = 'x'\nscenes = ['one']\nbudgets = [100]\nseeds = [0]\niterations = 20\npreset = 'standard'\n\
            [[arm]]\nname = 'right'\n\
            [[arm]]\nname = 'wrong'\npose-error = {{ degrees = 3.0, percent = {percent} }}\n"
        )
    };
    let plan = laid_out(&study("3.0"), place.path()).unwrap();
    assert_ne!(plan.runs[0].address, plan.runs[1].address);
    assert_ne!(plan.runs[1].address, laid_out(&study("2.0"), place.path()).unwrap().runs[1].address);
    let message = laid_out(&study("-1.0"), place.path()).unwrap_err().to_string();
    assert!(message.contains("arm `wrong`: pose-error: degrees and percent must be"), "{message}");
    let image = study("3.0").replace("scenes = ['one']", "images = ['paper']");
    let message = laid_out(&image, place.path()).unwrap_err().to_string();
    assert!(message.contains("arm `wrong`: pose-error: is for scenes"), "{message}");
}

/// The preset has a round every 10 of these 300 steps, and FastGS prunes at every tenth of them.
#[test]
fn a_policy_follows_the_rounds_of_the_study() {
    let place = place(2);
    let arms = "preset = 'standard'\nsettings.rounds.every = 25\n\
        [[arm]]\nname = 'fastgs'\npolicy = 'fastgs'\n\
        [[arm]]\nname = 'often'\npolicy = 'fastgs'\nsettings.rounds.every = 7\n";
    let study = format!("name = 'x'\nscenes = ['one']\nbudgets = [50]\nseeds = [0]\niterations = 300\n{arms}");
    let plan = laid_out(&study, place.path()).unwrap();
    let intervals = plan.runs.iter().map(|run| match &run.settings {
        ArmSettings::Scene(settings) => match &settings.policy {
            Policy::FastGs(policy) => (settings.rounds.every, policy.final_every),
            _ => (0, 0),
        },
        _ => (0, 0),
    });
    assert_eq!(intervals.collect::<Vec<_>>(), [(25, 50), (7, 35)]);
}

#[test]
fn effects_of_factors_have_intervals() {
    let place = place(2);
    let factors = "[[factor]]\nname = 'start'\nlevel = [{ name = 'points', start = 'points' }, { name = 'random', start = 'random' }]\n\
        [[factor]]\nname = 'policy'\nlevel = [{ name = 'none', policy = 'none' }, { name = 'top', policy = 'percentile' }]\n";
    let text = STUDY[..STUDY.find("[[arm]]").unwrap()].replace("[0, 1, 2]", "[0, 1, 2, 3]") + factors;
    let plan = laid_out(&text, place.path()).unwrap();
    assert_eq!(plan.runs.len(), 2 * 4 * 4);
    let starts: Vec<_> = plan.study.arms.iter().map(|arm| arm.start.unwrap()).collect();
    assert_eq!(starts, [StartName::Points, StartName::Points, StartName::Random, StartName::Random]);
    let addresses: std::collections::BTreeSet<_> = plan.runs.iter().map(|run| &run.address).collect();
    assert_eq!(addresses.len(), plan.runs.len(), "the start is part of the address");
    // Random costs 1 dB, the policy gains 0.5, and 0.25 more where the start is random.
    let results = made_up(&plan, |run| {
        let (random, top) = (run.arm / 2, run.arm % 2);
        let wobble = 0.01 * f64::from((run.seed * 7 + run.arm as u32 * 3) % 5);
        vec![top as f64 * 0.5 - random as f64 + 0.25 * (random * top) as f64 + wobble; 3]
    });
    let effects: Vec<_> =
        results.effects(&[Matching::Count]).into_iter().filter(|effect| effect.metric == Metric::Psnr).collect();
    let expected = [-1.0 + 0.125, 0.5 + 0.125, 0.25];
    assert_eq!(effects.len(), 3);
    for (effect, expected) in effects.iter().zip(expected) {
        let Interval { low, high } = effect.interval.unwrap();
        assert!(
            (effect.mean.unwrap() - expected).abs() < 0.05 && low < expected && expected < high + 0.05,
            "{effect:?}"
        );
    }
    assert_eq!([0, 1, 2].map(|i| effects[i].verdict), [Verdict::Worse, Verdict::Better, Verdict::Better]);
    assert!(matches!(&effects[2].of, EffectOf::Interaction { levels, .. } if *levels == ["random", "top"]));
    // Tables and report have them.
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    write_tables(&results, &folder).unwrap();
    report::write(&results, &folder, "gs study").unwrap();
    let table = fs::read_to_string(folder.file("effects.csv")).unwrap();
    assert!(table.contains("count,psnr,interaction,start,random,points,policy,top,none,"), "{table}");
    let page = fs::read_to_string(folder.file("report.html")).unwrap();
    assert!(page.contains("start: random instead of points") && page.contains("start: random × policy: top"));
}

#[test]
fn study_errors_name_the_place_and_the_key_in_one_line() {
    let place = place(2);
    let failed = |from: &str, to: &str| laid_out(&STUDY.replacen(from, to, 1), place.path()).unwrap_err().to_string();
    for (from, to, expected) in [
        ("'two'", "'three'", "three: no such data set in /"),
        ("scenes =", "images = ['paper']\nscenes =", "study `small-3d`: it has both images and scenes: make two"),
        (
            "policy = 'none'",
            "settings.rebin-every = 4",
            "study `small-3d`: arm `none`: settings: unknown key `rebin-every`",
        ),
        ("policy = 'none'", "policy = 'residual'", "arm `none`: policy: policy is `residual`"),
        ("policy = 'none'", "preset = 'paper'", "arm `none`: preset: there is no preset `paper` for scenes"),
        ("policy = 'none'", "start = 'depths'", "arm `none`: start: start is depths"),
        ("policy = 'none'", "start = 'nowhere'", "unknown name `nowhere`"),
        ("holdout = 4", "hold-out = 4", "line 8: unknown key `hold-out` in [dataset]: did you mean `holdout`?"),
        ("sh-degree = 1", "sh-degree = 7", "arm `none`: settings: sh-degree is 7"),
        ("exactly = true", "gaussians = 7", "`gaussians` is not for settings"),
        ("scenes = ['one', 'two']", "images = ['paper']", "[dataset] is for scenes"),
        ("scenes = ['one', 'two']", "scenes = []", "images: there are none"),
    ] {
        let message = failed(from, to);
        assert!(message.contains(expected) && !message.contains('\n'), "{to}: {message}");
    }
    // A file of the data set that changes makes other runs of it, and of no other scene.
    let addresses =
        || laid_out(STUDY, place.path()).unwrap().runs.into_iter().map(|run| run.address).collect::<Vec<_>>();
    let before = addresses();
    assert_eq!(addresses(), before);
    fs::copy(place.path().join("one/images/1.png"), place.path().join("one/images/2.png")).unwrap();
    let after = addresses();
    assert_eq!(before.iter().zip(&after).filter(|(a, b)| a != b).count(), 6);
    let message = {
        let mut study = Study::from_toml(STUDY, "x.toml").unwrap();
        study.arms.push(Arm::with_policy("own", "1", Arc::new(Policy::from_name("none").unwrap())));
        let places = Places { data: Some(place.path().to_owned()), ..Places::default() };
        Plan::new(study, &places, "test").unwrap_err().to_string()
    };
    assert!(message.contains("arm `own`: its own policy is for the other kind of scene"), "{message}");
}

#[test]
fn a_policy_of_ones_own_trains_scenes_too_and_views_can_be_limited() {
    let place = place(1);
    let text = STUDY
        .replace("['one', 'two']", "['one']")
        .replace("[0, 1, 2]", "[0]")
        .replace("holdout = 4", "views = 3\ntest-views = 1\nholdout = 4");
    let mut study = Study::from_toml(&text, "x.toml").unwrap();
    let none = Policy::from_name("none").unwrap();
    study.arms.push(Arm::with_policy_3d("own", "none again", Arc::new(none)));
    let places = Places { data: Some(place.path().to_owned()), ..Places::default() };
    let plan = Plan::new(study, &places, "test").unwrap();
    let names: Vec<&str> = plan.targets[0].dataset().unwrap().views.iter().map(|view| view.name.as_str()).collect();
    // Of 0 to 7, 0 and 4 are held out; of the six others, every second.
    assert_eq!(names, ["images/0.png", "images/1.png", "images/3.png", "images/6.png"]);
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    conduct(&plan, &[&cpu()], &folder, &WorkSettings::default(), &()).unwrap();
    let results = Results::read(&plan, &folder).unwrap();
    let scenes = |arm: usize| results.finished(arm, 60).map(|(_, end)| end.scene.clone()).collect::<Vec<_>>();
    assert_eq!((scenes(2), scenes(0).len()), (scenes(0), 1));
    assert_ne!(scenes(1), scenes(0));
}
