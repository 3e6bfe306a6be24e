//! `gs train`, and `gs render` and `gs eval` of 3D scenes, from end to end.

use std::process::Child;
use std::{
    fs,
    path::{Path, PathBuf},
    process::Stdio,
};

use gs_conformance::posed::{small_scene, write_dataset};
use gs_core::{Scene as _, Scene3d, effects::Antialias};
use gs_cpu::{CpuRasterizer, CpuSettings};
use serde_json::{Value, json};

#[cfg(unix)]
use crate::process::signal;
use crate::process::{Run, command, folder, gs, names_in};

/// The scene of the tests.
fn scene() -> Scene3d {
    small_scene(0)
}

/// A rasterizer on one thread.
pub(crate) fn rasterizer() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(1);
        s.level = None;
    }))
    .unwrap()
}

/// Writes eight images of the scene on black as a Nerfstudio data set, and the scene
/// itself.
pub(crate) fn dataset_and_scene(place: &Path) -> (PathBuf, PathBuf) {
    let (dataset, file) = (place.join("dataset"), place.join("true.ply"));
    gs_io::write_3d(&file, &scene(), &gs_io::WriteOptions3d::default()).unwrap();
    write_dataset(&dataset, &scene(), &rasterizer(), false).unwrap();
    (dataset, file)
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A short training of few Gaussians, on the processor.
pub(crate) fn small<'a>(dataset: &'a Path, output: &'a Path) -> Vec<&'a str> {
    let words =
        ["-i", "40", "-n", "300", "--policy", "percentile", "--sh-degree", "1", "--seed", "7", "--backend", "cpu"];
    [&["train", text(dataset), "-o", text(output)], &words[..]].concat()
}

#[test]
fn without_points_the_images_are_searched() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let words = ["train", text(&dataset), "-o", text(&output), "-i", "1", "-n", "300", "--no-report"];
    let run = gs(words.into_iter().chain(["--backend", "cpu"]));
    assert!(run.stderr.contains("points found in the images"), "{}", run.stderr);
    let run = gs(words.into_iter().chain(["--backend", "cpu", "--start", "points"]));
    assert!(run.status == Some(2) && run.stderr.contains("--start images"), "{}", run.stderr);
}

#[test]
fn few_points_are_joined_by_those_of_the_images() {
    let place = folder();
    let (dataset, output) = (place.path().join("dataset"), place.path().join("out"));
    write_dataset(&dataset, &scene(), &rasterizer(), true).unwrap();
    let train = |flags: &[&str]| {
        let words = ["train", text(&dataset), "-o", text(&output), "-i", "1", "--no-report", "--backend", "cpu"];
        gs(words.iter().chain(flags)).done().stderr
    };
    let joined = "points of the data set and ";
    let few = train(&["-n", "3000"]);
    assert!(few.contains(joined) && few.contains(" found in the images"), "{few}");
    for flags in [["-n", "20"], ["--start", "points"], ["--preset", "3dgs"]] {
        let enough = train(&flags);
        assert!(!enough.contains(joined) && enough.contains(" points, with at most "), "{enough}");
    }
}

#[test]
fn a_time_limit_chooses_settings_and_keeps_them() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let train = |minutes: &'static str| {
        gs(["train", text(&dataset), "-o", text(&output), "--backend", "cpu", "-n", "300", "--minutes", minutes])
    };
    let run = train("0.2");
    assert_eq!(run.status, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("after a trial of") && run.stderr.contains("with 300 Gaussians"), "{}", run.stderr);
    let summary: Value = serde_json::from_str(&fs::read_to_string(output.join("summary.json")).unwrap()).unwrap();
    assert!(summary["total_seconds"].as_f64().unwrap() < 12.5, "{summary}");
    assert_eq!(summary["split"], serde_json::json!({"every": 8}));
    for (minutes, expected) in [("0", "above 0"), ("1e-9", "too short")] {
        let run = train(minutes);
        assert!(run.status == Some(2) && run.stderr.contains(expected), "{}", run.stderr);
    }
}

#[test]
fn a_data_set_becomes_a_scene_and_a_summary() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("made/on/demand");
    let run = gs(small(&dataset, &output).into_iter().chain(["--holdout", "4", "--json"]));
    assert!(run.stderr.contains("training on 6 of 8 views"), "{}", run.stderr);
    let summary = run.json();
    for (key, expected) in [("iterations", 40), ("train_views", 6), ("test_views", 2), ("seed", 7)] {
        assert_eq!(summary[key], expected, "{key} of {summary}");
    }
    assert!(summary["gaussians"].as_u64().is_some_and(|count| (1..=300).contains(&count)), "{summary}");
    assert_eq!(summary["evaluation"]["views"].as_array().unwrap().len(), 2);
    assert!(summary["evaluation"]["psnr"].as_f64().unwrap() > 12.0, "{summary}");
    let expected =
        ["curve.svg", "evaluation.json", "metrics.csv", "scene.ply", "settings.toml", "summary.json", "views"];
    assert_eq!(names_in(&output), expected);
    assert_eq!(names_in(&output.join("views")), ["images_0.png", "images_4.png"]);
    assert_eq!(gs_io::read_image(output.join("views/images_0.png")).unwrap().image.size(), (68, 24));
    let evaluation: Value = serde_json::from_slice(&fs::read(output.join("evaluation.json")).unwrap()).unwrap();
    assert_eq!(evaluation, summary["evaluation"]);
    let metrics = fs::read_to_string(output.join("metrics.csv")).unwrap();
    assert!(metrics.lines().next_back().unwrap().starts_with("40,"), "{metrics}");
    let read = gs_io::read_3d(output.join("scene.ply")).unwrap().scene;
    assert_eq!((read.len() as u64, read.sh_degree), (summary["gaussians"].as_u64().unwrap(), 1));

    // The results can be evaluated, and the same settings give the same scene.
    let again = place.path().join("again");
    let settings = output.join("settings.toml");
    let words = ["train", text(&dataset), "-o", text(&again), "--holdout", "4", "--settings", text(&settings)];
    gs(words.into_iter().chain(["--no-report"])).done();
    assert_eq!(fs::read(again.join("scene.ply")).unwrap(), fs::read(output.join("scene.ply")).unwrap());
    assert!(!names_in(&again).contains(&"views".to_owned()));
    let scene = output.join("scene.ply");
    let judged = gs(["eval", text(&scene), text(&dataset), "--holdout", "4", "--json"]).json();
    let difference = judged["psnr"].as_f64().unwrap() - evaluation["psnr"].as_f64().unwrap();
    assert!(difference.abs() < 1e-3, "{judged} {evaluation}");
}

/// A training under way that would not end by itself.
#[cfg(unix)]
fn endless(dataset: &Path, output: &Path, flags: &[&str]) -> Child {
    let words = ["train", text(dataset), "-o", text(output), "-i", "1000000", "-n", "300", "--start", "random", "-v"];
    let child = command().args(words).args(flags).stderr(Stdio::piped()).spawn().unwrap();
    // The training makes steps as soon as its table exists.
    while !output.join("metrics.part.csv").exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    std::thread::sleep(std::time::Duration::from_millis(500));
    child
}

/// Interrupts it; its status and what it said.
#[cfg(unix)]
fn interrupted(child: Child) -> (Option<i32>, String) {
    signal(&child, "-INT", 1);
    let ended = child.wait_with_output().unwrap();
    (ended.status.code(), String::from_utf8(ended.stderr).unwrap())
}

/// The obstacle is put in the way of results after the training has begun: in the way of its
/// beginning, it would stop it there.
#[cfg(unix)]
#[test]
fn results_that_cannot_be_written_do_not_take_the_others_with_them() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let training = endless(&dataset, &output, &[]);
    fs::create_dir(output.join("curve.svg")).unwrap();
    let (status, said) = interrupted(training);
    assert_eq!(status, Some(1), "{said}");
    assert!(said.lines().last().unwrap().contains("curve.svg: "), "{said}");
    assert_eq!(names_in(&output.join("views")), ["images_0.png"]);
    fs::remove_dir(output.join("curve.svg")).unwrap();

    fs::remove_dir_all(output.join("views")).unwrap();
    let earlier = fs::read(output.join("summary.json")).unwrap();
    let training = endless(&dataset, &output, &[]);
    fs::write(output.join("views"), "no folder").unwrap();
    let (status, said) = interrupted(training);
    assert_eq!(status, Some(1), "{said}");
    assert!(said.lines().last().unwrap().contains("views: "), "{said}");
    let evaluation: Value = serde_json::from_slice(&fs::read(output.join("evaluation.json")).unwrap()).unwrap();
    let summary = fs::read(output.join("summary.json")).unwrap();
    assert_ne!(summary, earlier, "times differ");
    assert_eq!(serde_json::from_slice::<Value>(&summary).unwrap()["evaluation"], evaluation);
    let refused = gs(small(&dataset, &output));
    assert!(refused.refusal().contains("views: is a file where a folder"), "{refused:?}");
}

#[test]
fn a_training_with_a_damaged_image_can_go_on_once_it_is_whole() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let [whole, cut] = ["whole", "cut"].map(|name| place.path().join(name));
    let flags = ["--holdout", "4", "--start", "random"];
    gs(small(&dataset, &whole).into_iter().chain(flags)).done();
    let image = dataset.join("images/5.png");
    let bytes = fs::read(&image).unwrap();
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2..][..32].fill(0);
    fs::write(&image, damaged).unwrap();
    let run = gs(small(&dataset, &cut).into_iter().chain(flags));
    let checkpoint = cut.join("checkpoint.safetensors");
    let error = run.stderr.lines().last().unwrap_or_default();
    assert!(run.status == Some(1) && error.contains("5.png"), "{run:?}");
    assert!(error.contains("--resume") && checkpoint.is_file(), "{run:?}");
    fs::write(&image, bytes).unwrap();
    gs(["train", text(&dataset), "-o", text(&cut), "--holdout", "4", "--resume", text(&checkpoint)]).done();
    assert_eq!(fs::read(cut.join("scene.ply")).unwrap(), fs::read(whole.join("scene.ply")).unwrap());
}

#[test]
fn a_stopped_training_goes_on_to_the_same_scene() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let [whole, half, rest] = ["whole", "half", "rest"].map(|name| place.path().join(name));
    let checkpoint = place.path().join("state");
    let storing = ["--checkpoint", text(&checkpoint), "--checkpoint-every", "25"];
    gs(small(&dataset, &half).into_iter().chain(storing)).done();
    gs(small(&dataset, &whole)).done();
    let words = ["train", text(&dataset), "-o", text(&rest), "--resume", text(&checkpoint), "--backend", "cpu"];
    let run = gs(words).done();
    assert!(run.stderr.contains("from step 25 of"), "{}", run.stderr);
    assert_eq!(fs::read(rest.join("scene.ply")).unwrap(), fs::read(whole.join("scene.ply")).unwrap());
    let mut slow = gs_io::read_checkpoint(&checkpoint).unwrap();
    slow.metadata.insert("seconds".to_owned(), "1000".to_owned());
    gs_io::write_checkpoint(place.path().join("slow"), &slow).unwrap();
    let slow = place.path().join("slow");
    let summary =
        gs(["train", text(&dataset), "-o", text(&rest), "--resume", text(&slow), "--no-report", "--json"]).json();
    let [training, total] = ["seconds", "total_seconds"].map(|key| summary[key].as_f64().unwrap());
    assert!(1000.0 < training && training < total, "the whole time holds that of the training: {summary}");

    let info = gs(["info", text(&checkpoint), "--json"]).json();
    assert_eq!((&info["kind"], &info["sh_degree"]), (&"checkpoint of a training in 3D".into(), &1.into()));
    assert_eq!((&info["metadata"]["step"], &info["gaussians"].is_u64()), (&"25".into(), &true));
    let printed = gs(["info", text(&checkpoint)]).done().stdout;
    assert!(printed.contains("largest scale") && printed.contains("training-3d-1"), "{printed}");
    let refused = gs(words.into_iter().chain(["--holdout", "3"]));
    assert!(refused.status == Some(1) && refused.stderr.contains("give the same data set"), "{refused:?}");
    let refused = gs(words.into_iter().chain(["--alpha", "mask"]));
    assert!(refused.status == Some(1) && refused.stderr.contains("--images, --alpha and --max-size"), "{refused:?}");
    let refused = gs(words.into_iter().chain(["--seed", "3"]));
    assert_eq!(refused.status, Some(2), "{refused:?}");
}

/// A pipe can be read once only.
#[cfg(unix)]
#[test]
fn settings_may_come_through_a_pipe() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let words = ["train", text(&dataset), "-o", text(&output), "--settings", "/dev/stdin", "--no-report", "--json"];
    let summary = Run::fed(&words, "gaussians = 50\niterations = 3\n").json();
    assert_eq!((&summary["iterations"], &summary["settings"]["gaussians"]), (&3.into(), &50.into()));
}

#[cfg(unix)]
#[test]
fn ctrl_c_saves_a_checkpoint_and_what_there_is() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let (status, said) = interrupted(endless(&dataset, &output, &["--no-report"]));
    assert_eq!(status, Some(130), "{said}");
    assert!(said.contains("to go on: gs train ") && said.contains("--resume "), "{said}");
    assert!(gs_io::read_checkpoint(output.join("checkpoint.safetensors")).is_ok());
    assert!(output.join("scene.ply").exists());
}

/// A killed training without checkpoint flags loses a tenth of its work; a finished training keeps
/// no checkpoint.
#[test]
fn a_long_training_that_is_killed_can_go_on() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    fs::create_dir(&output).unwrap();
    let earlier = output.join("checkpoint.safetensors");
    fs::write(&earlier, "another run's").unwrap();
    let checkpoint = output.join("checkpoint-2.safetensors");
    let words = ["train", text(&dataset), "-o", text(&output), "-i", "2000", "-n", "40", "--no-report"];
    let words = words.into_iter().chain(["--backend", "cpu", "--policy", "none"]);
    let mut child = command().args(words.clone()).stderr(Stdio::null()).spawn().unwrap();
    while !checkpoint.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended without a checkpoint");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!output.join("scene.ply").exists(), "it was killed too late");
    let words = ["train", text(&dataset), "-o", text(&output), "--backend", "cpu", "--no-report"];
    let run = gs(words.into_iter().chain(["--resume", text(&checkpoint)])).done();
    assert!(run.stderr.contains("after 2000 steps"), "{}", run.stderr);
    assert!(output.join("scene.ply").exists() && !checkpoint.exists());
    assert_eq!(fs::read(&earlier).unwrap(), b"another run's");
}

/// Makes a Blender data set of one of Nerfstudio.
pub(crate) fn make_blender(dataset: &Path) {
    let transforms: Value = serde_json::from_slice(&fs::read(dataset.join("transforms.json")).unwrap()).unwrap();
    let blender = json!({ "camera_angle_x": 0.7, "frames": transforms["frames"] });
    fs::write(dataset.join("transforms_train.json"), blender.to_string()).unwrap();
}

#[test]
fn a_scene_is_judged_as_it_was_trained() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    for antialias in ["mip", "compensated"] {
        let flags = ["--antialias", antialias, "--no-report", "--json"];
        let summary = gs(small(&dataset, &output).into_iter().chain(flags)).json();
        let scene = output.join("scene.ply");
        let eval = gs(["eval", text(&scene), text(&dataset), "--json", "--backend", "cpu"]).done();
        assert!(eval.stderr.contains(&format!("antialias {antialias}")) && !eval.stderr.contains("note:"), "{eval:?}");
        let (trained, judged) =
            (summary["evaluation"]["psnr"].as_f64().unwrap(), eval.json()["psnr"].as_f64().unwrap());
        assert!((trained - judged).abs() < 1e-3, "{antialias}: {trained} {judged}");
    }
}

#[test]
fn training_on_rendered_images_uses_mip_by_default() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    make_blender(&dataset);
    let [first, second] = ["first", "second"].map(|name| place.path().join(name));
    let antialias = |output: &Path, flags: &[&str]| {
        let words = small(&dataset, output);
        let run = gs(words.into_iter().chain(["--no-report", "--overwrite"]).chain(flags.iter().copied())).done();
        let known = gs_io::read_3d(output.join("scene.ply")).unwrap().trained_with.antialias.unwrap();
        assert_eq!(run.stderr.contains("viewers must show scene.ply"), known.compensates(), "{run:?}");
        known
    };
    assert_eq!(antialias(&first, &[]), Antialias::Mip);
    assert_eq!(antialias(&first, &["--antialias", "dilate"]), Antialias::Dilate);
    let scene = first.join("scene.ply");
    assert_eq!(antialias(&second, &["--start", text(&scene)]), Antialias::Dilate);
    assert_eq!(antialias(&second, &["--start", text(&scene), "--antialias", "mip"]), Antialias::Mip);
    assert_eq!(antialias(&second, &["--start", text(&scene), "--effects", "order"]), Antialias::None);
}

#[test]
fn a_scene_of_which_nothing_is_to_be_seen_says_why() {
    let place = folder();
    let mut nothing = scene();
    nothing.rotations.iter_mut().take(3).for_each(|q| *q = [0.0; 4]);
    nothing.opacity_logits.iter_mut().skip(3).for_each(|logit| *logit = -100.0);
    let (file, picture) = (place.path().join("nothing.ply"), place.path().join("nothing.png"));
    gs_io::write_3d(&file, &nothing, &gs_io::WriteOptions3d::default()).unwrap();
    let flags = ["--size", "48x40", "--backend", "cpu"];
    let run = gs(["render", text(&file), "-o", text(&picture)].into_iter().chain(flags)).done();
    let why = "of 8 Gaussians 3 without rotation or extent, 5 transparent";
    assert!(run.stderr.contains(why), "{run:?}");
    let out = place.path().join("popping");
    let small = ["--frames", "9", "--places", "1"];
    let run = gs(["popping", text(&file), "-o", text(&out)].into_iter().chain(flags).chain(small)).done();
    assert!(run.stderr.contains(why), "{run:?}");
}

#[test]
fn invalid_render_train_and_eval_commands_are_refused() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let out = place.path().join("out.png");
    let (scene, out, dataset) = (text(&scene), text(&out), text(&dataset));
    let path = place.path().join("path.json");
    fs::write(&path, "{ \"width\": 8 }").unwrap();
    let nobody = format!("{dataset}:nobody");
    let (jpeg, nowhere) = (place.path().join("out.jpg"), place.path().join("nowhere"));
    let broken = place.path().join("broken.ply");
    let mut bytes = fs::read(scene).unwrap();
    bytes.splice(bytes.len() - 4.., f32::NAN.to_le_bytes());
    fs::write(&broken, bytes).unwrap();
    for (words, expected) in [
        (&["render", scene, "-o", out, "--camera", &nobody][..], "its views are images/0.png"),
        (&["render", scene, "-o", out, "--orbit", "3"], "one PNG cannot hold 3 frames"),
        (&["render", scene, "-o", out, "--path", text(&path)], "path.json"),
        (&["render", scene, "-o", out, "--region", "0,0,4,4"], "--region is for 2D scenes"),
        (&["train", dataset, "-o", out, "--start", "points"], "for a data set without points"),
        (&["train", dataset, "-o", out, "--coarse", "3"], "2, 4 or 8"),
        (&["train", scene, "-o", out], "true.ply"),
        (&["render", scene, "-o", text(&jpeg)], "let its name end in .png"),
        (&["render", text(&broken), "-o", out], "gs doctor SCENE shows what is broken"),
        (&["render", scene, "-o", out, "--path", "/dev/zero"], "/dev/zero: "),
        (&["eval", dataset, dataset], "dataset"),
        (&["eval", text(&broken), dataset], "gs doctor SCENE shows what is broken"),
        (&["eval", scene, text(&nowhere)], "nowhere: no such file"),
        (&["eval", scene, scene], "true.ply: is no data set"),
    ] {
        let run = gs(words.iter().copied());
        assert!(run.refusal().contains(expected), "{words:?}: {run:?}");
        assert!(!Path::new(out).exists(), "{words:?}");
    }
}

#[test]
fn cameras_that_look_away_are_the_data_sets_fault() {
    let place = folder();
    let (dataset, file) = dataset_and_scene(place.path());
    let mut away = scene();
    away.means.iter_mut().for_each(|mean| mean.z += 1e4);
    gs_io::write_3d(&file, &away, &gs_io::WriteOptions3d::default()).unwrap();
    let out = place.path().join("out");
    let run = gs([&small(&dataset, &out)[..], &["--start", text(&file)]].concat());
    assert_eq!(run.status, Some(1), "{run:?}");
    let line = run.stderr.lines().last().unwrap();
    assert!(line.contains("dataset: none of the 8 first Gaussians is in sight of any of the 7 views"), "{line}");
    assert!(!out.exists());
    let eval = gs(["eval", text(&file), text(&dataset)]).done();
    assert!(
        eval.stderr.contains("nothing of the scene is in sight") && eval.stdout.contains("mean of 1 view"),
        "{eval:?}"
    );
}

/// Moves the cameras of a Nerfstudio data set: to units of a hundredth, far from the origin.
fn move_away(dataset: &Path) {
    let file = dataset.join("transforms.json");
    let mut transforms: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    for frame in transforms["frames"].as_array_mut().unwrap() {
        for (row, origin) in [4_500_000.0, 451_000.0, -2000.0].into_iter().enumerate() {
            let place = &mut frame["transform_matrix"][row][3];
            *place = json!(origin + 100.0 * place.as_f64().unwrap());
        }
    }
    fs::write(&file, transforms.to_string()).unwrap();
}

#[test]
fn a_georeferenced_data_set_trains_alike_and_its_scene_finds_its_views() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let [here, away] = ["here", "away"].map(|name| place.path().join(name));
    let train = |output: &Path| {
        let run = gs(small(&dataset, output).into_iter().chain(["--no-report", "--json", "--start", "random"]));
        let notes = run.stderr.clone();
        (run.json(), notes)
    };
    let (near, _) = train(&here);
    move_away(&dataset);
    let (far, notes) = train(&away);
    assert!(
        notes.contains("origin at (4500000, 451000, -2000)") && notes.contains("gs convert --frame world"),
        "{notes}"
    );
    let psnr = |summary: &Value| summary["evaluation"]["psnr"].as_f64().unwrap();
    assert!((psnr(&near) - psnr(&far)).abs() < 0.1, "{} {}", psnr(&near), psnr(&far));
    assert_eq!((near.get("frame"), far["frame"]["unit"].as_f64()), (None, Some(100.0)));

    // In either coordinates, the scene is seen from the same cameras.
    let scene = away.join("scene.ply");
    for to in ["world.ply", "world.glb"].map(|name| place.path().join(name)) {
        gs(["convert", text(&scene), text(&to), "--frame", "world"]).done();
        for file in [&scene, &to] {
            let eval = gs(["eval", text(file), text(&dataset), "--json", "--backend", "cpu"]).json();
            assert!((eval["psnr"].as_f64().unwrap() - psnr(&far)).abs() < 1e-3, "{}: {eval}", file.display());
        }
        // Training goes on from it, too.
        let on = place.path().join("on");
        let flags = ["--start", text(&to), "-i", "1", "-n", "400", "--no-report", "--json", "--backend", "cpu"];
        let summary = gs(["train", text(&dataset), "-o", text(&on)].into_iter().chain(flags)).json();
        assert!(psnr(&summary) > psnr(&far) - 1.0, "{summary}");
    }
}
