//! `gs info` on data sets of posed images, and on folders that are not data sets.

use std::fs;

use gs_core::Image;
use serde_json::json;

use crate::{
    bad_input::chunk,
    process::{command, folder, gs, names_in, picture},
    train::{dataset_and_scene, small, text},
};

#[test]
fn info_describes_a_data_set() {
    let place = folder();
    picture(place.path(), 40, 30);
    let json = r#"{"camera_angle_x": 1.0, "k1": -0.1, "frames": [
        {"file_path": "picture-40x30.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},
        {"file_path": "gone.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
    let file = place.path().join("transforms.json");
    fs::write(&file, json).unwrap();
    for path in [place.path().to_str().unwrap(), file.to_str().unwrap()] {
        let info = gs(["info", path, "--json"]).json();
        assert_eq!((&info["kind"], &info["made_by"]), (&"dataset".into(), &"nerfstudio".into()));
        assert_eq!((&info["views"], &info["train"], &info["points"]), (&1.into(), &1.into(), &0.into()));
        let camera = &info["cameras"][0];
        assert_eq!((&camera["image"][0], &camera["lens"]), (&40.into(), &"Brown-Conrady".into()));
        assert!(camera["undistorted"][0].as_u64().unwrap() > 40, "{info}");
        let degrees = camera["field_of_view"][0].as_f64().unwrap();
        assert!((57.0..65.0).contains(&degrees), "{info}");
        let text = gs(["info", path]).done().stdout;
        assert!(text.contains("Nerfstudio data set") && text.contains("40x30 px"), "{text}");
        assert!(
            text.contains("split               no view held out: the data set states no split")
                && info["split"] == "none",
            "{text}"
        );
        assert!(
            text.contains("1 image skipped: no image file (first: gone.png: its folder has 1 other image")
                && text.contains("no points"),
            "{text}"
        );
    }
}

#[test]
fn info_counts_360_images_and_depth_maps() {
    let place = folder();
    picture(place.path(), 40, 20);
    let json = r#"{"camera_model": "EQUIRECTANGULAR", "frames": [
        {"file_path": "picture-40x20.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
    fs::write(place.path().join("transforms.json"), json).unwrap();
    let path = place.path().to_str().unwrap();
    let text = gs(["info", path]).done().stdout;
    assert!(text.contains("1 360° image split into the six faces of a cube each: 6 views"), "{text}");
    assert!(text.contains("40x20 px, 360°, equirectangular"), "{text}");
    assert!(text.contains("10x10 px (6 views)") && !text.contains("depth maps"), "{text}");

    let json = r#"{"fl_x": 40.0, "frames": [{"file_path": "picture-40x20.png", "depth_file_path": "depth.png",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
    fs::write(place.path().join("transforms.json"), json).unwrap();
    fs::copy(place.path().join("picture-40x20.png"), place.path().join("depth.png")).unwrap();
    assert_eq!(gs(["info", path, "--json"]).json()["depth_maps"], 1);
    // A depth map of no use is an error where it is used, before the folder is made.
    let out = place.path().join("out");
    let train = ["train", path, "-o", out.to_str().unwrap(), "-i", "1", "-n", "50", "--backend", "cpu"];
    let run = gs(train);
    assert!(run.status == Some(1) && run.stderr.contains("depth.png: it is an image with colours"), "{run:?}");
    fs::copy(picture(place.path(), 40, 30), place.path().join("depth.png")).unwrap();
    let fault = "depth.png: the image is 40x30 px";
    let text = gs(["info", path]).done().stdout;
    assert!(text.contains("1 depth map that a training could not use (first: ") && text.contains(fault), "{text}");
    let run = gs(train);
    assert!(run.status == Some(1) && run.stderr.contains(fault) && !out.exists(), "{run:?}");
    gs(train.iter().chain(&["--start", "random"])).done();
}

#[test]
fn a_folder_that_is_no_data_set_is_refused() {
    let place = folder();
    let run = gs(["info", place.path().to_str().unwrap()]);
    assert_eq!(run.status, Some(1), "{run:?}");
    assert!(run.refusal().contains("transforms.json") && run.refusal().contains("colmap/sparse"), "{run:?}");
    fs::write(place.path().join("transforms.json"), "{").unwrap();
    assert!(gs(["info", place.path().to_str().unwrap()]).refusal().contains("transforms.json: EOF"));
}

/// Text that a terminal would obey, or show differently from what it is: a new title, cleared
/// screens in both spellings, text turned round, a line break.
const HOSTILE: &str = "x\u{1b}]0;owned\u{7}\u{9b}2J\u{202e}gnp\nforged              line";

/// [`HOSTILE`] as it may be printed.
const PRINTED: &str = r"x\u{1b}]0;owned\u{7}\u{9b}2J\u{202e}gnp\nforged              line";

fn is_harmless(text: &str) -> bool {
    !text.contains(|c: char| (c.is_control() && c != '\n') || c == '\u{202e}') && !text.contains("\nforged")
}

#[test]
fn text_of_a_data_set_does_not_reach_the_terminal_raw() {
    let place = folder();
    picture(place.path(), 40, 30);
    let matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]];
    let frame = |name: &str| json!({ "file_path": name, "transform_matrix": matrix });
    let mut frames = vec![frame(HOSTILE), frame("picture-40x30.png")];
    let write =
        |fields: serde_json::Value| fs::write(place.path().join("transforms.json"), fields.to_string()).unwrap();
    write(json!({ "camera_angle_x": 1.0, "ply_file_path": HOSTILE, "frames": frames }));
    let path = place.path().to_str().unwrap();
    let info = gs(["info", path]).done().stdout;
    assert!(is_harmless(&info) && info.contains(&format!("(first: {PRINTED}: ")), "{info:?}");
    assert!(info.contains(&format!("no points: there is no file {PRINTED}")), "{info:?}");
    let info = gs(["info", path, "--json"]).done().stdout;
    assert!(is_harmless(&info), "{info:?}");
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert!(info["remarks"][0].as_str().unwrap().contains(PRINTED), "{info}");

    // Errors of several kinds: one line each.
    write(json!({ "camera_angle_x": 1.0, "frames": [frames.remove(0)] }));
    let outside = format!("../{HOSTILE}");
    let run = gs(["info", path]);
    assert!(is_harmless(run.refusal()) && run.refusal().contains(r"\u{1b}]0;owned"), "{run:?}");
    write(json!({ "camera_angle_x": 1.0, "frames": [frame(&outside)] }));
    let run = gs(["info", path]);
    assert!(is_harmless(run.refusal()) && run.refusal().contains(r"\u{1b}]0;owned"), "{run:?}");
    write(json!({ "camera_angle_x": 1.0, "camera_model": HOSTILE, "frames": [] , "w": HOSTILE }));
    assert!(is_harmless(gs(["info", path]).refusal()));
}

#[cfg(unix)]
#[test]
fn names_of_files_do_not_reach_the_terminal_raw() {
    let place = folder();
    let image = place.path().join(HOSTILE);
    fs::rename(picture(place.path(), 16, 16), &image).unwrap();
    let output = place.path().join("out");
    let run = gs([
        "fit".as_ref(),
        image.as_os_str(),
        "-o".as_ref(),
        output.as_os_str(),
        "-n".as_ref(),
        "5".as_ref(),
        "-i".as_ref(),
        "2".as_ref(),
        "--backend".as_ref(),
        "cpu".as_ref(),
    ])
    .done();
    assert!(is_harmless(&run.stderr) && run.stderr.contains(r"\u{1b}]0;owned"), "{:?}", run.stderr);
    fs::write(&image, "text").unwrap();
    let run = gs(["fit".as_ref(), image.as_os_str()]);
    assert!(is_harmless(run.refusal()) && run.refusal().contains(r"\u{1b}]0;owned"), "{run:?}");
    let run = gs(["info", &format!("--{HOSTILE}")]);
    assert!(is_harmless(&run.stderr), "{run:?}");
}

#[test]
fn an_image_says_what_was_done_to_its_colours() {
    let place = folder();
    let png = fs::read(picture(place.path(), 16, 12)).unwrap();
    // The header is the first chunk.
    let (header, pixels) = png.split_at(8 + 25);
    let path = place.path().join("linear.png");
    fs::write(&path, [header, &chunk(b"gAMA", &100_000_u32.to_be_bytes()), pixels].concat()).unwrap();
    let output = place.path().join("out");
    let words = ["fit", text(&path), "-o", text(&output), "-n", "5", "-i", "2", "--backend", "cpu", "--no-report"];
    let run = gs(words).done();
    assert!(run.stderr.contains("note: colours converted from gamma 1.00 (gAMA) to sRGB\n"), "{}", run.stderr);
    let run = gs(["eval", text(&path), text(&path)]).done();
    assert!(run.stderr.contains("linear.png: colours converted from gamma 1.00"), "{}", run.stderr);
}

#[test]
fn large_images_are_scaled_down_unless_they_are_wanted_whole() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    // One pixel more than the default keeps.
    let wide = Image::from_fn(1601, 2, |x, _| [x as f32 / 1601.0, 0.5, 0.0]).unwrap();
    gs_io::write_png(dataset.join("images/wide.png"), &wide).unwrap();
    let mut transforms: serde_json::Value =
        serde_json::from_slice(&fs::read(dataset.join("transforms.json")).unwrap()).unwrap();
    let mut frame = transforms["frames"][0].clone();
    for (key, value) in
        [("file_path", json!("images/wide.png")), ("w", json!(1601)), ("h", json!(2)), ("fl_x", json!(900.0))]
    {
        frame[key] = value;
    }
    transforms["frames"].as_array_mut().unwrap().push(frame);
    fs::write(dataset.join("transforms.json"), transforms.to_string()).unwrap();
    let printed = "1 image scaled down to 1600 px on the longer side (first: 1601x2 to 1600x2 px); --max-size none reads all pixels";
    let info = gs(["info", text(&dataset)]).done().stdout;
    assert!(info.contains(printed) && info.contains("1601x2 px") && info.contains("scaled to 1600x2 px"), "{info}");
    assert!(!gs(["info", text(&dataset), "--max-size", "none"]).done().stdout.contains("scaled"));

    let output = place.path().join("out");
    let state = place.path().join("state");
    let storing = ["--max-size", "16", "--checkpoint", text(&state), "--checkpoint-every", "25", "--no-report"];
    let run = gs(small(&dataset, &output).into_iter().chain(storing)).done();
    assert!(
        run.stderr.contains("note: 9 images scaled down to 16 px on the longer side (first: 32x24 to 16x12 px)"),
        "{run:?}"
    );
    let resume =
        ["train", text(&dataset), "-o", text(&output), "--resume", text(&state), "--backend", "cpu", "--no-report"];
    gs(resume.into_iter().chain(["--max-size", "16"])).done();
    let refused = gs(resume);
    let line = refused.stderr.lines().last().unwrap();
    assert!(refused.status == Some(1) && line.contains("--alpha and --max-size: --max-size none if"), "{line}");
    // Judged by the same pixels unless others are asked for.
    let judged = |flags: &[&str]| gs(["eval", text(&scene), text(&dataset)].iter().chain(flags)).done().stdout;
    assert_ne!(judged(&["--max-size", "16"]), judged(&[]));
}

#[cfg(unix)]
#[test]
fn a_training_that_was_stopped_goes_on_with_the_same_pixels() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let words =
        ["train", text(&dataset), "-o", text(&output), "-i", "1000000", "-n", "300", "--no-report", "--max-size", "20"];
    let child = command().args(words).args(["--start", "random"]).stderr(std::process::Stdio::piped()).spawn().unwrap();
    while !output.exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    std::thread::sleep(std::time::Duration::from_millis(500));
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let said = String::from_utf8(child.wait_with_output().unwrap().stderr).unwrap();
    assert!(said.contains(" --max-size 20 -o ") && said.contains("--resume "), "{said}");
    assert!(names_in(&output).contains(&"checkpoint.safetensors".to_owned()));
}

#[test]
fn images_without_cameras_are_refused_with_a_remedy() {
    let place = folder();
    (1..4).for_each(|i| drop(picture(place.path(), 10 + i, 10)));
    let run = gs(["info", text(place.path())]);
    let line = run.refusal();
    assert!(line.contains("holds 3 images without camera poses") && line.contains("gs poses "), "{line}");
}
