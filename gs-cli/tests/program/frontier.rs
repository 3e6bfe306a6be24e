//! `gs frontier`: the table and the same numbers as files, the answer to a budget, which render and
//! fit take, and what it refuses.

use std::{
    fs,
    path::{Path, PathBuf},
};

use gs_core::{Gaussian3d, Scene3d};
use serde_json::Value;

use crate::process::{Run, folder, gs, names_in, picture};

/// Runs `gs frontier` as quickly as possible; times are not tested.
fn frontier(input: &Path, flags: &[&str]) -> Run {
    let always = ["frontier", input.to_str().unwrap(), "--backend", "cpu", "--seconds", "1", "--threads", "2"];
    gs(always.iter().chain(flags))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// A scene of a few Gaussians in front of each other, as a PLY file.
fn for_3d(place: &Path) -> PathBuf {
    let at = |i: u32| Gaussian3d {
        mean: glam::Vec3::new((i % 5) as f32 - 2.0, (i % 7) as f32 - 3.0, 0.3 * i as f32),
        log_scale: glam::Vec3::splat(-0.4),
        rotation: [1.0, 0.1, 0.2, 0.0],
        opacity_logit: 0.5,
        sh: vec![glam::Vec3::new(0.5, -0.2, 0.1 * (i % 9) as f32); 4],
    };
    let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
    (0..40).for_each(|i| gs_core::Scene::push(&mut scene, at(i)));
    let path = place.join("scene.ply");
    gs_io::write_3d(&path, &scene, &gs_io::WriteOptions3d::default()).unwrap();
    path
}

#[test]
fn a_picture_is_fitted_and_its_settings_are_priced() {
    let place = folder();
    let image = picture(place.path(), 48, 32);
    let output = place.path().join("out");
    let run = frontier(&image, &["-n", "30", "-o", output.to_str().unwrap()]).done();
    assert!(run.stderr.contains(" settings in ") && run.stderr.contains(" ms: about "), "{}", run.stderr);
    for expected in
        ["30 Gaussians, 48x32 px", "default, again", "3DGS", "no cut-offs", "alpha cut 1/512", "64-bit oracle"]
    {
        assert!(run.stdout.contains(expected), "{expected}: {}", run.stdout);
    }
    assert_eq!(names_in(&output), ["frontier.csv", "frontier.json", "frontier.png", "frontier.svg"]);
    let json: Value = serde_json::from_str(&fs::read_to_string(output.join("frontier.json")).unwrap()).unwrap();
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(fs::read_to_string(output.join("frontier.csv")).unwrap().lines().count(), rows.len() + 1);
    let role = |role: &str| rows.iter().find(|row| row["role"] == role).unwrap_or_else(|| panic!("no {role}"));
    assert!(number(&role("tightest")["error"]["max"]) < 1e-5);
    assert!(number(&role("default")["error"]["max"]) > number(&role("tightest")["error"]["max"]));
    assert!(rows.iter().any(|row| row["on-frontier"] == true));
    let levels = rows.iter().filter(|row| row["role"] == "alone" && row["changes"][0]["axis"] == "SIMD").count();
    assert_eq!(levels + 1, gs_cpu::SimdLevel::available().len());
}

#[test]
fn a_budget_is_answered_by_a_file_that_render_and_fit_take() {
    let place = folder();
    let image = picture(place.path(), 48, 32);
    let fit = place.path().join("fit");
    gs(["fit", image.to_str().unwrap(), "-o", fit.to_str().unwrap(), "-n", "30", "-i", "20", "--no-report"]).done();
    let (scene, output) = (fit.join("scene.gs2d.safetensors"), place.path().join("out"));
    let run = frontier(&scene, &["--max-error", "1/1000", "-o", output.to_str().unwrap()]).done();
    let file = output.join("settings.toml");
    assert_eq!(run.stdout.trim_end(), fs::read_to_string(&file).unwrap().trim_end());
    assert!(run.stdout.contains("# On 3 other views") && run.stdout.contains("[machine]"), "{}", run.stdout);
    let json: Value = serde_json::from_str(&fs::read_to_string(output.join("frontier.json")).unwrap()).unwrap();
    assert!(number(&json["answer"]["verification"]["error"]["max"]) <= 1e-3);

    let render = |name: &str, flags: &[&str]| {
        let png = place.path().join(name);
        let always = ["render", scene.to_str().unwrap(), "-o", png.to_str().unwrap()];
        gs(always.iter().chain(flags)).done();
        gs_io::read_image(&png).unwrap().image
    };
    let (usual, chosen) = (render("usual.png", &[]), render("chosen.png", &["--settings", file.to_str().unwrap()]));
    assert!(gs_core::metrics::psnr(&usual, &chosen).unwrap() > 35.0);
    // The file is used: a picture whose cut is half is empty.
    let coarse = place.path().join("coarse.toml");
    fs::write(
        &coarse,
        "[accuracy]\nalpha-cut = 0.5\n[machine]\nflags = [\"--backend\", \"cpu\", \"--simd\", \"baseline\"]\n",
    )
    .unwrap();
    let coarse_picture = render("coarse.png", &["--settings", coarse.to_str().unwrap()]);
    assert!(gs_core::metrics::psnr(&usual, &coarse_picture).unwrap() < 30.0);

    let again = place.path().join("again");
    let flags = ["-n", "30", "-i", "20", "--no-report", "--json", "--settings", coarse.to_str().unwrap()];
    let summary = gs(["fit", image.to_str().unwrap(), "-o", again.to_str().unwrap()].iter().chain(&flags)).json();
    assert_eq!(summary["simd"], "baseline", "{summary}");
    assert!(fs::read_to_string(again.join("settings.toml")).unwrap().contains("alpha-cut = 0.5"));
}

#[test]
fn the_frontier_of_a_3d_scene_chooses_order_and_sh() {
    let place = folder();
    let scene = for_3d(place.path());
    let json = frontier(&scene, &["--size", "60x40", "--views", "2", "--json"]).json();
    let axes: Vec<&str> =
        json["rows"].as_array().unwrap().iter().filter_map(|row| row["changes"][0]["axis"].as_str()).collect();
    for expected in ["order", "antialias", "SH degree", "full below", "extent", "tile rows", "exp", "bounds"] {
        assert!(axes.contains(&expected), "{expected}: {axes:?}");
    }
    assert_eq!(json["views"], 2);
    let run = frontier(&scene, &["--size", "60x40", "--max-ms", "1e5"]).done();
    let file = place.path().join("settings.toml");
    fs::write(&file, &run.stdout).unwrap();
    assert!(run.stdout.contains("[effects]"), "{}", run.stdout);
    let png = place.path().join("a.png");
    let [scene, png, file] = [&scene, &png, &file].map(|path| path.to_str().unwrap());
    let run = gs(["render", scene, "-o", png, "--size", "30x20", "--settings", file, "--verbose"]).done();
    assert!(run.stderr.contains("as in --settings"), "{}", run.stderr);
}

#[test]
fn what_cannot_be_is_refused() {
    let place = folder();
    let image = picture(place.path(), 16, 16);
    let scene = for_3d(place.path());
    for (input, flags, expected) in [
        (&image, &["--max-error", "0"][..], "positive number"),
        (&image, &["--max-error", "0.1", "--max-ms", "5"], "cannot be used with"),
        (&image, &["--order", "global"], "flags for 3D scenes"),
        (&scene, &["-n", "10"], "--gaussians"),
        (&scene, &["--dataset", "/no/such"], "/no/such"),
        (&scene, &["--size", "20000x20000"], "20000"),
    ] {
        let run = frontier(input, flags);
        assert!(run.refusal().contains(expected), "{flags:?}: {run:?}");
    }
    // Measurements are printed and written all the same, and no earlier answer stays beside them.
    let output = place.path().join("out");
    fs::create_dir(&output).unwrap();
    let budgeted = ["--size", "60x40", "-o", output.to_str().unwrap()];
    frontier(&scene, &[&budgeted[..], &["--max-ms", "1e5"]].concat()).done();
    assert!(output.join("settings.toml").exists());
    let run = frontier(&scene, &[&budgeted[..], &["--max-error", "1e-15"]].concat());
    assert_eq!(run.status, Some(1));
    assert!(run.stderr.lines().last().unwrap().contains("--max-error"), "{run:?}");
    assert!(run.stdout.contains("on the frontier"), "{run:?}");
    assert!(output.join("frontier.csv").exists() && !output.join("settings.toml").exists());
    let file = place.path().join("settings.toml");
    fs::write(&file, "[machine]\n[accuracy]\nalpha-cut = 9\n").unwrap();
    let run = gs(["render", scene.to_str().unwrap(), "-o", "a.png", "--settings", file.to_str().unwrap()]);
    assert!(run.refusal().contains("alpha-cut"), "{run:?}");
}
