//! `gs profile`: the table of stages, the same numbers as CSV and JSON, and what it refuses. The
//! wgpu backend needs an adapter.

use std::{collections::BTreeMap, fs, path::Path};

use serde_json::{Value, json};

use crate::{
    process::{Run, folder, gs, names_in, picture},
    train::dataset_and_scene,
};

/// The stages that every backend has.
const STAGES: [&str; 8] = ["project", "bin", "sort", "blend", "loss", "blend_bwd", "project_bwd", "adam"];

/// Runs `gs profile` with few repetitions; times are not tested.
fn profile(arguments: &[&str]) -> Run {
    gs(["profile", "-r", "3"].iter().chain(arguments))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// The rows of a CSV file by their first cell, and their numbers by column; empty cells are left
/// out.
fn rows_of(csv: &str) -> BTreeMap<&str, BTreeMap<&str, f64>> {
    let mut lines = csv.lines();
    let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells.len(), columns.len(), "{line}");
            let numbers = columns.iter().zip(&cells).skip(1).filter(|(_, cell)| !cell.is_empty());
            (cells[0], numbers.map(|(&column, cell)| (column, cell.parse().unwrap())).collect())
        })
        .collect()
}

/// Equal but for the last digit, which serde_json's quick parser may get wrong.
fn same(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * a.abs()
}

/// What must be true of every profile, of its CSV and of its table.
#[track_caller]
fn check(json: &Value, csv: &str) {
    let rows = rows_of(csv);
    let stages = json["stages"].as_array().unwrap();
    let names: Vec<&str> = stages.iter().map(|stage| stage["stage"].as_str().unwrap()).collect();
    for expected in STAGES {
        assert!(names.contains(&expected), "{expected} is not in {names:?}");
    }
    let whole = ["sum", "train_step_fresh", "train_step_reused", "forward"];
    assert_eq!(rows.len(), stages.len() + whole.len(), "{csv}");
    let (mut shares, mut sum) = (0.0, 0.0);
    for stage in stages {
        let (name, seconds) = (stage["stage"].as_str().unwrap(), &stage["seconds"]);
        let [low, median, high] = ["low", "median", "high"].map(|quantile| number(&seconds[quantile]));
        assert!(0.0 <= low && low <= median && median <= high && high < 60.0, "{stage}");
        assert_eq!(seconds["samples"].as_array().unwrap().len(), 3, "{stage}");
        match stage["share"].as_f64() {
            Some(share) => {
                shares += share;
                sum += median;
                assert_eq!(stage["replaced_by"], Value::Null);
            }
            None => assert!(names.contains(&stage["replaced_by"].as_str().unwrap()), "{stage}"),
        }
        let blends = name.starts_with("blend") || name == "fused";
        assert_eq!(stage["pairs"].as_u64(), blends.then(|| json["pairs"].as_u64().unwrap()), "{stage}");

        let row = &rows[name];
        for (column, value) in [
            ("seconds", &seconds["median"]),
            ("seconds_low", &seconds["low"]),
            ("seconds_high", &seconds["high"]),
            ("share", &stage["share"]),
            ("pairs", &stage["pairs"]),
            ("pairs_per_second", &stage["pairs_per_second"]),
        ] {
            match (row.get(column), value.as_f64()) {
                (Some(&in_csv), Some(in_json)) => assert!(same(in_csv, in_json), "{column} of {name}: {csv}"),
                (in_csv, in_json) => assert!(in_csv.is_none() && in_json.is_none(), "{column} of {name}: {csv}"),
            }
        }
    }
    assert!((shares - 1.0).abs() < 1e-9, "shares sum to {shares}");
    assert!(same(sum, number(&json["sum_seconds"])) && same(sum, rows["sum"]["seconds"]), "{csv}");
    for name in &whole[1..] {
        let median = number(&json[name]["median"]);
        assert!(median > 0.0 && same(rows[name]["seconds"], median), "{name}: {csv}");
    }
}

/// Profiles into a folder and checks that all three forms agree.
#[track_caller]
fn profiled(arguments: &[&str]) -> Value {
    let place = folder();
    let output = place.path().join("made/on/demand");
    let run = profile(&[arguments, &["-o", output.to_str().unwrap(), "--json"]].concat());
    assert!(run.stderr.contains("wrote profile.csv and profile.json"), "{run:?}");
    let json = run.json();
    assert_eq!(names_in(&output), ["profile.csv", "profile.json"]);
    let stored: Value = serde_json::from_slice(&fs::read(output.join("profile.json")).unwrap()).unwrap();
    assert_eq!(stored, json);
    check(&json, &fs::read_to_string(output.join("profile.csv")).unwrap());
    json
}

/// Fits a small picture and returns the scene.
fn scene(place: &Path) -> String {
    let (image, output) = (picture(place, 48, 32), place.join("fit"));
    let flags = ["-n", "40", "--iterations", "15", "--no-report", "--backend", "cpu"];
    gs(["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap()].into_iter().chain(flags)).done();
    output.join("scene.gs2d.safetensors").to_str().unwrap().to_owned()
}

fn the_circle_and_square_need_no_file_on(backend: &str, clocks: &[&str]) {
    let json = profiled(&["--backend", backend, "-n", "100", "-i", "20"]);
    assert_eq!((&json["backend"], &json["input"]), (&json!(backend), &Value::Null));
    assert_eq!((&json["width"], &json["height"], &json["fitted_steps"]), (&json!(128), &json!(128), &json!(20)));
    assert_eq!((&json["blend"], &json["repetitions"]), (&json!("over"), &json!(3)));
    assert!(json["gaussians"].as_u64().unwrap() >= 20, "{json}");
    let clock = json["clock"].as_str().unwrap();
    assert!(clocks.contains(&clock), "{clock}");
    assert_eq!(json["adapter"].is_string(), backend == "wgpu");
    assert_eq!(json["simd"].is_string(), backend == "cpu");
}

#[test]
fn the_circle_and_square_need_no_file_on_the_cpu() {
    the_circle_and_square_need_no_file_on("cpu", &["host"]);
}

#[test]
fn the_circle_and_square_need_no_file_on_wgpu() {
    the_circle_and_square_need_no_file_on("wgpu", &["device", "round-trip"]);
}

#[test]
fn an_image_is_fitted_first() {
    let place = folder();
    let image = picture(place.path(), 48, 32);
    let image = image.to_str().unwrap();
    let json = profiled(&[image, "--backend", "cpu", "-n", "60"]);
    assert_eq!((&json["input"], &json["target"]), (&json!(image), &json!(image)));
    assert_eq!((&json["gaussians"], &json["fitted_steps"]), (&json!(60), &json!(100)));
    assert_eq!(
        (&json["blend"], &json["loss"], &json["parameterization"]),
        (&json!("sum"), &json!("l2"), &json!("covariance-factor"))
    );
    // Added up under L2, a tile is blended forward and backward in one pass.
    let stages = json["stages"].as_array().unwrap();
    let replaced: Vec<&str> =
        stages.iter().filter(|s| s["replaced_by"] == "fused").map(|s| s["stage"].as_str().unwrap()).collect();
    assert_eq!(replaced, ["blend", "loss", "blend_bwd"]);

    let other = profiled(&[image, "--backend", "cpu", "-n", "60", "-i", "10", "--loss", "l1", "--size", "24x16"]);
    assert_eq!((&other["fitted_steps"], &other["loss"]), (&json!(10), &json!("l1")));
    assert_eq!((&other["width"], &other["target"]), (&json!(24), &json!("its own rendering")));
    assert!(!other["stages"].as_array().unwrap().iter().any(|stage| stage["stage"] == "fused"));
}

fn is_taken_as_it_is(scene: &str, backend: &str) {
    let json = profiled(&[scene, "--backend", backend]);
    assert_eq!((&json["input"], &json["target"]), (&json!(scene), &json!("its own rendering")));
    assert_eq!((&json["gaussians"], &json["fitted_steps"]), (&json!(40), &Value::Null));
    assert_eq!((&json["width"], &json["height"]), (&json!(48), &json!(32)));
    let (pairs, entries) = (json["pairs"].as_u64().unwrap(), json["entries"].as_u64().unwrap());
    assert!(entries >= 30 && pairs >= entries, "{pairs} pairs of {entries} entries");
}

#[test]
fn a_scene_is_taken_as_it_is_unless_flags_change_it() {
    let place = folder();
    let scene = scene(place.path());
    is_taken_as_it_is(&scene, "cpu");
    let image = picture(place.path(), 96, 64);
    let flags = ["--image", image.to_str().unwrap(), "--size", "96x64", "--blend", "over", "--backend", "cpu"];
    let json = profiled(&[&[scene.as_str()][..], &flags].concat());
    assert_eq!((&json["target"], &json["blend"]), (&json!(image.to_str().unwrap()), &json!("over")));
    assert_eq!(json["width"], 96);
}

fn the_table_describes(scene: &str, backend: &str, clock: &str) {
    let run = profile(&[scene, "--backend", backend]).done();
    assert_eq!(run.stderr, "", "a scene needs no fit");
    let text = run.stdout;
    assert!(text.starts_with(&format!("{backend} (")) && text.contains("as requested"), "{text}");
    assert!(text.contains(": 40 Gaussians; 48x32 px, sum, l2, covariance-factor; target: its own rendering"), "{text}");
    assert!(text.contains(clock), "{text}");
    for row in STAGES.iter().chain(&["sum", "training step, lists made anew", "forward pass alone"]) {
        let found = text.lines().find(|line| line.starts_with(&format!("{row} "))).unwrap_or_else(|| panic!("{row}"));
        let first = found[32..].split_whitespace().next().unwrap();
        assert!(first.parse::<f64>().is_ok_and(|ms| ms >= 0.0), "{found}");
    }
    assert!(text.contains("100.0 %"), "{text}");
}

#[test]
fn the_table_shows_backend_clock_stages_and_whole_steps() {
    let place = folder();
    the_table_describes(&scene(place.path()), "cpu", "clock of the stages: host; 3");
}

#[test]
fn a_scene_is_profiled_as_it_is_on_wgpu_and_the_table_describes_it() {
    let place = folder();
    let scene = scene(place.path());
    is_taken_as_it_is(&scene, "wgpu");
    the_table_describes(&scene, "wgpu", "clock of the stages: ");
}

fn nothing_takes_its_time_on(backend: &str) {
    let place = folder();
    let path = place.path().join("empty.gs2d.safetensors");
    gs_io::write_2d(&path, &gs_io::File2d { width: 1, height: 1, ..Default::default() }).unwrap();
    let run = profile(&[path.to_str().unwrap(), "--backend", backend]).done();
    assert!(run.stdout.contains(": 0 Gaussians; 1x1 px"), "{run:?}");
    assert!(!run.stdout.contains("NaN") && !run.stdout.contains("inf"), "{run:?}");
}

#[test]
fn nothing_takes_its_time_too() {
    nothing_takes_its_time_on("cpu");
}

#[test]
fn nothing_takes_its_time_on_wgpu_too() {
    nothing_takes_its_time_on("wgpu");
}

#[test]
fn what_cannot_be_profiled_is_refused_before_anything_is_written() {
    let place = folder();
    let scene = scene(place.path());
    let image = picture(place.path(), 20, 10);
    let image = image.to_str().unwrap();
    let broken = place.path().join("broken.safetensors");
    fs::write(&broken, &fs::read(&scene).unwrap()[..200]).unwrap();
    let text = place.path().join("text");
    fs::write(&text, "This is neither.\n").unwrap();
    let absent = place.path().join("absent.png");
    let output = place.path().join("out");
    let (broken, text, absent) = (broken.to_str().unwrap(), text.to_str().unwrap(), absent.to_str().unwrap());
    let cases: [(&[&str], i32, &[&str]); 13] = [
        (&[absent], 1, &[absent, "no such file"]),
        (&[broken], 1, &[broken, "broken"]),
        (&[text], 1, &[text, "is text, not an image", "or name a scene"]),
        (&[place.path().to_str().unwrap()], 1, &["holds no scene"]),
        (&[&scene, "-n", "9"], 2, &["--gaussians is for images", "leave it out"]),
        (&[&scene, "-i", "9"], 2, &["--iterations is for images", "leave it out"]),
        (&[&scene, "--image", image], 2, &["20x10", "48x32", "--size 20x10"]),
        (&[image, "--image", image], 2, &["--image", "leave it out"]),
        (&[&scene, "--size", "0x5"], 2, &["WIDTHxHEIGHT"]),
        (&[&scene, "--size", "20000x20000"], 2, &["--size", "20000x20000"]),
        (&[&scene, "--repetitions", "0"], 2, &["--repetitions", "must be from 1 to 100000"]),
        (&[&scene, "--blend", "under"], 2, &["possible values: sum, over", "gs profile --help"]),
        (&[&scene, "--backend", "wgpu", "--simd", "baseline"], 2, &["--simd baseline is for --backend cpu"]),
    ];
    for (arguments, status, expected) in cases {
        let run = gs(["profile", "-o", output.to_str().unwrap()].iter().chain(arguments));
        assert_eq!(run.status, Some(status), "{run:?}");
        for part in expected {
            assert!(run.refusal().contains(part), "{part}: {run:?}");
        }
        assert!(!output.exists(), "{arguments:?}");
    }
    fs::write(&output, "a file where a folder should be").unwrap();
    let run = gs(["profile", &scene, "-o", output.join("in").to_str().unwrap()]);
    assert_eq!(run.status, Some(1), "{run:?}");
    assert!(run.refusal().contains("choose another folder with --output"), "{run:?}");
}

/// Profiles a 3D scene, and writes into a folder of `place`.
fn a_3d_scene_is_profiled_on(backend: &str, scene: &str, place: &Path) {
    let output = place.join(backend);
    let flags = ["--size", "40x30", "--order", "per-pixel", "--backend", backend, "-o", output.to_str().unwrap()];
    let run = profile(&[&[scene], &flags[..]].concat()).done();
    assert!(run.stdout.contains("8 Gaussians; 40x30 px, over, order per-pixel, antialias dilate, SH degree 0"));
    let json: Value = serde_json::from_slice(&fs::read(output.join("profile.json")).unwrap()).unwrap();
    check(&json, &fs::read_to_string(output.join("profile.csv")).unwrap());
    let printed = ["order", "loss", "parameterization", "target"].map(|key| json[key].clone());
    let loss = json!({ "l1-dssim": { "lambda": 0.2 } });
    assert_eq!(printed, [json!("per-pixel"), loss, json!("scale-rotation"), json!("its own rendering")]);
}

#[test]
fn a_3d_scene_is_profiled_on_wgpu() {
    let place = folder();
    let (_, scene) = dataset_and_scene(place.path());
    a_3d_scene_is_profiled_on("wgpu", scene.to_str().unwrap(), place.path());
}

#[test]
fn a_3d_scene_is_profiled_as_flags_say() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let (scene, view) = (scene.to_str().unwrap(), format!("{}:3", dataset.display()));
    a_3d_scene_is_profiled_on("cpu", scene, place.path());
    let of_view = profile(&[scene, "--camera", &view, "--backend", "cpu", "--json"]).json();
    assert_eq!((&of_view["width"], &of_view["order"]), (&json!(32), &json!("global")));
    for (flags, part) in [(&["-n", "5"][..], "is a scene"), (&["--camera", "nowhere"], "DATASET:VIEW")] {
        let refused = profile(&[&[scene], flags].concat());
        assert!(refused.refusal().contains(part), "{refused:?}");
    }
    let refused = profile(&["--order", "global"]);
    assert!(refused.refusal().contains("are for 3D scenes"), "{refused:?}");
}
