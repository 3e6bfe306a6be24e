//! Rows that are replayed.

use pollster::FutureExt as _;
use std::fs;

use crate::{
    Error, Places, Plan, StudyFolder,
    run::{ReplayedScene, replay},
    study::{Machine, VERSION, digest::of_scene as scene_digest},
};
use gs_train::fit;

use super::{conducted, cpu, laid_out, place, study};

#[test]
fn every_row_is_a_fit_that_ends_in_the_recorded_scene() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &place.path().join("out"), 2, 1);
    let (rasterizer, other) = (cpu(1), cpu(2));
    for row in [1, 4, plan.runs.len()] {
        let replayed = replay(&plan, row, &rasterizer, &folder, &|_| ()).unwrap();
        let run = plan.run(row).unwrap();
        let (image, settings) = (plan.target(run).image().unwrap(), run.settings.of_image());
        let as_fit = fit(&other, image, settings.clone(), &mut ()).block_on().unwrap();
        assert_eq!(replayed.scene, ReplayedScene::TwoD(as_fit.scene.clone()));
        assert_eq!(scene_digest(&as_fit.scene), replayed.finished.scene);
    }
    // The tables suffice.
    fs::remove_dir_all(folder.file("runs")).unwrap();
    replay(&plan, 2, &rasterizer, &folder, &|_| ()).unwrap();
    assert!(matches!(replay(&plan, 99, &rasterizer, &folder, &|_| ()), Err(Error::NoRow { row: 99, rows: 16 })));
    // A row of another machine is refused, and so is a scene other than the recorded one.
    let places = Places { data: Some(place.path().to_owned()), ..Places::default() };
    let elsewhere = Plan::new(study(), &places, "another machine").unwrap();
    let refused = replay(&elsewhere, 2, &rasterizer, &folder, &|_| ()).unwrap_err().to_string();
    assert_eq!(refused, "row 2: recorded on test, but this is another machine: replay it there");
    let other_settings = laid_out(study().with(|s| s.iterations = Some(31)), place.path());
    assert!(matches!(replay(&other_settings, 2, &rasterizer, &folder, &|_| ()), Err(Error::Replay { row: 2, .. })));
    let json = fs::read_to_string(folder.file("results.json")).unwrap();
    let scene = replay(&plan, 2, &rasterizer, &folder, &|_| ()).unwrap().finished.scene;
    fs::write(folder.file("results.json"), json.replace(&scene, "0123")).unwrap();
    let refused = replay(&plan, 2, &rasterizer, &folder, &|_| ()).unwrap_err().to_string();
    assert!(refused.contains("not the recorded one") && refused.contains("0123"), "{refused}");
}

#[test]
fn a_row_of_another_machine_or_version_says_so_and_how_to_get_there() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let flags = ["--backend", "wgpu", "--adapter", "some GPU"].map(str::to_owned).to_vec();
    let there = Plan { machine: Machine { name: "wgpu some GPU".to_owned(), flags }, ..plan.clone() };
    let output = place.path().join("out");
    drop(conducted(&there, &output, 1, 1));
    let folder = StudyFolder::open(&output, false).unwrap();
    let refused = replay(&plan, 1, &cpu(1), &folder, &|_| ()).unwrap_err().to_string();
    let expected = "row 1: recorded on wgpu some GPU, but this is test: add --backend wgpu --adapter 'some GPU'";
    assert_eq!(refused, expected);
    // The tables alone give the same error.
    fs::remove_dir_all(folder.file("runs")).unwrap();
    fs::remove_file(folder.file("machine.json")).unwrap();
    let mut moved = plan.clone();
    moved.runs[0].address = "0".to_owned();
    assert_eq!(replay(&moved, 1, &cpu(1), &folder, &|_| ()).unwrap_err().to_string(), expected);
    let json = fs::read_to_string(folder.file("results.json")).unwrap();
    let older = json.replace(&format!("\"version\":\"{}\"", VERSION), "\"version\":\"0.0.9\"");
    fs::write(folder.file("results.json"), older.replace("wgpu some GPU", "test")).unwrap();
    let refused = replay(&moved, 1, &cpu(1), &folder, &|_| ()).unwrap_err().to_string();
    assert!(refused.starts_with("row 1: recorded by version 0.0.9, but this is 0."), "{refused}");
}
