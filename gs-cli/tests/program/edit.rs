//! `gs edit`.

use std::{fs, path::Path};

use glam::{Mat3, Quat, Vec3};
use gs_core::Scene as _;
use gs_io::{WorldFrame, read_3d, write_3d};

use crate::{
    convert::ply,
    process::{Run, folder, gs},
};

fn edit(from: &Path, to: &Path, operations: &[&str]) -> Run {
    gs([Path::new("edit"), from, to].into_iter().chain(operations.iter().map(Path::new)))
}

#[track_caller]
fn refused(run: Run, status: i32, part: &str) {
    assert!(run.status == Some(status) && run.refusal().contains(part), "{part}: {run:?}");
}

#[test]
fn operations_are_done_in_order() {
    let place = folder();
    let (scene, edited) = (ply(place.path()), place.path().join("edited.ply"));
    let json =
        edit(&scene, &edited, &["scale=2", "move=0,0,1", "turn=y:90", "crop=box:-99,-99,-9,99,99,-1", "--json"]).json();
    assert_eq!((&json["from"], &json["gaussians"]), (&10.into(), &4.into()));
    assert_eq!(json["operations"][3], "crop=box:-99,-99,-9,99,99,-1: removed 6 Gaussians of 10");
    let (before, after) = (read_3d(&scene).unwrap().scene, read_3d(&edited).unwrap().scene);
    let turn = Mat3::from_quat(Quat::from_rotation_y(std::f32::consts::FRAC_PI_2));
    // z is −2 times the x before.
    for (index, kept) in (1..=4).enumerate() {
        let [before, after] = [before.gaussian(kept), after.gaussian(index)];
        let expected = turn * (2.0 * before.mean + Vec3::Z);
        assert!(after.mean.abs_diff_eq(expected, 1e-5), "{} and not {expected}", after.mean);
        let covariance = 4.0 * (turn * before.covariance().unwrap() * turn.transpose());
        assert!(after.covariance().unwrap().abs_diff_eq(covariance, 1e-5));
        assert_eq!(after.sh[0], before.sh[0]);
        assert!(after.sh != before.sh, "colours turn, too");
    }
}

#[test]
fn scenes_are_filtered_joined_and_measured() {
    let place = folder();
    let (scene, edited) = (ply(place.path()), place.path().join("edited.spz"));
    let add = format!("add={}", scene.display());
    let text = edit(&scene, &edited, &["keep=opacity>=0.5", &add, "drop=x>8.5"]).done().stdout;
    for part in ["keep=opacity>=0.5: removed 5 Gaussians of 10", "added 10 Gaussians", "removed 2 Gaussians of 15"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(read_3d(&edited).unwrap().scene.len(), 13);
    let sized = place.path().join("sized.ply");
    edit(&scene, &sized, &["scale-from=0,0,0,0,-4,0,1"]).done();
    assert!(read_3d(&sized).unwrap().scene.means[4].abs_diff_eq(Vec3::new(1.0, -1.0, 0.125), 1e-6));
}

#[test]
fn only_what_moves_a_scene_takes_it_out_of_its_frame() {
    let place = folder();
    let (plain, edited) = (ply(place.path()), place.path().join("edited.ply"));
    let placed = place.path().join("placed.ply");
    let frame = WorldFrame { origin: glam::DVec3::new(4e5, 0.0, 5e6), unit: 10.0 };
    let options = gs_io::WriteOptions3d::default().with(|s| s.trained_with.frame = frame);
    write_3d(&placed, &read_3d(&plain).unwrap().scene, &options).unwrap();
    let frame_after = |operations: &[&str]| {
        edit(&placed, &edited, operations).done();
        read_3d(&edited).unwrap().trained_with.frame
    };
    assert_eq!(frame_after(&["drop=x>5"]), frame);
    assert_eq!(frame_after(&["move=1,0,0"]), WorldFrame::WORLD);
    let [unplaced, add] = [&plain, &placed].map(|path| format!("add={}", path.display()));
    refused(edit(&placed, &edited, &[&unplaced]), 2, "only one of the scenes has a frame");
    refused(edit(&placed, &edited, &["scale=2", &add]), 2, "only one of the scenes has a frame");
    // The other scene is taken into the frame of this one.
    let [elsewhere, other] = ["elsewhere.ply", "other.ply"].map(|name| place.path().join(name));
    let at_origin = options.with(|s| s.trained_with.frame.origin = glam::DVec3::new(0.0, 0.0, 0.1));
    write_3d(&elsewhere, &read_3d(&plain).unwrap().scene, &at_origin).unwrap();
    edit(&placed, &other, &[&format!("add={}", elsewhere.display())]).done();
    let joined = read_3d(&other).unwrap();
    assert!(
        (joined.scene.means[10] - Vec3::new(-4e4, 0.0, -499_999.5)).abs().max_element() < 0.1,
        "{}",
        joined.scene.means[10]
    );
}

#[test]
fn impossible_edits_change_nothing() {
    let place = folder();
    let (scene, edited) = (ply(place.path()), place.path().join("edited.ply"));
    for (operations, status, part) in [
        (&["crop=sphere:0,0,99,1"][..], 2, "crop=sphere:0,0,99,1: nothing would be left of the scene"),
        (&["drop=opacity<0.02", "shrink=2"], 2, "an operation is move="),
        (&["scale-from=1,1,1,1,1,1,2"], 2, "the two points are the same"),
        (&["scale=1e38", "scale=1e38"], 2, "does not fit into numbers of 32 bits"),
        (&["add=nothing.ply"], 1, "nothing.ply"),
        (&["up=ground"], 1, "no ground was found"),
        (&["floaters"], 2, "floaters: it needs views that show the scene: name their data set with --views"),
        (&["scale=2", "drop=contribution<1"], 2, "drop=contribution<1: it needs views"),
        (&[], 2, "OPERATION"),
    ] {
        refused(edit(&scene, &edited, operations), status, part);
        assert!(!edited.exists(), "{operations:?}");
    }
    let bytes = fs::read(&scene).unwrap();
    refused(edit(&scene, &scene, &["scale=2"]), 2, "is an input of this run");
    let other = place.path().join("other.ply");
    fs::write(&other, &bytes).unwrap();
    refused(edit(&scene, &other, &[&format!("add={}", other.display())]), 2, "is an input of this run");
    assert!(fs::read(&scene).unwrap() == bytes && fs::read(&other).unwrap() == bytes);
}

#[test]
fn a_scene_is_edited_part_by_part_as_in_memory() {
    let place = folder();
    let (scene, [parts, whole]) = (ply(place.path()), ["parts.ply", "whole.ply"].map(|name| place.path().join(name)));
    let operations = ["turn=1,1,0:30", "scale=2", "crop=plane:1,0,0,3", "drop=opacity<0.5"];
    let in_parts = edit(&scene, &parts, &operations).done().stdout;
    // A glTF is read as a whole.
    let gltf = place.path().join("scene.glb");
    gs(["convert".as_ref(), scene.as_os_str(), gltf.as_os_str()]).done();
    let in_memory = edit(&gltf, &whole, &operations).done().stdout;
    let done = |text: &str| text.lines().filter(|line| line.starts_with("done")).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(done(&in_parts), done(&in_memory));
    let [parts, whole] = [parts, whole].map(|path| read_3d(path).unwrap().scene);
    assert!(parts.len() == whole.len() && parts.means.iter().zip(&whole.means).all(|(a, b)| a.abs_diff_eq(*b, 1e-5)));
    refused(edit(&scene, &place.path().join("none.ply"), &["drop=x>-99"]), 2, "nothing would be left of the scene");
}

#[test]
fn lengths_and_areas_are_measured() {
    let place = folder();
    let scene = ply(place.path());
    let measure = |what: &str| gs(["info", scene.to_str().unwrap(), "--json", "--measure", what]);
    assert_eq!(measure("0,0,0,3,4,0").json()["length"], 5.0);
    let area = measure("polygon:-1,-99,99,-99,99,99,-1,99").json();
    assert_eq!((&area["area"], &area["gaussians"]), (&19800.0.into(), &10.into()));
    refused(measure("1,2"), 2, "write it as X,Y,Z,X,Y,Z");
}
