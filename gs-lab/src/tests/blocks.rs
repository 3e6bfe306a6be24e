//! Trainings in blocks.

use std::{
    fs,
    path::Path,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

use gs_backend::FutureExt as _;
use gs_core::{Camera, Gaussian3d, Rasterizer as _, RenderSettings, Scene as _, Scene3d, examination::Examinable as _};
use gs_cpu::CpuRasterizer;
use gs_io::WorldFrame;
use gs_jobs::{AtEnd, Shard, WorkSettings};
use gs_train::{
    Recovery, Rounds, TrainSettings, Trainer3d,
    blocks::{BlocksEvaluation, BlocksPlan, BlocksSettings, Grid, begin, block_views, evaluate, own, settle},
    train::{PosedView, Start, TrainPreset, Views},
};

use super::scenes::cpu;
use crate::{
    Error,
    blocks::{BlockOutcome, BlocksFolder, BlocksOrigin, conduct, map},
    run::{Conducted, Watcher},
};

fn spread(index: usize, by: f64) -> f32 {
    ((index + 1) as f64 * by).fract() as f32
}

/// A floor of coloured Gaussians.
fn floor(count: usize) -> Scene3d {
    let gaussian = |i| Gaussian3d {
        mean: glam::Vec3::new(
            8.0 * spread(i, 0.754_877) - 4.0,
            0.1 * spread(i, 0.301),
            8.0 * spread(i, 0.569_84) - 4.0,
        ),
        log_scale: glam::Vec3::new(-1.4, -3.0, -1.4),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 1.5,
        sh: vec![glam::Vec3::from_array([0.137, 0.271, 0.419].map(|by| 2.0 * spread(i, by) - 1.0))],
    };
    (0..count).map(gaussian).collect()
}

/// Views of the floor from above, twelve to train with and two held out.
fn views(on: &CpuRasterizer, truth: &Scene3d, render: &RenderSettings) -> Views {
    let lens = Camera::looking_forward(40, 32, 1.0);
    let view = |index: usize| {
        let at = glam::Vec3::new(2.0 * (index % 4) as f32 - 3.0, -3.0, 2.5 * (index / 4) as f32 - 2.5);
        let camera = lens.looking_at(at, at + glam::Vec3::new(0.1, 3.0, 0.6), glam::Vec3::Z).unwrap();
        let image = on.render(truth, &camera, render).block_on().unwrap().clamped();
        PosedView::of_image(format!("{index}"), camera, image)
    };
    Views::new(
        (0..12).map(view).collect(),
        [5, 10].map(|index| PosedView { name: format!("t{index}"), ..view(index) }).to_vec(),
    )
}

fn settings(gaussians: u32) -> TrainSettings {
    let mut settings = TrainPreset::Standard.settings(Some(240)).with_gaussians(gaussians);
    settings.render.effects.sh_degree = 0;
    settings.rounds = Rounds::until(20, 120);
    settings
}

/// A coarse model of a floor, views of it, and a plan.
struct Floor {
    coarse: Scene3d,
    views: Views,
    plan: BlocksPlan,
    starts: Vec<Scene3d>,
}

fn planned(on: &CpuRasterizer, columns: u32, rows: u32) -> Floor {
    let (truth, settings) = (floor(220), settings(400));
    let mut views = views(on, &truth, &settings.render);
    let mut coarse = truth;
    coarse.sh.iter_mut().for_each(|sh| *sh *= 0.2);
    let settled = settle(&mut views, &Default::default()).unwrap();
    let mut starts = Vec::new();
    let division = BlocksSettings { grid: Grid { columns, rows }, margin: 0.1, threshold: 0.05 };
    let store = |block: usize, scene: &Scene3d| {
        starts.truncate(block);
        starts.push(scene.clone());
        Ok(())
    };
    let plan = BlocksPlan::new(on, &coarse, &views, settled, settings, division, store).block_on().unwrap();
    Floor { coarse, views, plan, starts }
}

#[test]
fn a_plan_repeats_and_divides_all_work() {
    let on = cpu();
    let Floor { coarse, views, plan, starts } = planned(&on, 2, 2);
    let again = planned(&on, 2, 2);
    assert_eq!((&plan, &starts), (&again.plan, &again.starts));
    let read: BlocksPlan = serde_json::from_str(&serde_json::to_string(&plan).unwrap()).unwrap();
    assert_eq!(read, plan);
    for (block, start) in plan.blocks.iter().zip(&starts) {
        assert_eq!(start.len() as u32, block.fixed + block.own);
        assert!(block.own >= 40 && block.fixed > 0 && block.gaussians > block.fixed + block.own, "{block:?}");
        assert!(block.views.iter().any(|view| view.window.is_some()), "{block:?}");
        assert!(
            start.means[block.fixed as usize..]
                .iter()
                .filter(|mean| block.cell.contains(plan.ground.place(**mean)))
                .count()
                > 30
        );
    }
    assert!((0..12).all(|view| plan.blocks.iter().any(|block| block.views.iter().any(|used| used.view == view))));
    let belongs =
        |mean: &glam::Vec3| plan.blocks.iter().filter(|block| block.cell.contains(plan.ground.place(*mean))).count();
    assert!(coarse.means.iter().all(|mean| belongs(mean) == 1));
    let svg = map(&plan, views.train_cameras(), &[]);
    assert_eq!((svg.matches("<circle").count(), svg.matches("block ").count()), (12, 4));
}

#[test]
fn one_block_is_plain_training_from_the_coarse_model() {
    let on = cpu();
    let Floor { coarse, views, plan, starts } = planned(&on, 1, 1);
    assert_eq!((plan.blocks[0].fixed, plan.blocks[0].steps, &starts[0]), (0, 240, &coarse));
    let of_block = block_views(&plan, 0, &views).unwrap();
    let mut block = begin(&on, &plan, 0, of_block, starts[0].clone()).block_on().unwrap();
    block.run(&mut ()).block_on().unwrap();
    let mut settings = plan.settings.clone();
    (settings.sh_degree_every, settings.recovery, settings.exposure) = (0, Recovery::Never, Default::default());
    let mut plain = Trainer3d::from_views(&on, views.clone(), Start::Scene(coarse), settings).block_on().unwrap();
    plain.run(&mut ()).block_on().unwrap();
    let scene = plain.scene().block_on().unwrap();
    assert!(scene.len() > 300, "{}", scene.len());
    assert!(own(&plan, 0, block.scene().block_on().unwrap()) == scene);
}

#[test]
fn fixed_gaussians_keep_their_bits_while_others_grow() {
    let on = cpu();
    let Floor { views, plan, starts, .. } = planned(&on, 2, 1);
    let of_block = block_views(&plan, 1, &views).unwrap();
    let mut trainer = begin(&on, &plan, 1, of_block, starts[1].clone()).block_on().unwrap();
    let few = Start::Scene((0..plan.blocks[1].fixed as usize).map(|index| starts[1].gaussian(index)).collect());
    for start in [Start::Random, few] {
        let refused = Trainer3d::from_views(&on, views.clone(), start, plan.settings_of(1)).block_on();
        assert!(refused.unwrap_err().to_string().contains("number of fixed Gaussians"));
    }
    trainer.run(&mut ()).block_on().unwrap();
    let (scene, fixed) = (trainer.scene().block_on().unwrap(), plan.blocks[1].fixed as usize);
    let first = |scene: &Scene3d| {
        let mut scene = scene.clone();
        scene.retain(&(0..scene.len()).map(|index| index < fixed).collect::<Vec<_>>());
        scene
    };
    assert_eq!(first(&scene), first(&starts[1]));
    assert!(scene.len() > starts[1].len(), "{} of {}", scene.len(), plan.blocks[1].gaussians);
    assert!(scene.means[fixed..starts[1].len()] != starts[1].means[fixed..]);
    let result = own(&plan, 1, scene);
    assert!(
        !result.is_empty() && result.means.iter().all(|mean| plan.blocks[1].cell.contains(plan.ground.place(*mean)))
    );
}

/// A folder with four blocks of a floor.
fn prepared(on: &CpuRasterizer, path: &Path) -> (BlocksFolder, Views) {
    let Floor { views, plan, starts, .. } = planned(on, 2, 2);
    let origin = BlocksOrigin {
        machine: "test".into(),
        dataset: "x".into(),
        reading: serde_json::Value::Null,
        frame: WorldFrame::WORLD,
    };
    let mut preparing = BlocksFolder::prepare(path, &plan.settings.render, &origin).unwrap();
    starts.iter().enumerate().for_each(|(block, start)| preparing.store(block, start).unwrap());
    (preparing.finish(origin, plan).unwrap(), views)
}

/// Stops after this many steps.
#[derive(Default)]
struct Stop {
    after: usize,
    requests: AtomicUsize,
    resumed: Mutex<Vec<usize>>,
}

impl Watcher<usize> for Stop {
    fn resumed(&self, block: &usize, step: u32) {
        assert!(step > 0);
        self.resumed.lock().unwrap().push(*block);
    }

    fn wants_stop(&self) -> bool {
        self.requests.fetch_add(1, Ordering::Relaxed) >= self.after
    }
}

#[test]
fn the_result_depends_neither_on_the_order_nor_on_interruptions() {
    let (on, place) = (cpu(), tempfile::tempdir().unwrap());
    let [(alone, views), (shared, _), (paused, _)] =
        ["alone", "shared", "paused"].map(|name| prepared(&on, &place.path().join(name)));
    assert!(matches!(alone.merged(), Err(Error::Folder { what, .. }) if what == "block 1 has not been done"));
    assert_eq!(conduct(&alone, &on, &views, &WorkSettings::default(), &()).unwrap(), Conducted::Whole);
    let merged = alone.merged().unwrap();
    // Two workers at the same time, one of which begins with the last block.
    std::thread::scope(|scope| {
        for index in [1, 0] {
            let (shared, views) = (&shared, &views);
            scope.spawn(move || {
                let settings = WorkSettings::default()
                    .with(|s| (s.shard, s.at_end) = (Some(Shard { index, count: 2 }), AtEnd::Wait));
                conduct(shared, &cpu(), views, &settings, &()).unwrap()
            });
        }
    });
    assert_eq!(shared.merged().unwrap(), merged);
    let mut resumed = Vec::new();
    for attempt in 0.. {
        let watcher = Stop { after: 3 + 30 * attempt, ..Stop::default() };
        let folder = BlocksFolder::open(paused.path()).unwrap();
        let conducted = conduct(&folder, &on, &views, &WorkSettings::default(), &watcher).unwrap();
        resumed.extend(watcher.resumed.into_inner().unwrap());
        if conducted == Conducted::Whole {
            break;
        }
    }
    assert!(resumed.len() > 3, "{resumed:?}");
    assert_eq!(paused.merged().unwrap(), merged);
    let names = |name: &str| fs::read_dir(paused.path().join(name)).unwrap().count();
    assert_eq!((names("runs"), names("scenes")), (4, 4), "nothing but records is left");
    let counts: usize = (0..4)
        .map(|block| match paused.record(block).unwrap().unwrap().outcome {
            BlockOutcome::Finished { gaussians, .. } => gaussians,
            failed => panic!("{failed:?}"),
        })
        .sum();
    assert_eq!(counts, merged.len());
    let render = alone.plan().settings.render;
    let BlocksEvaluation { whole: evaluation, blocks, edges, seams } =
        evaluate(&on, alone.plan(), (&merged, &merged), &views.test, &render).block_on().unwrap();
    assert_eq!(blocks.iter().map(|block| block.views).sum::<usize>(), 2);
    let Floor { coarse, plan, starts, .. } = planned(&on, 1, 1);
    let mut whole = begin(&on, &plan, 0, block_views(&plan, 0, &views).unwrap(), starts[0].clone()).block_on().unwrap();
    whole.run(&mut ()).block_on().unwrap();
    let psnr = |scene: &Scene3d| {
        evaluate(&on, alone.plan(), (scene, &merged), &views.test, &render).block_on().unwrap().whole.psnr
    };
    let (before, at_once) = (psnr(&coarse), psnr(&whole.scene().block_on().unwrap()));
    assert!(
        evaluation.psnr > before + 1.0 && evaluation.psnr > at_once - 3.0,
        "{} {before} {at_once}",
        evaluation.psnr
    );
    let near_edges = f64::from(u32::try_from(edges.pixels).unwrap()) / (2.0 * 40.0 * 32.0);
    assert!((0.01..0.5).contains(&near_edges) && edges.near.is_some() && edges.rest.is_some(), "{edges:?}");
    assert_eq!(seams.unwrap().size(), (120, 32));
}

#[test]
fn a_trial_says_how_long_blocks_take() {
    let (on, place) = (cpu(), tempfile::tempdir().unwrap());
    let (folder, views) = prepared(&on, &place.path().join("out"));
    let seconds = folder.expected_seconds(&on, &views, 0.1).block_on().unwrap();
    assert!(seconds.len() == 4 && seconds.iter().all(|seconds| *seconds > 0.0 && seconds.is_finite()), "{seconds:?}");
    let shown = map(folder.plan(), views.train_cameras(), &seconds);
    assert!(shown.matches("about ").count() == 4 && shown.matches("<circle").count() == 12, "{shown}");
    assert!(!map(folder.plan(), views.train_cameras(), &[]).contains("about "));
    let Views { train, .. } = &views;
    let fewer = Views { train: train[1..].to_vec(), ..views.clone() };
    assert!(folder.expected_seconds(&on, &fewer, 0.1).block_on().is_err());
}

#[test]
fn a_finished_block_stays_and_a_damaged_one_is_done_again() {
    let (on, place) = (cpu(), tempfile::tempdir().unwrap());
    let (folder, views) = prepared(&on, &place.path().join("out"));
    let work = || conduct(&folder, &on, &views, &WorkSettings::default(), &()).unwrap();
    let failed = BlockOutcome::Failed { error: "for a test".to_owned() };
    assert_eq!(folder.store_outcome(0, failed.clone()).unwrap(), failed);
    assert_eq!(work(), Conducted::Whole);
    let error = folder.merged().unwrap_err().to_string();
    assert!(error.contains("block 1 failed: for a test: do it with gs blocks work --retry"), "{error}");
    folder.forget_failures().unwrap();
    assert!(folder.record(0).unwrap().is_none() && folder.record(1).unwrap().is_some());
    work();
    let merged = folder.merged().unwrap();
    // A failure, or the same result of a process that was slower, changes nothing.
    let finished = folder.record(0).unwrap().unwrap().outcome;
    assert_eq!(folder.store_outcome(0, failed).unwrap(), finished);
    let file = folder.path().join("scenes/1.ply");
    let bytes = fs::read(&file).unwrap();
    assert!(folder.store_result(0, 1, 1.0, Scene3d::default()).unwrap_err().to_string().contains("another result"));
    assert_eq!((folder.record(0).unwrap().unwrap().outcome, fs::read(&file).unwrap()), (finished, bytes.clone()));
    fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    assert!(folder.merged().is_err());
    folder.forget_failures().unwrap();
    work();
    assert_eq!(folder.merged().unwrap(), merged);
}

#[test]
fn a_block_may_end_without_a_gaussian() {
    let (on, place) = (cpu(), tempfile::tempdir().unwrap());
    let (folder, views) = prepared(&on, &place.path().join("out"));
    let nothing = Scene3d { sh_degree: 0, ..Scene3d::default() };
    let outcome = folder.store_result(2, 5, 1.0, nothing).unwrap();
    assert!(matches!(outcome, BlockOutcome::Finished { gaussians: 0, .. }), "{outcome:?}");
    assert_eq!(conduct(&folder, &on, &views, &WorkSettings::default(), &()).unwrap(), Conducted::Whole);
    folder.forget_failures().unwrap();
    let merged = folder.merged().unwrap();
    let cell = folder.plan().blocks[2].cell;
    assert!(merged.len() > 100);
    assert!(!merged.means.iter().any(|mean| cell.contains(folder.plan().ground.place(*mean))));
}

#[test]
fn changed_blocks_or_inputs_are_refused() {
    let (on, place) = (cpu(), tempfile::tempdir().unwrap());
    let (folder, views) = prepared(&on, &place.path().join("out"));
    let others = Views { train: views.train[1..].to_vec(), ..views.clone() };
    let refused = |views: &Views| conduct(&folder, &on, views, &WorkSettings::default(), &()).unwrap_err().to_string();
    assert!(refused(&others).contains("is not the one of 12"));
    let mut changed = views.clone();
    changed.train[0] = PosedView { name: views.train[0].name.clone(), ..views.train[1].clone() };
    assert!(refused(&changed).contains("1 image has changed"), "{}", refused(&changed));
    assert!(folder.check(&"test".into()).is_ok());
    let other = folder.check(&"cpu avx9".into()).unwrap_err().to_string();
    assert!(other.contains("was prepared for test, but this is cpu avx9"), "{other}");
    assert!(BlocksFolder::refuse_existing(folder.path()).is_err());
    let start = folder.path().join("starts/1.ply");
    let bytes = fs::read(&start).unwrap();
    fs::write(&start, [&bytes[..bytes.len() - 1], &[bytes[bytes.len() - 1] ^ 1]].concat()).unwrap();
    assert!(refused(&views).contains("is not what was stored"));
    let file = folder.path().join("blocks.json");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replacen("\"version\": \"", "\"version\": \"9.", 1)).unwrap();
    let error = BlocksFolder::open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("version 9."), "{error}");
    fs::write(&file, &text[..text.len() / 2]).unwrap();
    assert!(BlocksFolder::open(folder.path()).unwrap_err().to_string().contains("is damaged"));
}
