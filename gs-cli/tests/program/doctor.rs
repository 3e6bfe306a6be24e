//! `gs doctor` on scenes that are sound, broken and doubtful, 2D and 3D.

use std::{fs, path::Path};

use glam::{Vec2, Vec3};
use gs_core::{Gaussian2d, Gaussian3d, Scene, Scene2d, Scene3d};
use gs_io::{WriteOptions3d, read_2d, read_3d, write_3d};

use crate::{
    ply::break_ply,
    process::{Run, folder, gs, names_in},
};

fn scene_3d() -> Scene3d {
    let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
    for i in 0..10 {
        let t = i as f32;
        scene.push(Gaussian3d {
            mean: Vec3::new(t, -t, 0.5),
            log_scale: Vec3::new(-3.0, -2.0, -1.0),
            rotation: [1.0, 0.1 * t, 0.0, 0.0],
            opacity_logit: if i == 0 { 18.0 } else { t - 4.0 },
            sh: (0..4).map(|k| Vec3::splat(0.1 * k as f32)).collect(),
        });
    }
    scene
}

fn doctor(scene: &Path, flags: &[&str]) -> Run {
    gs([Path::new("doctor"), scene].into_iter().chain(flags.iter().map(Path::new)))
}

fn repaired(scene: &Path, copy: &Path, flags: &[&str]) -> Run {
    gs([Path::new("convert"), scene, copy, Path::new("--drop-broken")].into_iter().chain(flags.iter().map(Path::new)))
}

#[test]
fn doctor_repairs_a_scene_and_leaves_sound_gaussians_intact() {
    let place = folder();
    let (path, fixed) = (place.path().join("scene.ply"), place.path().join("fixed.ply"));
    let scene = scene_3d();
    write_3d(&path, &scene, &WriteOptions3d::default()).unwrap();
    let sound = doctor(&path, &[]).done();
    assert!(sound.stdout.contains("3D scene, 3DGS PLY, 10 Gaussians\nbroken      none\ndoubtful    none"), "{sound:?}");

    break_ply(&path, 3, 8, &[f32::NAN]); // opacity
    break_ply(&path, 7, 4, &[0.0; 4]); // rotation
    break_ply(&path, 8, 7, &[9.0]); // a scale
    let before = fs::read(&path).unwrap();
    let sick = doctor(&path, &[]);
    assert_eq!(sick.status, Some(1));
    for part in [
        "1 (first: Gaussian 3) whose opacity is NaN: gs convert --drop-broken removes them",
        "1 (first: Gaussian 7) whose quaternion is 0: gs convert --drop-broken removes them",
        "doubtful    1 (first: Gaussian 8) whose shape is a needle",
    ] {
        assert!(sick.stdout.contains(part), "{part}: {sick:?}");
    }
    assert!(
        sick.stderr.contains("2 of 10 Gaussians are broken: gs convert") && sick.stderr.lines().count() == 1,
        "{sick:?}"
    );

    let json: serde_json::Value = serde_json::from_str(&doctor(&path, &["--json"]).stdout).unwrap();
    assert_eq!((&json["broken"], &json["gaussians"]), (&2.into(), &10.into()), "{json}");
    assert_eq!(json["findings"][0]["finding"], "opacity-not-a-number");
    let json = repaired(&path, &fixed, &["--json"]).json();
    assert_eq!((&json["dropped"], &json["gaussians"]), (&2.into(), &8.into()), "{json}");
    assert_eq!(json["lost"], serde_json::json!([]), "{json}");
    assert_eq!(fs::read(&path).unwrap(), before, "the examined file stays");
    let copy = fixed;
    let fixed = read_3d(&copy).unwrap().scene;
    // The test changed a scale of the eighth Gaussian, which is the sixth in the repaired scene.
    for (after, index) in [0, 1, 2, 4, 5, 6].into_iter().enumerate().chain([(7, 9)]) {
        assert_eq!(fixed.gaussian(after), scene.gaussian(index));
    }
    // A repair never replaces its input, and the copy needs no further repair.
    let refused = repaired(&path, &path, &[]);
    assert!(refused.refusal().contains("is an input of this run"), "{refused:?}");
    assert_eq!(fs::read(&path).unwrap(), before);
    let again = place.path().join("again.ply");
    let text = repaired(&copy, &again, &[]).done().stdout;
    assert!(text.contains("lost        nothing") && !text.contains("dropped"), "{text}");
    assert_eq!(fs::read(&copy).unwrap(), fs::read(&again).unwrap());
}

#[test]
fn scales_of_zero_are_found_and_raised() {
    let place = folder();
    let (path, fixed) = (place.path().join("scene.ply"), place.path().join("fixed.ply"));
    write_3d(&path, &scene_3d(), &WriteOptions3d::default()).unwrap();
    break_ply(&path, 3, 7, &[f32::NEG_INFINITY]);
    let sick = doctor(&path, &[]);
    assert_eq!(sick.status, Some(1));
    assert!(sick.stdout.contains("1 (first: Gaussian 3) whose scale is 0"), "{sick:?}");
    let json = repaired(&path, &fixed, &["--json"]).json();
    assert_eq!((&json["dropped"], &json["gaussians"]), (&0.into(), &10.into()), "{json}");
    assert_eq!(json["lost"].as_array().unwrap().len(), 1, "{json}");
    assert!(read_3d(&fixed).unwrap().losses.is_empty());
}

#[test]
fn a_2d_scene_is_fixed_too() {
    let place = folder();
    let (path, fixed) = (place.path().join("a.gs2d.safetensors"), place.path().join("b.gs2d.safetensors"));
    let gaussian = |x: f32| Gaussian2d {
        mean: Vec2::new(x, 3.0),
        log_scale: Vec2::new(0.5, 0.25),
        rotation: 0.125,
        opacity_logit: f32::INFINITY,
        color: Vec3::splat(x / 8.0),
    };
    let marked = 77.125_f32;
    let scene: Scene2d = [1.0, 2.0, marked, 4.0, 4.0].map(gaussian).into_iter().collect();
    let file = gs_io::File2d { scene, width: 8, height: 8, ..Default::default() };
    gs_io::write_2d(&path, &file).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let at = bytes.windows(4).position(|word| word == marked.to_le_bytes()).unwrap();
    bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(&path, bytes).unwrap();

    let refused = gs(["render", path.to_str().unwrap(), "-o", place.path().join("a.png").to_str().unwrap()]);
    assert!(refused.refusal().contains("gs doctor SCENE"), "{refused:?}");
    let text = doctor(&path, &[]).stdout;
    assert!(
        text.contains("2D scene, 5 Gaussians") && text.contains("1 (first: Gaussian 2) whose mean is NaN or infinite"),
        "{text}"
    );
    assert!(
        text.contains("doubtful    1 (first: Gaussian 4) whose place and shape are those of an earlier one"),
        "{text}"
    );
    repaired(&path, &fixed, &[]).done();
    let expected: Scene2d = [1.0, 2.0, 4.0, 4.0].map(gaussian).into_iter().collect();
    assert_eq!(read_2d(&fixed).unwrap(), gs_io::File2d { scene: expected, ..file });
}

#[test]
fn a_scene_without_a_sound_gaussian_is_not_repaired() {
    let place = folder();
    let path = place.path().join("scene.ply");
    write_3d(&path, &scene_3d(), &WriteOptions3d::default()).unwrap();
    let empty = place.path().join("out.ply");
    for vertex in 0..10 {
        break_ply(&path, vertex, 8, &[f32::NAN]);
    }
    let before = names_in(place.path());
    let run = repaired(&path, &empty, &[]);
    assert_eq!(run.status, Some(1), "{run:?}");
    assert!(run.refusal().contains("none of 10 Gaussians can be drawn and stored"), "{run:?}");
    assert_eq!(names_in(place.path()), before);
}
