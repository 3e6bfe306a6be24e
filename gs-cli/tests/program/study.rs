//! `gs study` from end to end: killed and resumed, and refused where it is not possible.

use std::{
    collections::BTreeMap,
    fs,
    hash::{BuildHasher, RandomState},
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use gs_conformance::posed::{small_scene, write_dataset};

use crate::{
    process::{Run, command, folder, gs, names_in, picture},
    train::rasterizer,
};

pub(crate) const STUDY: &str = "name = 'small'\nquestion = 'Does growth help?'\nimages = ['paper', 'picture-32x24.png']\nbudgets = [40]\n\
    seeds = [0, 1, 2]\npreset = 'paper'\niterations = 60\n[settings]\nrounds = { every = 10, from = 10, until = 50 }\n\
    [[arm]]\nname = 'none'\nsettings.policy.kind = 'none'\n\
    [[arm]]\nname = 'percentile'\nsettings.policy = { kind = 'percentile', percent = 50 }\n";

/// A folder with a study and its image; the study's file.
pub(crate) fn study(place: &Path) -> PathBuf {
    picture(place, 32, 24);
    let file = place.join("small.toml");
    fs::write(&file, STUDY).unwrap();
    file
}

fn arguments<'a>(study: &'a Path, output: &'a Path) -> Vec<&'a str> {
    vec!["study", study.to_str().unwrap(), "-o", output.to_str().unwrap(), "--backend", "cpu"]
}

/// What must be the same however a study was run.
pub(crate) fn tables(output: &Path) -> BTreeMap<&'static str, String> {
    let names = ["runs.csv", "quality.csv", "differences.csv", "study.toml"];
    names.map(|name| (name, fs::read_to_string(output.join(name)).unwrap())).into()
}

#[test]
fn a_study_killed_at_random_resumes_to_the_same_tables() {
    let place = folder();
    let file = study(place.path());
    let (whole, killed) = (place.path().join("whole"), place.path().join("killed"));
    let started = std::time::Instant::now();
    gs(arguments(&file, &whole)).done();
    let length = started.elapsed();

    let mut kills = 0;
    for attempt in 0..4 {
        // A part of the whole time, different in each run.
        let part = (RandomState::new().hash_one(attempt) % 1000) as u32;
        let mut child = command().args(arguments(&file, &killed)).arg("--resume").spawn().unwrap();
        thread::sleep(length * part / 1500 + Duration::from_millis(1));
        // SIGKILL on Unix.
        child.kill().unwrap();
        kills += usize::from(!child.wait().unwrap().success());
        for name in killed.join("runs").read_dir().into_iter().flatten().flatten().map(|entry| entry.path()) {
            let json = name.extension().is_some_and(|extension| extension == "json");
            let text = fs::read_to_string(&name).unwrap_or_default();
            assert!(!json || serde_json::from_str::<serde_json::Value>(&text).is_ok(), "{} is whole", name.display());
        }
    }
    assert!(kills > 0, "no moment of four was before the end");
    let resumed = gs(arguments(&file, &killed).into_iter().chain(["--resume", "--jobs", "2"])).done();
    assert_eq!(tables(&killed), tables(&whole), "{resumed:?}");
    // A file that was being written when its process was killed stays for one lease: another machine
    // might be writing it.
    let records = |folder: &Path| {
        let names = names_in(&folder.join("runs")).into_iter();
        names.filter(|name| !name.starts_with(".gs-")).collect::<Vec<_>>()
    };
    assert_eq!(records(&killed), records(&whole));
}

#[test]
fn a_study_leaves_tables_a_report_and_settings_that_repeat_its_runs() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out");
    let run = gs(arguments(&file, &output).into_iter().chain(["--jobs", "2"])).done();
    assert!(run.stdout.contains("40 Gaussians, after equal iterations: percentile leads with "), "{run:?}");
    assert!(run.stderr.contains("12 runs (2 arms, 2 images, 1 budget, 3 seeds), 2 side by side"), "{run:?}");
    assert!(run.stderr.contains("12/12 runs  0 running  0 s left"), "{run:?}");
    assert!(run.stdout.contains("no verdict, because 2 images are too few (an interval needs 6)"), "{run:?}");
    let page = fs::read_to_string(output.join("report.html")).unwrap();
    assert!(page.contains(&format!("gs study {} -o {} --jobs 2 --backend cpu", file.display(), output.display())));

    assert!(page.contains(" --backend cpu --simd "), "what the machine has decided");
    let files = output.join("runs").read_dir().unwrap().map(|entry| entry.unwrap().path());
    let mut records = files
        .filter(|path| path.extension().is_some_and(|extension| extension == "json"))
        .map(|path| serde_json::from_str::<serde_json::Value>(&fs::read_to_string(path).unwrap()).unwrap());
    let record = records.find(|record| record["image"] != "paper").unwrap();
    let (settings, fitted) = (place.path().join("run.toml"), place.path().join("fit"));
    fs::write(&settings, record["settings"].as_str().unwrap()).unwrap();
    let image = place.path().join("picture-32x24.png");
    let fit = [image.to_str().unwrap(), "-o", fitted.to_str().unwrap(), "--settings", settings.to_str().unwrap()];
    gs(["fit", "--backend", "cpu"].iter().chain(&fit)).done();
    let summary: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(fitted.join("summary.json")).unwrap()).unwrap();
    assert_eq!(summary["psnr"], record["outcome"]["psnr"], "{record}");
}

#[test]
fn parts_of_a_study_add_up_to_the_whole() {
    let place = folder();
    let file = study(place.path());
    let (whole, parts) = (place.path().join("whole"), place.path().join("parts"));
    gs(arguments(&file, &whole)).done();
    let part = |flags: &[&str]| gs(arguments(&file, &parts).iter().chain(flags));
    let first = part(&["--images", "paper", "--seeds", "0,2", "--arms", "none"]).done();
    assert!(
        first.stderr.contains("small: 2 of 12 runs (1 arm, 1 image, 1 budget, 2 seeds), 1 side by side"),
        "{first:?}"
    );
    let page = fs::read_to_string(parts.join("report.html")).unwrap();
    assert!(page.contains(" --images paper --seeds 0,2 --arms none -o "), "the command is in the report");
    assert_eq!(names_in(&parts.join("runs")).len(), 2);
    assert!(part(&["--seeds", "1"]).refusal().contains("go on with it with --resume"));
    part(&["--resume", "--images", "picture-32x24", "--budgets", "40"]).done();
    assert_eq!(names_in(&parts.join("runs")).len(), 8);
    part(&["--resume"]).done();
    assert_eq!(tables(&parts), tables(&whole));
    for (flags, expected) in [
        (["--arms", "none,hybrid"], "there is no arm `hybrid`: it has none, percentile"),
        (["--images", "kodim04"], "there is no image `kodim04`: it has paper, picture-32x24.png"),
        (["--seeds", "3"], "there is no seed `3`: it has 0, 1, 2"),
        (["--budgets", "-4"], "must be at least 1"),
    ] {
        let run = part(&flags);
        assert!(run.refusal().contains(expected) && run.status == Some(2), "{flags:?}: {run:?}");
    }
    let help = gs(["study", "--help"]).done().stdout;
    assert!(
        help.contains("--arms <NAMES>") && help.contains("[[arm]]") && help.contains("settings.policy.percent = 5")
    );
}

const STUDY_3D: &str = "name = 'small-3d'\nscenes = ['one', 'two']\nbudgets = [120]\nseeds = [0, 1]\npreset = 'quick'\n\
    iterations = 60\n[dataset]\nholdout = 4\n[settings]\nexactly = true\nrender.effects.sh-degree = 1\n\
    [[factor]]\nname = 'start'\nlevel = [{ name = 'points', start = 'points' }, { name = 'random', start = 'random' }]\n\
    [[factor]]\nname = 'policy'\nlevel = [{ name = 'absolute', policy = 'absolute' }, { name = 'mcmc', policy = 'mcmc' }]\n";

#[test]
fn a_study_of_scenes_is_killed_and_resumed_like_one_of_images() {
    let place = folder();
    let data = place.path().join("data");
    for (variant, name) in ["one", "two"].into_iter().enumerate() {
        write_dataset(&data.join(name), &small_scene(variant as u32), &rasterizer(), true).unwrap();
    }
    let file = place.path().join("small-3d.toml");
    fs::write(&file, STUDY_3D).unwrap();
    let (whole, killed) = (place.path().join("whole"), place.path().join("killed"));
    let with = |output: &Path, flags: &[&str]| {
        let words = ["--data", data.to_str().unwrap()];
        let all: Vec<String> =
            arguments(&file, output).iter().chain(&words).chain(flags).map(|w| w.to_string()).collect();
        all
    };
    let started = std::time::Instant::now();
    let run = gs(with(&whole, &[])).done();
    let length = started.elapsed();
    assert!(run.stderr.contains("16 runs (4 arms, 2 scenes, 1 budget, 2 seeds)"), "{run:?}");
    assert!(run.stdout.contains("2 seeds on 2 scenes are too few (an interval needs 4 seeds, or 6 scenes)"), "{run:?}");

    let mut child = command().args(with(&killed, &[])).spawn().unwrap();
    thread::sleep(length / 3);
    child.kill().unwrap();
    child.wait().unwrap();
    gs(with(&killed, &["--resume", "--jobs", "2"])).done();
    assert_eq!(tables(&killed), tables(&whole));
    for name in ["views.csv", "effects.csv"] {
        let text = |folder: &Path| fs::read_to_string(folder.join(name)).unwrap();
        assert_eq!(text(&killed), text(&whole));
    }

    // A part by its scenes; without all arms there are no effects.
    let part = place.path().join("part");
    let flags = ["--scenes", "two", "--arms", "points+absolute,random+mcmc", "--seeds", "1"];
    let run = gs(with(&part, &flags)).done();
    assert!(run.stderr.contains("2 of 16 runs") && !part.join("effects.csv").exists(), "{run:?}");
    let refused = gs(with(&part, &["--resume", "--images", "one"]));
    assert!(refused.refusal().contains("there is no image `one`: it has none"), "{refused:?}");
    let lost = gs(with(&place.path().join("lost"), &["--scenes", "two"]).iter().map(|w| w.replace("/data", "/dat")));
    assert!(lost.refusal().contains("two: no such data set in ") && lost.status == Some(1), "{lost:?}");
}

#[test]
fn the_folder_of_images_is_in_the_report_wherever_it_was_named() {
    let place = folder();
    let file = study(place.path());
    let (elsewhere, output) = (place.path().join("images"), place.path().join("out"));
    fs::create_dir(&elsewhere).unwrap();
    fs::rename(place.path().join("picture-32x24.png"), elsewhere.join("picture-32x24.png")).unwrap();
    Run::of(command().args(arguments(&file, &output)).env("GS_DATA", &elsewhere)).done();
    let page = fs::read_to_string(output.join("report.html")).unwrap();
    assert!(page.contains(&format!(" --data {}", elsewhere.display())));
}

#[test]
fn a_study_of_which_every_run_fails_has_failed() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out");
    let diverging = STUDY.replace("[settings]", "[settings]\nadam.color.learning-rate = 1e38");
    fs::write(&file, diverging).unwrap();
    let run = gs(arguments(&file, &output));
    let last = run.stderr.lines().last().unwrap();
    assert!(run.status == Some(1) && run.stdout.is_empty(), "{run:?}");
    assert!(last.starts_with("error: small: all 12 runs failed, the first since the training diverged"), "{last}");
    assert!(last.ends_with(&format!("see {}", output.join("runs.csv").display())), "{last}");
    assert!(fs::read_to_string(output.join("report.html")).unwrap().contains("Runs that failed"));
}

#[test]
fn a_study_that_another_version_began_is_resumed_with_a_word_about_it() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out");
    gs(arguments(&file, &output)).done();
    let resume = || gs(arguments(&file, &output).iter().chain(&["--resume"])).done().stderr;
    assert!(!resume().contains("note: "), "the same version");
    let machine = output.join("machine.json");
    let text = fs::read_to_string(&machine).unwrap();
    fs::write(&machine, text.replace("\"version\": \"0.1", "\"version\": \"0.0")).unwrap();
    let said = resume();
    assert!(said.contains(": is a study by version 0.0") && said.contains(", so its runs are done again"), "{said}");
    assert_eq!(fs::read_to_string(&machine).unwrap(), text, "it is a study of this version now");
}

#[test]
fn a_folder_may_have_the_name_of_the_study_whose_results_it_holds() {
    let place = folder();
    let prepare = |flags: &[&str]| {
        let mut command = command();
        command.current_dir(place.path()).args(["study", "prepare", "edges", "-o", "edges", "--backend", "cpu"]);
        Run::of(command.args(flags)).done().stdout
    };
    let first = prepare(&[]);
    assert!(first.starts_with("edges: "), "{first}");
    assert_eq!(prepare(&["--resume"]), first);
}

#[test]
fn invalid_studies_are_refused_in_one_line_before_any_work() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out");
    let with = |from: &str, to: &str| {
        let other = place.path().join("other.toml");
        fs::write(&other, STUDY.replace(from, to)).unwrap();
        gs(arguments(&other, &output))
    };
    for (from, to, status, expected) in [
        ("percent = 50", "percentage = 50", 2, "arm `percentile`: settings: unknown key `percentage` in [policy]"),
        ("picture-32x24.png", "absent.png", 1, "absent.png: no such file in "),
    ] {
        let run = with(from, to);
        let line = run.refusal();
        assert!(line.contains(expected) && run.status == Some(status), "{to}: {line}");
        assert!(!output.exists(), "{to}");
    }
    let line = |words: &[&str]| gs(["study"].iter().chain(words)).refusal().to_owned();
    assert!(line(&["all-policy"]).contains(
        "those are set-up, cold-start, lazy-convergence, thresholds, instability, edges, absolute-vs-percentile, \
         all-policies, accuracy-in-training, density-in-3d, init-by-density, accuracy-in-3d-training, \
         start-without-sfm, defaults"
    ));
    assert!(line(&["no/such.toml"]).contains("no/such.toml: there is no such file"));
    assert!(line(&[place.path().to_str().unwrap()]).contains("is a folder: name the TOML file of a study"));
    assert!(line(&["status", place.path().to_str().unwrap()]).contains("holds no study"));
    gs(arguments(&file, &output)).done();
    assert!(gs(arguments(&file, &output)).refusal().contains("holds a study already: go on with it with --resume"));
}
