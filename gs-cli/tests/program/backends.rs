//! Choosing what computes. The wgpu backend needs an adapter; a software driver will do, and
//! `cargo xtask test` installs one.

use std::path::Path;

use gs_core::metrics;
use serde_json::{Value, json};

use crate::process::{Run, command, folder, gs, picture};

/// The names of this machine's adapters.
fn adapters() -> Vec<String> {
    let found = gs(["info", "--adapters", "--json"]).json();
    let names: Vec<String> =
        found["adapters"].as_array().unwrap().iter().map(|a| a["name"].as_str().unwrap().to_owned()).collect();
    assert!(!names.is_empty(), "`cargo xtask test` installs a software driver where there is no adapter");
    names
}

/// A fit of the image that needs no file: 30 steps of 50 Gaussians.
fn fit_with(output: &Path, flags: &[&str]) -> Run {
    let arguments = ["fit", "-o", output.to_str().unwrap(), "-n", "50", "--iterations", "30", "--no-report", "--json"];
    gs(arguments.iter().chain(flags))
}

/// Runs `gs` where no graphics driver can be found.
#[cfg(target_os = "linux")]
fn without_drivers(arguments: &[&str]) -> Run {
    let mut command = command();
    command.env("VK_DRIVER_FILES", "/no/such/driver.json").env("VK_ICD_FILENAMES", "/no/such/driver.json");
    Run::of(command.args(arguments))
}

#[test]
fn a_fit_on_wgpu_ends_near_that_on_the_cpu() {
    let place = folder();
    let (on_cpu, on_wgpu) = (place.path().join("cpu"), place.path().join("wgpu"));
    let cpu = fit_with(&on_cpu, &["--backend", "cpu"]).json();
    let run = fit_with(&on_wgpu, &["--backend", "wgpu", "--threads", "1"]);
    assert!(run.stderr.starts_with("wgpu (") && run.stderr.contains("): as requested, "), "{}", run.stderr);
    let wgpu = run.json();
    assert_eq!((&cpu["backend"], &cpu["adapter"]), (&json!("cpu"), &Value::Null));
    assert_eq!((&wgpu["backend"], &wgpu["threads"], &wgpu["simd"]), (&json!("wgpu"), &json!(1), &Value::Null));
    assert_eq!(wgpu["adapter"], adapters()[0], "the first is taken");
    assert_eq!(wgpu["gaussians"], cpu["gaussians"]);
    let gap = wgpu["psnr"].as_f64().unwrap() - cpu["psnr"].as_f64().unwrap();
    assert!(gap.abs() < 0.01, "{gap} dB");

    let image = |folder: &Path| gs_io::read_image(folder.join("reconstruction.png")).unwrap().image;
    let apart = metrics::psnr(&image(&on_cpu), &image(&on_wgpu)).unwrap();
    assert!(apart > 60.0, "{apart} dB apart");
}

#[test]
fn a_scene_looks_the_same_on_wgpu_as_on_the_cpu() {
    let place = folder();
    fit_with(place.path(), &["--backend", "cpu"]).done();
    let scene = place.path().join("scene.gs2d.safetensors");
    let render = |flags: &[&str]| {
        let png = place.path().join("rendered.png");
        gs(["render", scene.to_str().unwrap(), "-o", png.to_str().unwrap()].iter().chain(flags)).done();
        gs_io::read_image(&png).unwrap().image
    };
    let on_cpu = render(&["--backend", "cpu"]);
    let apart = metrics::psnr(&on_cpu, &render(&["--backend", "wgpu"])).unwrap();
    assert!(apart > 70.0, "{apart} dB: 8-bit pictures of one scene differ by rounding only");
    let other = render(&["--backend", "wgpu", "--region", "1,0,128,128"]);
    assert!(metrics::psnr(&on_cpu, &other).unwrap() < 50.0, "a shifted one differs by more");
}

#[test]
fn a_checkpoint_of_wgpu_is_resumed_on_the_cpu_and_the_other_way_round() {
    let place = folder();
    let image = picture(place.path(), 24, 24);
    let (whole, resumed, state) =
        (place.path().join("whole"), place.path().join("resumed"), place.path().join("state"));
    let (image, state) = (image.to_str().unwrap(), state.to_str().unwrap());
    for (first, then) in [("wgpu", "cpu"), ("cpu", "wgpu")] {
        let begin = ["fit", image, "-o", whole.to_str().unwrap(), "-n", "40", "--iterations", "20", "--json"];
        let flags = ["--no-report", "--backend", first, "--checkpoint", state, "--checkpoint-every", "8"];
        let before = gs(begin.into_iter().chain(flags)).json();
        assert_eq!(gs(["info", state, "--json"]).json()["gaussians"], before["gaussians"]);
        let go_on = ["fit", image, "-o", resumed.to_str().unwrap(), "--resume", state, "--no-report", "--json"];
        let after = gs(go_on.into_iter().chain(["--backend", then])).json();
        assert_eq!((&after["backend"], &after["iterations"]), (&json!(then), &json!(20)));
        let gap = before["psnr"].as_f64().unwrap() - after["psnr"].as_f64().unwrap();
        assert!(gap.abs() < 0.5, "{first} then {then}: {gap} dB");
    }
}

#[test]
fn a_wgpu_adapter_is_chosen_by_a_part_of_its_name() {
    let place = folder();
    let name = &adapters()[0];
    let part: String = name.chars().take(5).collect::<String>().to_uppercase();
    for flags in [&["--adapter", &part][..], &["--adapter", &part, "--backend", "wgpu"]] {
        let run = fit_with(place.path(), flags);
        assert!(run.stderr.contains(&format!("its name contains \"{part}\"")), "{}", run.stderr);
        assert_eq!(run.json()["adapter"], *name);
    }
}

/// Flags that end a fit before it begins, and parts of what is said about them.
fn are_bad_usage(cases: &[(&[&str], &[&str])]) {
    let place = folder();
    let output = place.path().join("out");
    for (flags, expected) in cases {
        let run = fit_with(&output, flags);
        assert_eq!(run.status, Some(2), "{flags:?}: {run:?}");
        let line = run.refusal();
        assert!(expected.iter().all(|part| line.contains(part)), "{flags:?}: {line}");
        assert!(!output.exists(), "{flags:?}");
    }
}

#[test]
fn flags_that_contradict_each_other_are_bad_usage() {
    are_bad_usage(&[(&["--backend", "cpu", "--adapter", "x"], &["--adapter x is for --backend wgpu", "leave out"])]);
}

#[test]
fn a_wgpu_adapter_that_is_not_there_is_bad_usage() {
    let name = &adapters()[0];
    let expected: &[&str] = &["--adapter no such: no adapter", "choose from", name];
    are_bad_usage(&[(&["--adapter", "no such"], expected), (&["--backend", "wgpu", "--adapter", "no such"], expected)]);
}

#[test]
fn the_choice_of_auto_is_printed_with_its_reason() {
    let place = folder();
    let found = gs(["info", "--adapters", "--json"]).json();
    let gpu = found["adapters"].as_array().unwrap().iter().any(|adapter| adapter["kind"] != "CPU");
    let auto = &found["auto"];
    assert!(gpu || auto["backend"] == "cpu", "a software driver is no GPU: {found}");
    for flags in [&[][..], &["--backend", "auto"]] {
        let run = fit_with(place.path(), flags);
        assert_eq!(run.stderr.lines().next(), auto["reason"].as_str(), "{}", run.stderr);
        let summary = run.json();
        assert_eq!((&summary["backend"], &summary["adapter"]), (&auto["backend"], &auto["adapter"]));
    }
    let simd = fit_with(place.path(), &["--simd", "baseline"]);
    assert!(
        simd.stderr.starts_with("cpu (baseline, ") && simd.stderr.contains(": as --simd asks, "),
        "{}",
        simd.stderr
    );
}

#[test]
fn wgpu_adapters_are_listed_in_place_of_a_file() {
    let found = gs(["info", "--adapters", "--json"]).json();
    for adapter in found["adapters"].as_array().unwrap() {
        for key in ["name", "kind", "interface", "driver"] {
            assert!(adapter[key].as_str().is_some_and(|text| !text.is_empty()), "{key} of {adapter}");
        }
    }
    assert_eq!(found["advice"], Value::Null);
    let text = gs(["info", "--adapters"]).done().stdout;
    let names = adapters();
    assert_eq!(text.lines().count(), names.len() + 1, "{text}");
    assert!(text.lines().zip(&names).all(|(line, name)| line.starts_with(name.as_str())), "{text}");
    let reason = found["auto"]["reason"].as_str().unwrap();
    assert_eq!(text.lines().last(), Some(format!("--backend auto takes {reason}").as_str()));
}

#[test]
fn info_describes_files_or_adapters_but_not_both() {
    for wrong in [&["info"][..], &["info", "--json"], &["info", "some.file", "--adapters"]] {
        let run = gs(wrong);
        assert_eq!(run.status, Some(2), "{run:?}");
        run.refusal();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn without_drivers_wgpu_gives_advice_and_auto_uses_the_cpu() {
    let place = folder();
    let output = place.path().join("out");
    let fit = ["fit", "-o", output.to_str().unwrap(), "-n", "20", "--iterations", "5", "--no-report"];
    for flags in [&["--backend", "wgpu"][..], &["--adapter", "x"]] {
        let run = without_drivers(&[&fit[..], flags].concat());
        assert_eq!(run.status, Some(1), "{run:?}");
        assert!(run.refusal().contains("no adapter was found") && run.refusal().contains("install"), "{run:?}");
        assert!(!output.exists());
    }
    let auto = without_drivers(&fit).done();
    assert!(auto.stderr.starts_with("cpu ("), "{auto:?}");

    let listed = without_drivers(&["info", "--adapters", "--json"]).json();
    assert_eq!((&listed["adapters"], &listed["auto"]["backend"]), (&json!([]), &json!("cpu")));
    assert!(listed["advice"].as_str().unwrap().contains("install"), "{listed}");
    let text = without_drivers(&["info", "--adapters"]).done().stdout;
    assert!(text.starts_with("no adapter was found") && text.lines().count() == 2, "{text}");
}

#[test]
fn the_environment_says_how_many_threads_unless_a_flag_does() {
    let place = folder();
    let fit = |variable: &str, flags: &[&str]| {
        let always = ["fit", "-o", place.path().to_str().unwrap(), "-n", "20", "-i", "2", "--no-report", "--json"];
        Run::of(command().env("RAYON_NUM_THREADS", variable).args(always).args(["--backend", "cpu"]).args(flags))
    };
    let run = fit("3", &[]);
    assert!(run.stderr.contains("threads as RAYON_NUM_THREADS says"), "{run:?}");
    assert_eq!(run.json()["threads"], 3);
    assert_eq!(fit("3", &["--threads", "2"]).json()["threads"], 2);
    assert!(fit("many", &[]).refusal().contains("RAYON_NUM_THREADS is `many`, but must be a whole number"));
}
