//! Poses that COLMAP finds in real photographs, against the given ones.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Command, Stdio},
};

use glam::{DMat3, DQuat, DVec3, DVec4};
use gs_conformance::data;
use gs_io::dataset::{DatasetSettings, read_dataset};

use crate::{
    process::{folder, gs},
    train::text,
};

/// A camera: camera-to-world rotation, and position.
type Pose = (DQuat, DVec3);

#[test]
#[ignore = "runs COLMAP for minutes; `cargo xtask poses --test` runs it"]
fn poses_of_real_photographs_are_found_again() {
    if Command::new("colmap").arg("help").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
        return eprintln!("skipped: COLMAP is not installed");
    }
    let parts = [("banana", 0..14, 0.02), ("room", 0..12, 0.05)];
    for (name, range, limit) in parts {
        let Some(given) = data::find(name) else { return };
        let place = folder();
        let [photos, found] = ["photos", "found"].map(|name| place.path().join(name));
        fs::create_dir(&photos).unwrap();
        let images = gs_io::image_files(given.join("images_2")).unwrap();
        for image in &images[range.clone()] {
            fs::copy(image, photos.join(image.file_name().unwrap())).unwrap();
        }
        let verdict = gs(["poses", text(&photos), "-o", text(&found), "--json"]).json();
        eprintln!("{name}: {verdict}");
        let (given, made) = (poses(&given), poses(&found));
        assert!(made.len() * 100 >= range.len() * 95, "{name}: {verdict}");
        let (degrees, distance) = differences(&given, &made);
        eprintln!(
            "{name}: median rotation {degrees:.3} degrees, position {:.3} % of the cameras' spread",
            distance * 100.0
        );
        assert!(degrees < 1.0 && distance < limit, "{name}: {degrees} degrees, {distance}");
        let output = place.path().join("out");
        let words =
            ["train", text(&found), "-o", text(&output), "-i", "300", "--max-size", "200", "--no-report", "--json"];
        let summary = gs(words.into_iter().chain(["--backend", "cpu"])).json();
        let psnr = summary["evaluation"]["psnr"].as_f64().unwrap();
        eprintln!("{name}: PSNR {psnr:.2} dB over held-out views after 300 steps");
        assert!(psnr > 15.0, "{name}: {psnr}");
    }
}

/// The poses of a data set by the names of its images.
fn poses(path: &Path) -> BTreeMap<String, Pose> {
    let dataset = read_dataset(path, &DatasetSettings::default()).unwrap();
    let views = dataset.views.iter().map(|view| {
        let to_world = DQuat::from_mat3(&view.camera.rotation.as_dmat3()).inverse();
        (view.name.clone(), (to_world, to_world * -view.camera.translation.as_dvec3()))
    });
    views.collect()
}

/// Median differences of the cameras that both have, after the best similarity: of rotation, degrees, and of
/// position, as a share of the cameras' spread.
fn differences(given: &BTreeMap<String, Pose>, found: &BTreeMap<String, Pose>) -> (f64, f64) {
    let pairs: Vec<(Pose, Pose)> = found.iter().filter_map(|(name, pose)| Some((*given.get(name)?, *pose))).collect();
    let count = pairs.len() as f64;
    let mean = |of: fn(&(Pose, Pose)) -> DVec3| pairs.iter().map(of).sum::<DVec3>() / count;
    let (to, from) = (mean(|pair| pair.0.1), mean(|pair| pair.1.1));
    let spread = |of: fn(&(Pose, Pose)) -> DVec3, middle: DVec3| {
        (pairs.iter().map(|pair| of(pair).distance_squared(middle)).sum::<f64>() / count).sqrt()
    };
    let (spread_to, spread_from) = (spread(|pair| pair.0.1, to), spread(|pair| pair.1.1, from));
    let covariance = pairs.iter().fold(DMat3::ZERO, |sum, (a, b)| {
        let (a, b) = (a.1 - to, b.1 - from);
        sum + DMat3::from_cols(a * b.x, a * b.y, a * b.z)
    });
    let turn = rotation(covariance);
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let degrees = pairs.iter().map(|(a, b)| a.0.angle_between(turn * b.0).to_degrees());
    let scale = spread_to / spread_from;
    let distance = pairs.iter().map(|(a, b)| (a.1 - to).distance(turn * (b.1 - from) * scale) / spread_to);
    (median(degrees.collect()), median(distance.collect()))
}

/// The rotation R that makes tr(R covariance') largest, by quaternions.
///
/// *Source:* Horn, "Closed-form solution of absolute orientation using unit quaternions", 1987.
fn rotation(covariance: DMat3) -> DQuat {
    // Rows of the sums of products, source by target.
    let s = covariance.to_cols_array_2d();
    let at = |from: usize, to: usize| s[from][to];
    let trace = at(0, 0) + at(1, 1) + at(2, 2);
    let (x, y, z) = (at(1, 2) - at(2, 1), at(2, 0) - at(0, 2), at(0, 1) - at(1, 0));
    let rows = [
        DVec4::new(trace, x, y, z),
        DVec4::new(x, 2.0 * at(0, 0) - trace, at(0, 1) + at(1, 0), at(2, 0) + at(0, 2)),
        DVec4::new(y, at(0, 1) + at(1, 0), 2.0 * at(1, 1) - trace, at(1, 2) + at(2, 1)),
        DVec4::new(z, at(2, 0) + at(0, 2), at(1, 2) + at(2, 1), 2.0 * at(2, 2) - trace),
    ];
    // Above the size of every eigenvalue, so that the largest is found.
    let shift = rows.iter().map(|row| row.abs().element_sum()).fold(0.0, f64::max);
    let mut q = DVec4::new(1.0, 0.1, 0.2, 0.3).normalize();
    for _ in 0..20_000 {
        q = (DVec4::from_array(rows.map(|row| row.dot(q))) + q * shift).normalize();
    }
    DQuat::from_xyzw(q.y, q.z, q.w, q.x)
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
    other.values_mut().for_each(|pose| pose.0 *= DQuat::from_rotation_x(0.1));
    assert!((differences(&poses, &other).0 - 0.1_f64.to_degrees()).abs() < 1e-3);
}
