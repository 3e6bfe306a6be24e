//! `gs view` where there is nothing to view, or nothing to view it on. What it shows needs a
//! display, and eyes.

use std::{fs, path::Path};

use crate::{
    process::{Run, command, folder, gs, picture},
    train::dataset_and_scene,
};

/// Runs it where no display can be found.
fn view(arguments: &[&str]) -> Run {
    let mut command = command();
    for variable in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        command.env_remove(variable);
    }
    Run::of(command.arg("view").args(arguments))
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

// Elsewhere there is always a display, or no way to take it away.
#[cfg(all(unix, not(target_os = "macos")))]
#[test]
fn without_a_display_it_says_so_and_what_to_do() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let camera = format!("{}:3", text(&dataset));
    let flags: [&[&str]; 3] = [&[], &["--backend", "cpu", "--size", "40x30"], &["--camera", &camera]];
    for flags in flags {
        let run = view(&[&[text(&scene)], flags].concat());
        assert_eq!(run.status, Some(1), "{run:?}");
        for part in ["no display", "gs render SCENE -o turn.apng --orbit 60"] {
            assert!(run.refusal().contains(part), "{part}: {run:?}");
        }
    }
    // A 2D scene, by its output folder.
    let image = picture(place.path(), 16, 16);
    let output = place.path().join("fit");
    gs(["fit", text(&image), "-o", text(&output), "-n", "20", "-i", "5", "--no-report"]).done();
    let run = view(&[text(&output)]);
    assert!(run.status == Some(1) && run.stderr.contains("no display"), "{run:?}");
    // A display that is named but not there.
    let run = Run::of(command().env_remove("WAYLAND_DISPLAY").env("DISPLAY", ":9876").args(["view", text(&scene)]));
    assert_eq!(run.status, Some(1), "{run:?}");
    assert!(run.refusal().contains("--orbit"), "{run:?}");
    // What the message proposes works.
    let turn = place.path().join("turn.apng");
    gs(["render", text(&scene), "-o", text(&turn), "--orbit", "2", "--size", "8x6"]).done();
}

// Elsewhere there is always a display, or no way to take it away.
#[cfg(all(unix, not(target_os = "macos")))]
#[test]
fn only_scenes_with_levels_of_detail_take_a_budget() {
    let place = folder();
    let (_, scene) = dataset_and_scene(place.path());
    let [city, rad] = ["city/lod-meta.json", "city.rad"].map(|name| place.path().join(name));
    for levels in [&city, &rad] {
        gs(["convert", text(&scene), text(levels)]).done();
    }
    for scene in [&city, city.parent().unwrap(), &rad] {
        let run = view(&[text(scene), "--max-gaussians", "5", "--backend", "cpu"]);
        assert!(run.status == Some(1) && run.refusal().contains("no display"), "{run:?}");
    }
    let run = view(&[text(&scene), "--max-gaussians", "5"]);
    assert!(
        run.status == Some(2) && run.refusal().contains("is for levels of detail, and this scene has none"),
        "{run:?}"
    );
}

#[test]
fn unviewable_inputs_are_refused_before_a_window_opens() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let path = |name: &str| place.path().join(name);
    let image = picture(place.path(), 16, 16);
    gs(["fit", text(&image), "-o", text(&path("fit")), "-n", "20", "--iterations", "5", "--no-report"]).done();
    let good = fs::read(&scene).unwrap();
    fs::write(path("half.ply"), &good[..good.len() / 2]).unwrap();
    fs::write(path("empty.ply"), "").unwrap();
    let nowhere = format!("{}:nowhere", text(&dataset));
    let cases: [(&Path, &[&str], i32, &str); 10] = [
        (&path("absent.ply"), &[], 1, "absent.ply"),
        (&path("half.ply"), &[], 1, "half.ply"),
        (&path("empty.ply"), &[], 1, "empty.ply"),
        (&image, &[], 1, "not a scene file"),
        (&path("fit/scene.gs2d.safetensors"), &["--camera", "a:b"], 2, "2D scene"),
        (&scene, &["--camera", &nowhere], 2, "nowhere"),
        (&scene, &["--camera", "no/such/folder:a"], 1, "no/such/folder"),
        (&scene, &["--size", "0x9"], 2, "WIDTHxHEIGHT"),
        (&scene, &["--size", "20000x9"], 2, "20000x9"),
        (&scene, &["--background", "blue"], 2, "from 0 to 1"),
    ];
    for (file, flags, status, expected) in cases {
        let run = view(&[&[text(file)], flags].concat());
        assert_eq!(run.status, Some(status), "{run:?}");
        assert!(run.refusal().contains(expected), "{expected}: {run:?}");
        assert!(!run.refusal().contains("display"), "{run:?}");
    }
}
