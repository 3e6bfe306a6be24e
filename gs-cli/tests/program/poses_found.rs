//! Poses that COLMAP finds in photographs, made up and real, against the given ones.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Command, Stdio},
};

use glam::{DMat3, DQuat, DVec3};
use gs_conformance::data;
use gs_core::{Camera, math::similarity::Similarity};
use gs_io::dataset::{DatasetSettings, read_dataset};

use crate::{
    made_photographs,
    process::{Run, command, folder, gs},
    train::text,
};

/// A camera: camera-to-world rotation, and position.
type Pose = (DQuat, DVec3);

#[test]
#[ignore = "runs COLMAP for minutes; `cargo xtask poses --test` runs it"]
fn poses_of_photographs_are_found_again() {
    if Command::new("colmap").arg("help").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
        return eprintln!("skipped: COLMAP is not installed");
    }
    let place = folder();
    let cameras = made_photographs::cameras(14, [640, 480]);
    made_photographs::write(&cameras, place.path());
    let exact = (0..).zip(&cameras).map(|(i, camera)| (format!("{i:02}.png"), pose_of(camera))).collect();
    found_again("made up", &mut command(), place.path(), &exact, [0.15, 0.005]);
    match std::env::var_os("GS_PYTHON") {
        Some(_) => found_again("made up, by PyCOLMAP", command().env("PATH", ""), place.path(), &exact, [0.15, 0.005]),
        None => eprintln!("skipped: GS_PYTHON names no Python with PyCOLMAP"),
    }
    // Of the room, photographs that show one part of it. They are 375 pixels wide, and its given model was found from
    // ten times as many of twice the size.
    let parts = [("banana", "", 14, [0.3, 0.01]), ("room", "5_1_", 12, [2.5, 0.12])];
    for (name, prefix, count, limits) in parts {
        let Some(given) = data::find(name) else { return };
        let photos = folder();
        let images = gs_io::image_files(given.join("images_2")).unwrap();
        let names = images.iter().map(|image| image.file_name().unwrap().to_str().unwrap());
        for name in names.filter(|name| name.starts_with(prefix)).take(count) {
            fs::copy(given.join("images_2").join(name), photos.path().join(name)).unwrap();
        }
        found_again(name, &mut command(), photos.path(), &poses(&given), limits);
    }
}

/// Finds the poses of the photographs in a folder with this program, and trains a scene with them. In the median, they may
/// differ from the given ones by so many degrees and this share of the spread.
fn found_again(name: &str, program: &mut Command, photos: &Path, given: &BTreeMap<String, Pose>, limits: [f64; 2]) {
    let place = folder();
    let [found, output] = ["found", "out"].map(|name| place.path().join(name));
    let verdict = Run::of(program.args(["poses", text(photos), "-o", text(&found), "--json"])).json();
    eprintln!("{name}: {verdict}");
    let made = poses(&found);
    let count = fs::read_dir(photos).unwrap().count();
    assert!(made.len() * 100 >= count * 95, "{name}: {verdict}");
    let (degrees, distance) = differences(given, &made);
    eprintln!(
        "{name}: median rotation {degrees:.3} degrees, position {:.3} % of the cameras' spread",
        distance * 100.0
    );
    assert!(degrees < limits[0] && distance < limits[1], "{name}: {degrees} degrees, {distance}");
    let words = ["train", text(&found), "-o", text(&output), "-i", "300", "--max-size", "200", "--no-report", "--json"];
    let summary = gs(words.into_iter().chain(["--backend", "cpu"])).json();
    let psnr = summary["evaluation"]["psnr"].as_f64().unwrap();
    eprintln!("{name}: PSNR {psnr:.2} dB over held-out views after 300 steps");
    assert!(psnr > 15.0, "{name}: {psnr}");
}

/// The poses of a data set by the names of its images.
fn poses(path: &Path) -> BTreeMap<String, Pose> {
    let dataset = read_dataset(path, &DatasetSettings::default()).unwrap();
    dataset.views.iter().map(|view| (view.name.clone(), pose_of(&view.camera))).collect()
}

fn pose_of(camera: &Camera) -> Pose {
    let to_world = DQuat::from_mat3(&camera.rotation.as_dmat3()).inverse();
    (to_world, to_world * -camera.translation.as_dvec3())
}

/// Median differences of the cameras that both have, after a similarity: of rotation, degrees, and of position, as a
/// share of the cameras' spread.
///
/// The rotation of the similarity is the mean over the cameras: positions do not tell it where they lie on a line, as
/// those of a person who turns around do nearly.
fn differences(given: &BTreeMap<String, Pose>, found: &BTreeMap<String, Pose>) -> (f64, f64) {
    let pairs: Vec<(Pose, Pose)> = found.iter().filter_map(|(name, pose)| Some((*given.get(name)?, *pose))).collect();
    let count = pairs.len() as f64;
    let middle = pairs.iter().map(|(to, _)| to.1).sum::<DVec3>() / count;
    let spread = (pairs.iter().map(|(to, _)| to.1.distance_squared(middle)).sum::<f64>() / count).sqrt();
    let turns = pairs.iter().map(|(to, from)| DMat3::from_quat(to.0 * from.0.inverse())).sum::<DMat3>();
    let points: Vec<_> = pairs.iter().map(|(to, from)| (from.1, to.1, 1.0)).collect();
    let similarity = Similarity::between(&points, turns * (1e6 * spread * spread)).unwrap();
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let degrees = pairs.iter().map(|(a, b)| a.0.angle_between(similarity.rotation * b.0).to_degrees());
    let distance = pairs.iter().map(|(a, b)| a.1.distance(similarity.apply(b.1)) / spread);
    (median(degrees.collect()), median(distance.collect()))
}

#[test]
fn a_similarity_makes_no_difference() {
    let poses: BTreeMap<String, Pose> = (0..6)
        .map(|i| {
            let i = f64::from(i);
            let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3 * i, -0.2 * i, 0.1);
            (i.to_string(), (rotation, DVec3::new(i, (2.0 * i).sin(), (3.0 * i).cos())))
        })
        .collect();
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 2.0, -0.7, 1.1);
    let moved = |pose: &Pose| (turn * pose.0, turn * pose.1 * 3.0 + DVec3::new(4.0, 5.0, 6.0));
    let mut other: BTreeMap<String, Pose> = poses.iter().map(|(name, pose)| (name.clone(), moved(pose))).collect();
    let (degrees, distance) = differences(&poses, &other);
    assert!(degrees < 1e-3 && distance < 1e-6, "{degrees} {distance}");
    // Every other camera turned: the mean turns by half, so that all differ by it.
    other.values_mut().step_by(2).for_each(|pose| pose.0 = DQuat::from_rotation_x(0.1) * pose.0);
    let (degrees, distance) = differences(&poses, &other);
    assert!((degrees - 0.05_f64.to_degrees()).abs() < 1e-2 && distance > 0.01, "{degrees} {distance}");
}
