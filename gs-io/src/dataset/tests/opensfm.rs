//! `reconstruction.json` of OpenSfM and OpenDroneMap.

use std::{fs, path::Path};

use glam::{DVec2, DVec3, dvec2, dvec3};
use serde_json::{Value, json};

use super::made::{folder, picture, pixel, read, refusal, skipped, world_points};
use crate::dataset::{DatasetKind, Remark, Skip};

/// Angle-axis vector and translation of the shot `i`, which has the origin before it.
fn shot(i: usize) -> [DVec3; 2] {
    [dvec3(0.1, -0.2, 0.3) * i as f64, dvec3(0.2, -0.1 * i as f64, 4.0)]
}

/// One reconstruction with three shots by this camera, of 80×60 px.
fn reconstruction(camera: Value) -> Value {
    let mut whole = json!({"width": 80, "height": 60});
    whole.as_object_mut().unwrap().extend(camera.as_object().unwrap().clone());
    let shots = (0..3).map(|i| {
        let [rotation, translation] = shot(i).map(|vector| vector.to_array());
        (format!("{i}.png"), json!({"camera": "v2 a", "rotation": rotation, "translation": translation}))
    });
    let point = json!({"coordinates": [1.0, 2.0, 3.0], "color": [255.0, 51.0, 0.0]});
    json!([{"cameras": {"v2 a": whole}, "shots": shots.collect::<serde_json::Map<_, _>>(), "points": {"7": point}}])
}

fn write(root: &Path, content: &Value) {
    (0..3).for_each(|i| drop(picture(root.join(format!("images/{i}.png")), 40, 30)));
    fs::write(root.join("reconstruction.json"), content.to_string()).unwrap();
}

/// Small files for the fuzz target, of an image `a.png` of 20×10 px.
pub(super) fn seeds() -> Vec<Vec<u8>> {
    let shot = json!({"camera": "1", "rotation": [0.1, 0.2, 0.3], "translation": [0.0, 0.0, 4.0]});
    let camera = |camera: Value| {
        let point = json!({"coordinates": [1, 2, 3], "color": [255, 51, 0]});
        json!([{"cameras": {"1": camera}, "shots": {"a.png": shot}, "points": {"7": point}}]).to_string().into_bytes()
    };
    vec![
        camera(json!({"width": 20, "height": 10, "focal": 0.9, "k1": 0.01, "k2": -0.02})),
        camera(
            json!({"projection_type": "brown", "width": 20, "height": 10, "focal_x": 0.9, "focal_y": 0.8, "c_x": 0.01, "p1": 1e-3}),
        ),
        camera(json!({"projection_type": "fisheye_opencv", "width": 20, "height": 10, "focal_x": 0.3, "focal_y": 0.3})),
        camera(json!({"projection_type": "spherical", "width": 20, "height": 10})),
    ]
}

/// Where OpenSfM's documentation says that a camera shows a point, in units of the longer side from the
/// image's centre.
fn documented(camera: &Value, seen: DVec3) -> DVec2 {
    let number = |key: &str| camera[key].as_f64().unwrap_or(0.0);
    let kind = camera["projection_type"].as_str().unwrap();
    let [k1, k2, k3, k4, p1, p2] = ["k1", "k2", "k3", "k4", "p1", "p2"].map(number);
    let (x, y) = (seen.x / seen.z, seen.y / seen.z);
    let r2 = x * x + y * y;
    let theta = r2.sqrt().atan();
    let t2 = theta * theta;
    let perspective = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
    let fisheye = (1.0 + k1 * t2 + k2 * t2.powi(2) + k3 * t2.powi(3) + k4 * t2.powi(4)) * theta / r2.sqrt();
    let f = number("focal");
    let (fx, fy, cx, cy) = (number("focal_x"), number("focal_y"), number("c_x"), number("c_y"));
    match kind {
        "perspective" => dvec2(f * perspective * x, f * perspective * y),
        "fisheye" => dvec2(f * fisheye * x, f * fisheye * y),
        "fisheye_opencv" => dvec2(fx * fisheye * x + cx, fy * fisheye * y + cy),
        _ => dvec2(
            fx * (perspective * x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)) + cx,
            fy * (perspective * y + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y)) + cy,
        ),
    }
}

/// Rodrigues' formula.
fn rotated(vector: DVec3, point: DVec3) -> DVec3 {
    let angle = vector.length();
    if angle == 0.0 {
        return point;
    }
    let axis = vector / angle;
    point * angle.cos() + axis.cross(point) * angle.sin() + axis * axis.dot(point) * (1.0 - angle.cos())
}

#[test]
fn points_appear_where_the_formulas_of_opensfm_say() {
    for camera in [
        json!({"projection_type": "perspective", "focal": 0.9, "k1": 0.05, "k2": -0.02}),
        json!({"projection_type": "perspective", "focal": 0.9, "k1": 0.0, "k2": 0.0}),
        json!({"projection_type": "simple_radial", "focal_x": 0.9, "focal_y": 0.8, "c_x": 0.01, "c_y": -0.02, "k1": 0.05}),
        json!({"projection_type": "radial", "focal_x": 0.9, "focal_y": 0.8, "c_x": 0.01, "c_y": -0.02, "k1": 0.05, "k2": 0.01}),
        json!({"projection_type": "brown", "focal_x": 0.9, "focal_y": 0.8, "c_x": 0.01, "c_y": -0.02, "k1": 0.05, "k2": -0.02, "k3": 0.01, "p1": 0.003, "p2": -0.002}),
        json!({"projection_type": "fisheye", "focal": 0.9, "k1": 0.05, "k2": -0.02}),
        json!({"projection_type": "fisheye_opencv", "focal_x": 0.9, "focal_y": 0.8, "c_x": 0.01, "c_y": -0.02, "k1": 0.05, "k2": -0.02, "k3": 0.01, "k4": 0.002}),
    ] {
        let place = folder();
        write(place.path(), &reconstruction(camera.clone()));
        let dataset = read(place.path());
        assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::OpenSfm, 3));
        for (i, point) in (0..3).flat_map(|i| world_points().map(move |point| (i, point))) {
            let [rotation, translation] = shot(i);
            let seen = rotated(rotation, point) + translation;
            let expected = dvec2(20.0, 15.0) + 40.0 * documented(&camera, seen);
            let found = pixel(&dataset, &format!("{i}.png"), point).unwrap();
            assert!(found.distance(expected) < 1e-4, "{found} for {expected} of {camera}");
        }
        let point = dataset.points[0];
        assert_eq!((point.position.to_array(), point.color), ([1.0, 2.0, 3.0], [1.0, 0.2, 0.0]));
    }
}

#[test]
fn a_360_image_is_split() {
    let place = folder();
    write(place.path(), &reconstruction(json!({"projection_type": "equirectangular", "width": 80, "height": 40})));
    (0..3).for_each(|i| drop(picture(place.path().join(format!("images/{i}.png")), 40, 20)));
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 18);
    let front = dataset.views.iter().find(|view| view.name == "1.png#front").unwrap();
    let [rotation, translation] = shot(1);
    let ahead = rotated(-rotation, DVec3::Z * 2.0 - translation).as_vec3();
    let (pixel, _) = front.camera.project(ahead).unwrap();
    assert!(pixel.distance(front.camera.center) < 1e-4, "the middle of the image is ahead");
}

#[test]
fn the_largest_piece_is_read_and_the_others_are_named() {
    let place = folder();
    let camera = json!({"focal": 0.9});
    let mut pieces = reconstruction(camera.clone());
    let small = json!({"cameras": {}, "shots": {"4.png": {"camera": "v2 a", "rotation": [0, 0, 0]}}});
    pieces.as_array_mut().unwrap().insert(0, small);
    write(place.path(), &pieces);
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 3);
    let remarks: Vec<String> = dataset.remarks.iter().map(ToString::to_string).collect();
    let expected = "of several models, a piece of 3 images is read, not a piece of 1 image";
    assert!(remarks.iter().any(|remark| remark == expected), "{remarks:?}");
}

#[test]
fn the_folder_of_opendronemap_and_the_file_may_be_named() {
    let place = folder();
    write(place.path(), &reconstruction(json!({"focal": 0.9})));
    let (inner, masks) = (place.path().join("opensfm"), place.path().join("masks"));
    fs::create_dir(&inner).unwrap();
    fs::rename(place.path().join("reconstruction.json"), inner.join("reconstruction.json")).unwrap();
    picture(masks.join("1.png.png"), 40, 30);
    for named in [place.path(), &inner, &inner.join("reconstruction.json")] {
        let dataset = read(named);
        assert_eq!(dataset.views.len(), 3, "{}", named.display());
        assert_eq!(dataset.views.iter().filter(|view| view.mask.is_some()).count(), 1);
        assert!(dataset.files().iter().any(|file| file.ends_with("opensfm/reconstruction.json")));
        assert!(!dataset.remarks.iter().any(|remark| matches!(remark, Remark::MasksUnused { .. })));
    }
    // A whole data set in a folder of this name.
    let other = folder();
    let root = other.path().join("opensfm");
    fs::create_dir_all(root.join("opensfm")).unwrap();
    picture(other.path().join("images/x.png"), 40, 30);
    fs::copy(inner.join("reconstruction.json"), root.join("opensfm/reconstruction.json")).unwrap();
    (0..3).for_each(|i| drop(picture(root.join(format!("images_2/{i}.png")), 40, 30)));
    assert_eq!(read(&root).views.len(), 3);
    fs::rename(root.join("opensfm/reconstruction.json"), root.join("reconstruction.json")).unwrap();
    assert_eq!(read(&root).views.len(), 3);
}

#[test]
fn malformed_files_are_refused_with_the_reason() {
    let place = folder();
    let says = |content: &Value, words: &str| {
        write(place.path(), content);
        let error = refusal(place.path());
        assert!(error.contains(words), "{error} does not say {words}");
    };
    let with = |camera: Value| reconstruction(camera);
    says(
        &with(json!({"projection_type": "dual", "focal": 0.9})),
        "camera model \"dual\" is not known (known: perspective",
    );
    says(&with(json!({"projection_type": 7, "focal": 0.9})), "camera model 7 is not known");
    says(&with(json!({"k1": 0.1})), "in camera v2 a, focal_x is missing");
    says(&with(json!({"focal": "wide"})), "focal is \"wide\", but must be a number");
    says(&with(json!({"focal": -1.0})), "focal is -1, but must be greater than 0");
    says(&with(json!({"focal": 0.9, "k1": null})), "k1 is NaN, but must be a number");
    says(&with(json!({"focal": 0.9, "width": 0})), "width is 0, but must be greater than 0");
    says(&with(json!({"focal": 0.9, "width": 1e300})), "the camera has");
    says(&json!([]), "it lists none");
    says(&json!([{"cameras": {}}]), "missing field `shots`");
    says(&json!({"cameras": {}, "shots": {}}), "expected a sequence");
    let mut left = reconstruction(json!({"focal": 0.9}));
    left[0]["shots"]["../4.png"] = left[0]["shots"]["1.png"].clone();
    says(&left, "the image name `../4.png` leads out of the data set's folder");
    let whole = reconstruction(json!({"focal": 0.9})).to_string();
    fs::write(place.path().join("reconstruction.json"), &whole[..whole.len() - 9]).unwrap();
    assert!(refusal(place.path()).contains("EOF while parsing"));
}

#[test]
fn shots_that_cannot_be_used_are_counted() {
    let place = folder();
    let mut file = reconstruction(json!({"focal": 0.9}));
    file[0]["shots"]["0.png"]["camera"] = json!("another");
    file[0]["shots"]["1.png"]["rotation"] = json!([0.0, null, 0.0]);
    file[0]["shots"]["4.png"] = json!({"camera": "v2 a", "rotation": [0, 0, 0]});
    file[0]["points"]["8"] = json!({"coordinates": [0.0, null, 0.0], "color": [1, 2, 3]});
    write(place.path(), &file);
    let dataset = read(place.path());
    assert_eq!((dataset.views.len(), dataset.points.len()), (1, 1));
    for why in [Skip::NoCamera, Skip::PoseNotFinite, Skip::NoImage] {
        assert_eq!(skipped(&dataset, why), 1, "{why}");
    }
    assert!(dataset.remarks.contains(&Remark::PointsNotFinite { count: 1 }));
}
