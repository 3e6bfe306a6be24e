//! Behaviour of the program where its work needs more memory than there is, and how well it
//! estimates that beforehand. Only Linux reports both.
#![cfg(target_os = "linux")]

use std::{ffi::OsStr, fs, process::Command};

use gs_core::{Blend, Image, RenderSettings};
use gs_train::FitSettings;

use crate::{
    bad_input::png_without_pixels,
    process::{Run, command, folder, gs, picture},
    train::{dataset_and_scene, small, text},
};

/// Runs `gs` with this much address space, KiB, and few threads, as each reserves some.
fn gs_within<A: AsRef<OsStr>>(kib: u32, arguments: impl IntoIterator<Item = A>) -> Run {
    let program = command();
    let mut shell = Command::new("sh");
    shell.args(["-c", "ulimit -v \"$0\" && exec \"$@\"", &kib.to_string()]);
    shell.arg(program.get_program()).args(arguments).env("XDG_RUNTIME_DIR", std::env::temp_dir());
    Run::of(&mut shell)
}

const CPU: [&str; 4] = ["--backend", "cpu", "--threads", "2"];

#[test]
fn files_that_claim_more_memory_than_there_is_are_refused() {
    let place = folder();
    let (image, scene) = (place.path().join("large.png"), place.path().join("small.gs2d.safetensors"));
    fs::write(&image, png_without_pixels(16_384, 16_384)).unwrap();
    let (width, height, settings) = (16_384, 16_384, RenderSettings::blended(Blend::Sum));
    gs_io::write_2d(&scene, &gs_io::File2d { width, height, settings, ..Default::default() }).unwrap();
    let (image, scene) = (text(&image), text(&scene));
    let output = place.path().join("out");

    let refused = |kib: u32, arguments: &[&str], expected: [&str; 3]| {
        let run = gs_within(kib, arguments);
        let line = run.refusal();
        assert!(expected.iter().all(|part| line.contains(part)), "{line}");
        assert!(run.status == Some(1) && !output.exists(), "{run:?}");
    };
    let limit = "the address space that this process may have (ulimit -v)";
    for arguments in [["fit", image, "-o", text(&output)], ["eval", image, image, "--json"]] {
        let needs = "large.png (16384x16384 px): takes about 7.5 GB";
        refused(4_000_000, &arguments, [needs, limit, "take a smaller image"]);
    }
    let render = [&["render", scene, "-o", text(&output)][..], &CPU].concat();
    let size = "--size=16384x16384";
    for (arguments, takes) in [
        (vec!["effects", scene], "measuring the effects of "),
        (vec!["frontier", scene], "measuring the frontier of "),
        (vec!["profile", scene], "profiling "),
        (vec!["view", scene, size], "a picture of "),
    ] {
        refused(2_000_000, &[&arguments[..], &CPU].concat(), [takes, "16384x16384 px: takes about", "--size"]);
    }
    refused(3_000_000, &render, ["small.gs2d.safetensors of 16384x16384 px: takes about 3.3 GB", limit, "--size"]);
}

#[test]
fn a_shortage_of_memory_ends_in_one_line() {
    let place = folder();
    let image = place.path().join("photo.png");
    gs_io::write_png(&image, &Image::filled(768, 512, [0.5; 3]).unwrap()).unwrap();
    let output = place.path().join("out");
    let fit = [&["fit", text(&image), "-o", text(&output)][..], &CPU].concat();
    let run = gs_within(300_000, &fit);
    assert!(run.refusal().contains("fitting 9000 Gaussians to ") && run.status == Some(1), "{run:?}");

    let (dataset, _) = dataset_and_scene(place.path());
    let run = gs_within(300_000, small(&dataset, &output).into_iter().chain(["--threads", "2"]));
    let line = run.stderr.lines().last().unwrap();
    assert!(line.starts_with("error: training on ") && line.contains("(ulimit -v)"), "{run:?}");
    assert!(run.status == Some(1) && !output.exists(), "{run:?}");
}

/// Estimates are a little too high rather than too low, so that what is let through does not fail.
#[test]
fn estimates_are_near_what_runs_take() {
    let place = folder();
    let output = place.path().join("out");
    let summary = |arguments: &[&str]| {
        gs(arguments).done();
        let summary = fs::read_to_string(output.join("summary.json")).unwrap();
        serde_json::from_str::<serde_json::Value>(&summary).unwrap()
    };
    let near = |estimate: u64, summary: &serde_json::Value| {
        let peak = summary["peak_memory"].as_u64().unwrap();
        assert!((peak..2 * peak).contains(&estimate), "estimated {estimate} bytes, found {peak}");
    };
    let image = picture(place.path(), 1600, 1200);
    for flags in [["--loss", "l2", "--blend", "sum"], ["--loss", "l1-dssim", "--blend", "over"]] {
        let fit = [&["fit", text(&image), "-o", text(&output), "-n", "400", "-i", "2"][..], &flags, &CPU].concat();
        let found = summary(&fit);
        let settings: FitSettings = serde_json::from_value(found["settings"].clone()).unwrap();
        near(settings.peak_bytes((1600, 1200)), &found);
    }
}
