//! `gs poses` and `gs train` of a video, with programs in place of ffmpeg and COLMAP.

#![cfg(unix)]

use std::{
    fs,
    process::Stdio,
    time::{Duration, Instant},
};

use gs_core::Image;

use crate::{
    poses::{Scene, last_line},
    process::{Run, names_in, signal},
};

/// Takes the place of ffmpeg: shows the prepared frames, or writes as many pictures as are asked for.
const FFMPEG: &str = r#"#!/bin/sh
here=$(dirname "$0")
echo ffmpeg >> "$here/calls"
case "$*" in *pgm*) cat "$here/frames.pgm"; cat "$here/complaint" >&2; exit 0 ;; esac
count=$(echo "$*" | grep -o 'eq(n' | wc -l)
for last; do :; done
for at in $(seq "$count"); do
    cp "$here/frame.jpg" "$(printf "$last" "$at")"
    echo "frame=$at"
    [ -f "$here/slow" ] && touch "$here/begun" && exec sleep 60
done
[ -f "$here/fails" ] && exit 1
[ -f "$here/empty" ] && : > "$(printf "$last" 2)"
exit 0
"#;

const FFPROBE: &str = "#!/bin/sh\nhere=$(dirname \"$0\")\ncat \"$here/complaint\" >&2\ncat \"$here/probe.json\"\n";

const PROBE: &str = r#"{"streams": [{"avg_frame_rate": "10/1"}], "format": {"duration": "12.0"}}"#;

/// A scene with a video `clip.mp4` that has every frame twice, whose camera moves to the right by some columns.
fn scene(moves: usize) -> Scene {
    let scene = Scene::textured();
    scene.program("ffmpeg", FFMPEG);
    scene.program("ffprobe", FFPROBE);
    fs::write(scene.path("bin/probe.json"), PROBE).unwrap();
    fs::write(scene.path("bin/complaint"), "").unwrap();
    fs::write(scene.path("clip.mp4"), "a video").unwrap();
    let noise = |x: usize, y: usize| x.wrapping_mul(73) ^ y.wrapping_mul(151) ^ (x * y).wrapping_mul(7);
    let value = |x: usize, y: usize| (noise(x / 9, y / 9) % 97 + noise(x / 3, y / 3) % 53) as u8;
    let mut bytes = Vec::new();
    for frame in 0..120 {
        bytes.extend(b"P5\n160 96\n255\n");
        bytes.extend((0..160 * 96).map(|at| value(at % 160 + moves * (frame / 2), at / 160)));
    }
    fs::write(scene.path("bin/frames.pgm"), bytes).unwrap();
    let image = Image::from_fn(64, 48, |x, y| [((x * 7 + y * 13) % 17) as f32 / 16.0; 3]).unwrap();
    let png = scene.path("frame.png");
    gs_io::write_png(&png, &image).unwrap();
    fs::rename(png, scene.path("bin/frame.jpg")).unwrap();
    scene.write_model(&["0001.jpg", "0002.jpg", "0003.jpg", "0004.jpg"]);
    scene
}

#[test]
fn frames_of_a_video_become_photographs() {
    let scene = scene(8);
    let run = scene.gs(&["poses", "clip.mp4", "-o", "set"]).done();
    assert!(
        run.stderr.contains(" of 120 frames are used: the sharpest wherever the picture has moved by 7 %"),
        "{run:?}"
    );
    assert_eq!(
        names_in(&scene.path("set")),
        ["frames.json", "images", "poses.json", "poses.log", "sparse"],
        "nothing unfinished is left"
    );
    let record =
        || -> serde_json::Value { serde_json::from_slice(&fs::read(scene.path("set/frames.json")).unwrap()).unwrap() };
    let frames = record()["frames"].as_array().unwrap().clone();
    // It moves by 5 % between two pairs of frames.
    assert!((58..=60).contains(&frames.len()), "{frames:?}");
    assert_eq!((&frames[0]["name"], &frames[0]["seconds"]), (&"0001.jpg".into(), &0.0.into()));
    let times: Vec<f64> = frames.iter().map(|frame| frame["seconds"].as_f64().unwrap()).collect();
    assert!(times.windows(2).all(|pair| (0.09..0.41).contains(&(pair[1] - pair[0]))), "{times:?}");
    let images = names_in(&scene.path("set/images"));
    assert_eq!(images, frames.iter().map(|frame| frame["name"].as_str().unwrap()).collect::<Vec<_>>());
    let calls = ["ffmpeg", "ffmpeg", "feature_extractor", "exhaustive_matcher", "mapper"];
    // Few poses are found, so there is a second attempt.
    assert_eq!(scene.calls()[..5], calls);

    let verdict = scene.gs(&["poses", "clip.mp4", "-o", "set", "--resume", "--json"]).json();
    assert_eq!(verdict["photographs"], images.len());
    assert_eq!(scene.calls().len(), 0, "with --resume, frames and poses stay");
    fs::write(scene.path("clip.mp4"), "another video").unwrap();
    scene.gs(&["poses", "clip.mp4", "-o", "set", "--resume"]).done();
    assert_eq!(scene.calls()[..3], calls[..3]);
    scene.gs(&["poses", "photos", "-o", "set"]).done();
    assert!(!scene.path("set/frames.json").exists() && !scene.path("set/images/0001.jpg").exists());
}

#[test]
fn a_training_takes_the_frames_of_a_video() {
    let scene = scene(8);
    let model: Vec<String> = (1..=60).map(|at| format!("{at:04}.jpg")).collect();
    scene.write_model(&model.iter().map(String::as_str).collect::<Vec<_>>());
    let words = [
        "train",
        "clip.mp4",
        "-o",
        "out",
        "-i",
        "2",
        "-n",
        "20",
        "--start",
        "random",
        "--no-report",
        "--backend",
        "cpu",
    ];
    let run = scene.gs(&words).done();
    assert!(run.stderr.contains("clip.mp4 is a video without camera poses: COLMAP finds them first"), "{run:?}");
    scene.calls();
    scene.gs(&words).done();
    assert_eq!(scene.calls().len(), 0);
}

#[test]
fn ctrl_c_leaves_no_part_of_the_frames() {
    let scene = scene(8);
    fs::write(scene.path("bin/slow"), "").unwrap();
    let child = scene.command(&["poses", "clip.mp4", "-o", "set"]).stderr(Stdio::piped()).spawn().unwrap();
    let started = Instant::now();
    while !scene.path("bin/begun").exists() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(20));
    }
    signal(&child, "-INT", 1);
    let run = Run::ended(child.wait_with_output().unwrap());
    assert_eq!(run.status, Some(130), "{run:?}");
    assert!(last_line(&run).starts_with("stopped while writing the frames; "), "{run:?}");
    assert!(last_line(&run).ends_with("gs poses clip.mp4 -o set --resume continues"), "{run:?}");
    assert_eq!(names_in(&scene.path("set")), [".gs-poses"]);
    assert_eq!(names_in(&scene.path("set/.gs-poses")), [""; 0]);
    fs::remove_file(scene.path("bin/slow")).unwrap();
    scene.gs(&["poses", "clip.mp4", "-o", "set", "--resume"]).done();
}

#[test]
fn a_video_that_cannot_be_used_says_why() {
    let scene = scene(0);
    let refused = |expected: &str| {
        let run = scene.gs(&["poses", "clip.mp4", "-o", "set"]);
        let line = last_line(&run);
        assert!(run.status == Some(1) && run.stdout.is_empty(), "{run:?}");
        assert!(line.starts_with("error: clip.mp4: ") && line.contains(expected), "{line}");
        assert!(names_in(&scene.path("set")).is_empty(), "nothing is left");
    };
    let put = |name: &str, text: &str| fs::write(scene.path("bin").join(name), text).unwrap();
    fs::create_dir(scene.path("set")).unwrap();
    refused("the camera hardly moves in it: 1 of 120 frames show it from a new place, but 5 are needed");
    put("frames.pgm", "P5\n2 1\n255\n\x01\x02P5\n2 1\n255\n\x01");
    refused("it has only 1 frame, too few");
    put("frames.pgm", &"P5\n4 2\n255\n\0\0\0\0\0\0\0\0".repeat(30));
    refused("dark or shows plain surfaces");
    put("frames.pgm", "");
    put("complaint", "[h264 @ 0x1] no frame!\n");
    refused("ffmpeg cannot read any frame of it (no frame!)");
    put("probe.json", r#"{"streams": [], "format": {"duration": "6.0"}}"#);
    refused("it has no moving picture");
    scene.program("ffprobe", "#!/bin/sh\necho 'clip.mp4: moov atom not found' >&2\nexit 1\n");
    refused("ffmpeg cannot read it (moov atom not found)");
    fs::remove_file(scene.path("bin/ffprobe")).unwrap();
    let run = Run::of(scene.command(&["poses", "clip.mp4", "-o", "set"]).env("PATH", scene.path("bin")));
    let line = run.refusal();
    assert!(
        ["apt install", "brew install", "winget install"].iter().all(|part| line.contains(&format!("{part} ffmpeg")))
    );
}

#[test]
fn frames_that_are_not_written_whole_are_no_success() {
    let scene = scene(8);
    for fault in ["fails", "empty"] {
        fs::write(scene.path("bin").join(fault), "").unwrap();
        let run = scene.gs(&["poses", "clip.mp4", "-o", "set"]);
        assert_eq!(run.status, Some(1), "{run:?}");
        assert!(last_line(&run).starts_with("error: clip.mp4: ffmpeg could not write its frames ("), "{run:?}");
        assert!(!scene.path("set/images").exists() && !scene.path("set/frames.json").exists());
        fs::remove_file(scene.path("bin").join(fault)).unwrap();
    }
    scene.gs(&["poses", "clip.mp4", "-o", "set"]).done();
}
