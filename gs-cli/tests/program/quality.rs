//! Quality that the program reports: figures of the files that it writes, and the reason where a
//! run ends early.

use std::fs;

use gs_core::Image;
use serde_json::Value;

use crate::{
    process::{folder, gs, picture},
    train::{dataset_and_scene, small, text},
};

#[test]
fn a_fit_and_a_comparison_of_its_files_name_the_same_figures() {
    let place = folder();
    let image = picture(place.path(), 192, 170);
    let output = place.path().join("out");
    let words = ["fit", text(&image), "-o", text(&output), "-n", "400", "-i", "150", "--no-report", "--backend", "cpu"];
    let run = gs(words).done();
    let summary: Value = serde_json::from_slice(&fs::read(output.join("summary.json")).unwrap()).unwrap();
    let written = output.join("reconstruction.png");
    let eval = gs(["eval", text(&written), text(&image), "--json"]).json();
    for key in ["psnr", "ssim", "ms_ssim", "l1"] {
        assert!(summary[key].is_number() && summary[key] == eval[key], "{key} of {summary} and of {eval}");
    }
    let [psnr, float] = ["psnr", "psnr_float"].map(|key| summary[key].as_f64().unwrap());
    assert!(psnr > 40.0 && float > psnr + 0.01, "{psnr} of the file, {float} of floats");
    assert!(run.stderr.contains(&format!("PSNR {psnr:.2} dB")), "{run:?}");
    let table = fs::read_to_string(output.join("metrics.csv")).unwrap();
    let last: f64 = table.lines().next_back().unwrap().split(',').nth(12).unwrap().parse().unwrap();
    assert!((last - psnr).abs() < 1e-3, "{last} in the table, {psnr}");
}

#[test]
fn flat_and_tiny_pictures_are_exact_or_nearly_so_by_default() {
    let place = folder();
    let fitted = |name: &str, image: Image| {
        let (path, output) = (place.path().join(name), place.path().join("out"));
        gs_io::write_png(&path, &image).unwrap();
        let words = ["fit", text(&path), "-o", text(&output), "--no-report", "--json", "--backend", "cpu"];
        let summary = gs(words).json();
        assert_eq!(summary["shortfall"], Value::Null, "{summary}");
        let exact = gs_io::read_image(output.join("reconstruction.png")).unwrap().image == image.rounded_to_8_bits();
        assert_eq!(summary["psnr"].is_null(), exact, "{summary}");
        (summary["psnr"].as_f64().unwrap_or(f64::INFINITY), exact)
    };
    for level in [255, 128, 3] {
        let flat = Image::filled(120, 80, [level as f32 / 255.0; 3]).unwrap();
        assert!(fitted("flat.png", flat).1, "level {level}");
    }
    let mixed = |x: u32, y: u32| [37, 101, 211].map(|k| ((x * x * k + y * 89 + x * y * 7) % 256) as f32 / 255.0);
    for size in [1, 3, 8] {
        let (psnr, _) = fitted("tiny.png", Image::from_fn(size, size.min(2), mixed).unwrap());
        assert!(psnr > 50.0, "{size}: {psnr}");
    }
}

#[test]
fn a_missed_budget_is_reported_in_2d_and_3d() {
    let place = folder();
    let image = picture(place.path(), 48, 40);
    let output = place.path().join("out");
    let words = ["fit", text(&image), "-o", text(&output), "--policy", "percentile", "--preset", "quick", "-n", "1000"];
    let run = gs(words.into_iter().chain(["--backend", "cpu", "--no-report"])).done();
    let expected = "note: the run ends with 130 Gaussians of 1000: policy `percentile` turned the initial 80 into 130 in 5 rounds, \
                    10.2 % more in each";
    assert!(run.stderr.contains(expected), "{}", run.stderr);
    let summary: Value = serde_json::from_slice(&fs::read(output.join("summary.json")).unwrap()).unwrap();
    assert_eq!((&summary["shortfall"]["gaussians"], &summary["shortfall"]["budget"]), (&130.into(), &1000.into()));

    let (dataset, start) = dataset_and_scene(place.path());
    let output = place.path().join("scene");
    let words = ["train", text(&dataset), "-o", text(&output), "-i", "40", "--preset", "mcmc", "-n", "300"];
    let run = gs(words.into_iter().chain(["--start", text(&start), "--no-report", "--backend", "cpu"])).done();
    assert!(run.stderr.contains("of 300: policy `mcmc` turned the initial "), "{}", run.stderr);
}

#[test]
fn a_training_reports_the_quality_of_held_out_and_of_training_views() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("scene");
    // The images that are held out show something else.
    for held_out in ["images/0.png", "images/4.png"] {
        gs_io::write_png(dataset.join(held_out), &Image::filled(32, 24, [1.0, 0.9, 0.8]).unwrap()).unwrap();
    }
    let run = gs(small(&dataset, &output).into_iter().chain(["--holdout", "4", "--no-report"])).done();
    let summary: Value = serde_json::from_slice(&fs::read(output.join("summary.json")).unwrap()).unwrap();
    let training = summary["training"]["psnr"].as_f64().unwrap();
    assert_eq!(summary["training"]["views"], 2);
    assert!(
        run.stderr.contains(&format!("2 held-out views, PSNR {training:.2} dB over 2 views that it was trained with"))
    );
    let apart = training - summary["evaluation"]["psnr"].as_f64().unwrap();
    assert!(apart > 3.0, "{summary}");
    let expected = format!("note: the scene fits the training views {apart:.1} dB better than the held-out views");
    assert!(run.stderr.contains(&expected), "{}", run.stderr);
}
