//! `gs profile`, `effects`, `frontier` and `popping`: what they print and write, and what all of them
//! refuse. What they measure is tested in gs-lab.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::Vec3;
use gs_core::{Gaussian3d, Scene as _, Scene3d};
use serde_json::{Value, json};

use crate::{
    process::{folder, gs, names_in, picture},
    train::{dataset_and_scene, text},
};

/// Two discs, one through the other, with SH that change no pixel visibly, as a PLY file.
fn faintly_shiny(place: &Path) -> PathBuf {
    let mut scene = Scene3d { sh_degree: 2, ..Scene3d::default() };
    for side in [-1.0, 1.0] {
        let turned = glam::Quat::from_rotation_y(f32::to_radians(35.0 * side));
        let disc = Gaussian3d {
            mean: Vec3::new(0.05 * side, 0.0, 0.0),
            log_scale: Vec3::new(0.4, 0.4, 0.04).map(f32::ln),
            rotation: [turned.w, turned.x, turned.y, turned.z],
            opacity_logit: 2.2,
            sh: vec![Vec3::new(side, 0.0, -side)],
        };
        scene.push(disc.with_degree(2));
    }
    for coefficients in scene.sh.chunks_exact_mut(9) {
        coefficients[1..].fill(Vec3::splat(1e-4));
    }
    let path = place.join("discs.ply");
    gs_io::write_3d(&path, &scene, &gs_io::WriteOptions3d::default()).unwrap();
    path
}

/// A small picture as a 2D scene of 40 Gaussians.
fn fitted(place: &Path) -> String {
    let (image, output) = (picture(place, 48, 32), place.join("fit"));
    let flags = ["-n", "40", "--iterations", "15", "--no-report", "--backend", "cpu"];
    gs(["fit", text(&image), "-o", text(&output)].into_iter().chain(flags)).done();
    text(&output.join("scene.gs2d.safetensors")).to_owned()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn a_fit_is_profiled_on(backend: &str, clocks: &[&str]) {
    let place = folder();
    let scene = place.path().join("fit");
    gs(["fit", "-n", "100", "-i", "20", "--no-report", "--backend", "cpu", "-o", text(&scene)]).done();
    let json = gs(["profile", text(&scene), "-r", "3", "--backend", backend, "--json"]).json();
    assert!(json["stages"].as_array().unwrap().len() > 3, "{json}");
    assert_eq!((&json["backend"], &json["input"]), (&json!(backend), &json!(scene)));
    assert_eq!((&json["width"], &json["height"]), (&json!(128), &json!(128)));
    assert_eq!((&json["blend"], &json["repetitions"]), (&json!("over"), &json!(3)));
    assert!(clocks.contains(&json["clock"].as_str().unwrap()), "{json}");
    assert_eq!((json["adapter"].is_string(), json["simd"].is_string()), (backend == "wgpu", backend == "cpu"));
}

#[test]
fn a_fit_is_profiled_on_the_cpu() {
    a_fit_is_profiled_on("cpu", &["host"]);
}

#[test]
fn a_fit_is_profiled_on_wgpu() {
    a_fit_is_profiled_on("wgpu", &["device", "round-trip"]);
}

#[test]
fn scenes_are_profiled_as_flags_say() {
    let place = folder();
    let scene = fitted(place.path());
    let profile = |arguments: &[&str]| gs(["profile", "-r", "2", "--backend", "cpu"].iter().chain(arguments)).done();
    let run = profile(&[&scene]);
    assert_eq!(run.stderr, "");
    let head: Vec<&str> = run.stdout.lines().collect();
    assert_eq!(head[0], "scene.gs2d.safetensors: 40 Gaussians, seen from its canvas, 48x32 px");
    assert!(head[1].starts_with("cpu (") && head[2] == "blend sum, l2, covariance-factor", "{head:?}");
    assert!(profile(&[&scene, "--loss", "l1"]).stdout.contains("\nblend sum, l1, covariance"));

    let (dataset, scene) = dataset_and_scene(place.path());
    let view = format!("{}:3", dataset.display());
    let of_view = profile(&[text(&scene), "--camera", &view, "--order", "per-pixel"]).stdout;
    assert!(of_view.contains(", 32x32 px\n") || of_view.contains(", 32x24 px\n"), "{of_view}");
    assert!(of_view.contains("order per-pixel, blend over, antialias dilate"), "{of_view}");
}

#[test]
fn required_effects_of_a_3d_scene_are_reported() {
    let place = folder();
    let scene = faintly_shiny(place.path());
    let flags = ["--size", "48x40", "--views", "3", "--repetitions", "2", "--backend", "cpu"];
    let run = |more: &[&str]| gs(["effects", text(&scene)].iter().chain(&flags).chain(more));
    let report = run(&["--json", "--order", "per-pixel"]).json();
    let effects = &report["proof"]["required"]["settings"]["effects"];
    assert_eq!((effects["order"].as_str(), effects["sh-degree"].as_u64()), (Some("per-pixel"), Some(0)));
    assert_eq!((effects["background"].as_str(), effects["antialias"].as_str()), (Some("none"), Some("dilate")));
    let most = number(&report["proof"]["difference"]["max"]);
    assert!(most > 0.0 && most < 1.0 / 512.0, "{most}");
    let order = &report["prices"]["each"][0];
    assert_eq!((order["effect"].as_str(), order["cheaper"].as_str()), (Some("order"), Some("global")));
    assert!(number(&order["change"]["max"]) > 0.1, "the discs pop: {order}");

    let text = run(&[]).done().stdout;
    assert!(text.contains("2 Gaussians, seen from 3 cameras around it, 48x40 px"), "{text}");
    assert!(text.contains("higher coefficients change no pixel by more than 0.00"), "{text}");
    assert!(text.contains("verified in 3 views: no pixel differs by more than 0.000"), "{text}");
}

#[test]
fn rendering_uses_required_effects_unless_a_flag_decides() {
    let place = folder();
    let scene = faintly_shiny(place.path());
    let render = |flags: &[&str]| {
        let png = place.path().join("picture.png");
        let words = ["render", text(&scene), "-o", text(&png), "--size", "48x40", "--backend", "cpu", "--verbose"];
        let run = gs(words.iter().chain(flags)).done();
        (gs_io::read_image(&png).unwrap().image, run.stderr)
    };
    let (auto, printed) = render(&[]);
    assert!(printed.contains("without sh-degree 2 (higher coefficients change no pixel by more than"), "{printed}");
    let (all, printed) = render(&["--effects", "all"]);
    assert!(printed.contains("sh-degree 2 (--effects all)"), "{printed}");
    let steps = auto.pixels().as_flattened().iter().zip(all.pixels().as_flattened());
    let most = steps.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(most <= 1.0 / 255.0 + 1e-6, "at most one step of an eight-bit picture: {most}");
    let (unordered, printed) = render(&["--effects", "sh-degree,antialias"]);
    assert!(printed.contains("without order global (not in --effects)"), "{printed}");
    assert!(unordered != auto);
}

#[test]
fn required_effects_of_a_2d_scene_are_reported() {
    let place = folder();
    let scene = fitted(place.path());
    let flags = ["--repetitions", "1", "--size", "9x7", "--backend", "cpu", "--json"];
    let report = gs(["effects", &scene].iter().chain(&flags)).json();
    assert_eq!(number(&report["proof"]["difference"]["max"]), 0.0, "bit-identical");
    assert_eq!((&report["gaussians"], &report["width"]), (&json!(40), &json!(9)));
}

#[test]
fn corrections_of_a_training_are_priced_on_request() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let flags = ["--size", "32x24", "--views", "2", "--repetitions", "1", "--backend", "cpu"];
    let run = |more: &[&str]| gs(["effects", text(&scene), text(&dataset)].iter().chain(&flags).chain(more));
    let report = run(&["--train", "12", "--json"]).json();
    let [price] = &report["training"]["prices"].as_array().unwrap()[..] else { panic!("{report}") };
    assert_eq!((price["effect"].as_str(), report["training"]["steps"].as_u64()), (Some("exposure"), Some(12)));
    for side in ["with", "without"] {
        let numbers = ["milliseconds", "psnr", "color-matched"].map(|name| number(&price[side][name]));
        assert!(numbers.iter().all(|number| *number > 0.0), "{price}");
    }
    // Poses need 15 steps a view.
    let printed = run(&["--train", "12"]).done().stdout;
    assert!(printed.contains("training of 12 steps") && printed.contains("\nexposure "), "{printed}");
    assert!(!printed.contains("\nposes "), "{printed}");
    let report = run(&["--train", "240", "--json"]).json();
    let [_, poses] = &report["training"]["prices"].as_array().unwrap()[..] else { panic!("{report}") };
    assert_eq!(poses["effect"].as_str(), Some("poses"));
    for side in ["with", "without"] {
        assert!(number(&poses[side]["milliseconds"]) > 0.0 && number(&poses[side]["pose-matched"]) > 0.0, "{poses}");
    }
}

/// Runs `gs frontier` as quickly as possible; times are not tested.
fn frontier<'a>(input: &'a str, flags: &[&'a str]) -> Vec<&'a str> {
    [&["frontier", input, "--backend", "cpu", "--seconds", "1", "--threads", "2"], flags].concat()
}

#[test]
fn a_frontier_is_printed_and_written_and_render_takes_its_settings() {
    let place = folder();
    let scene = fitted(place.path());
    let output = place.path().join("out");
    let run = gs(frontier(&scene, &["-o", text(&output)])).done();
    for expected in
        ["40 Gaussians", "default, again", "3DGS", "no cut-offs", "alpha cut 1/512", "a rendering without cut-offs"]
    {
        assert!(run.stdout.contains(expected), "{expected}: {}", run.stdout);
    }
    assert_eq!(names_in(&output), ["frontier.json", "frontier.svg"]);
    let json = read_json(&output.join("frontier.json"));
    let rows = json["rows"].as_array().unwrap();
    let levels = rows.iter().filter(|row| row["role"] == "alone" && row["change"]["axis"] == "SIMD").count();
    assert_eq!(levels + 1, gs_cpu::SimdLevel::available().len());

    // The settings are used: a picture whose cut is half is empty.
    let render = |name: &str, flags: &[&str]| {
        let png = place.path().join(name);
        gs(["render", &scene, "-o", text(&png)].iter().chain(flags)).done();
        gs_io::read_image(&png).unwrap().image
    };
    let usual = render("usual.png", &[]);
    let psnr = |accuracy| gs_core::metrics::psnr(&usual, &render("a.png", &["--accuracy", accuracy])).unwrap();
    assert!(psnr("alpha-cut=0.001") > 35.0);
    assert!(psnr("alpha-cut=0.5,alpha-max=0.9") < 30.0);
    for (wrong, expected) in [("alpha-cuts=0.1", "`alpha-cut`"), ("alpha-cut=7", "must be"), ("1/255", "KEY=VALUE")] {
        let png = place.path().join("b.png");
        let run = gs(["render", &scene, "-o", text(&png), "--accuracy", wrong]);
        assert!(run.status == Some(2) && run.refusal().contains(expected), "{run:?}");
    }
}

#[test]
fn the_frontier_of_a_3d_scene_has_its_effects() {
    let place = folder();
    let scene = faintly_shiny(place.path());
    let output = place.path().join("out");
    gs(frontier(text(&scene), &["--size", "40x30", "--views", "2", "-o", text(&output)])).done();
    let json = read_json(&output.join("frontier.json"));
    let axes: Vec<&str> =
        json["rows"].as_array().unwrap().iter().filter_map(|row| row["change"]["axis"].as_str()).collect();
    for expected in ["order", "antialias", "sh-degree", "full below"] {
        assert!(axes.contains(&expected), "{expected}: {axes:?}");
    }
}

#[test]
fn popping_is_measured_in_both_orders() {
    let place = folder();
    let (scene, output) = (faintly_shiny(place.path()), place.path().join("out"));
    let flags = ["--size", "48x40", "--places", "2", "--step", "1", "--frames", "9", "--backend", "cpu"];
    let run = gs(["popping", text(&scene), "-o", text(&output)].into_iter().chain(flags)).done();
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert!(lines[0].contains("discs, 2 Gaussians") && lines.len() == 8, "{}", run.stdout);
    assert!(lines[2].contains("0.250") && lines[2].contains("global") && lines[3].contains("per-pixel"));
    assert_eq!(names_in(&output), ["flicker-chart.svg", "popping.csv", "popping.png"]);
    let csv = fs::read_to_string(output.join("popping.csv")).unwrap();
    assert!(csv.starts_with("\"step, °\",order,") && csv.lines().count() == 7, "{csv}");
    // Three columns and two rows of the whole picture, which is smaller than the part that would be
    // shown.
    assert_eq!(gs_io::read_image(output.join("popping.png")).unwrap().image.size(), (3 * 384 + 16, 2 * 320 + 8));
}

#[test]
fn popping_of_levels_is_measured_at_once_and_with_transitions() {
    let place = folder();
    let gaussian = |i: u16| {
        let t = f32::from(i);
        Gaussian3d {
            mean: Vec3::new((t * 0.618_034).fract(), (t * 0.754_877_7).fract(), (t * 0.569_84).fract()) * 4.0,
            log_scale: Vec3::splat(-2.5),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 2.0,
            sh: vec![Vec3::new(t.sin(), t.cos(), 0.0)],
        }
    };
    let (city, output) = (place.path().join("city/lod-meta.json"), place.path().join("out"));
    gs_io::write_3d(&city, &(0..500).map(gaussian).collect(), &gs_io::WriteOptions3d::default()).unwrap();
    let flags = ["--size", "48x40", "--places", "1", "--frames", "9", "--backend", "cpu", "--max-gaussians", "200"];
    let run = gs(["popping", text(&city), "-o", text(&output)].into_iter().chain(flags)).done();
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert!(lines[0].contains("500 Gaussians") && lines.len() == 8, "{}", run.stdout);
    assert!(lines[2].contains("at once") && lines[3].contains("transition"), "{}", run.stdout);
    let csv = fs::read_to_string(output.join("popping.csv")).unwrap();
    assert!(csv.starts_with("\"step, °\",levels,"), "{csv}");
}

/// Command, input, flags, status, and parts of the message.
type Case<'a> = (&'a str, &'a Path, &'a [&'a str], i32, &'a [&'a str]);

#[test]
fn impossible_measurements_are_refused_before_any_output() {
    let place = folder();
    let (scene, image, flat) = (faintly_shiny(place.path()), picture(place.path(), 16, 12), fitted(place.path()));
    let flat = Path::new(&flat);
    let output = place.path().join("out");
    let [in_text, absent, none] = ["text", "absent.png", "none.ply"].map(|name| place.path().join(name));
    fs::write(&in_text, "This is neither.\n").unwrap();
    let cases: [Case<'_>; 14] = [
        ("profile", &absent, &[], 1, &["absent.png", "no such file"]),
        ("profile", &in_text, &[], 1, &["text"]),
        ("profile", place.path(), &[], 1, &["holds no scene"]),
        ("profile", &scene, &["--size", "20000x20000"], 2, &["--size", "20000x20000"]),
        ("profile", flat, &["--camera", "data:1"], 2, &["is not a 3D scene"]),
        ("frontier", flat, &["--order", "global"], 2, &["leave out the flags for 3D scenes"]),
        ("frontier", &scene, &["--dataset", "/no/such"], 1, &["/no/such"]),
        ("popping", &scene, &["--order", "global"], 2, &["both orders are compared"]),
        ("popping", &scene, &["--step", "0"], 2, &["above 0"]),
        ("popping", &scene, &["--max-gaussians", "9"], 2, &["--max-gaussians", "levels of detail"]),
        ("popping", &scene, &["--size", "99999x9"], 2, &["--size"]),
        ("popping", &scene, &["--size", "16384x16384"], 2, &["pixels of a frame"]),
        ("popping", &none, &[], 1, &["none.ply"]),
        ("popping", &image, &[], 1, &["picture-16x12.png"]),
    ];
    for (command, input, flags, status, expected) in cases {
        let folder: &[&str] = if command == "profile" { &[] } else { &["-o", text(&output)] };
        let run = gs([command, text(input)].iter().chain(folder).chain(flags));
        assert_eq!(run.status, Some(status), "{command} {flags:?}: {run:?}");
        for part in expected {
            assert!(run.refusal().contains(part), "{part}: {run:?}");
        }
        assert!(!output.exists(), "{command} {flags:?}");
    }
    let run = gs(["effects", text(flat), "dataset"]);
    assert_eq!(run.status, Some(2), "{run:?}");
    assert!(run.refusal().contains("is not a 3D scene"), "{run:?}");
}
