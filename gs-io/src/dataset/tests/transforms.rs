//! Variants of `transforms.json`: shared and own intrinsics, lenses, splits, points, and errors.

use std::{fs, path::Path};

use crate::{
    WorldFrame,
    dataset::{DatasetKind, DatasetSettings, Distortion, Remark, Skip, Split, read_dataset},
};
use glam::{Vec2, Vec3, dvec2};
use serde_json::{Value, json};

use super::made::{binary, folder, model, picture, read, refusal, skipped, write_model};

/// Camera-to-world at (2, 3, 5), looking along −z with y up.
pub(super) fn pose() -> Value {
    json!([[1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 3.0], [0.0, 0.0, 1.0, 5.0], [0.0, 0.0, 0.0, 1.0]])
}

pub(super) fn frame(file: &str) -> Value {
    json!({"file_path": file, "transform_matrix": pose()})
}

pub(super) fn write(root: &Path, name: &str, value: &Value) {
    fs::write(root.join(name), value.to_string()).unwrap();
}

/// Two frames of 40×30 px, `images/a.png` and `images/b.png`, with these other fields.
pub(super) fn nerfstudio(root: &Path, fields: Value) {
    for name in ["a", "b"] {
        picture(root.join(format!("images/{name}.png")), 40, 30);
    }
    let mut file = json!({"frames": [frame("images/a.png"), frame("./images/b.png")]});
    file.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    write(root, "transforms.json", &file);
}

pub(super) fn pinhole() -> Value {
    json!({"fl_x": 35.0, "fl_y": 36.0, "cx": 19.0, "cy": 16.0, "w": 40, "h": 30})
}

#[test]
fn cameras_look_along_minus_z_with_y_up() {
    let place = folder();
    nerfstudio(place.path(), pinhole());
    for path in [place.path().to_owned(), place.path().join("transforms.json")] {
        let dataset = read(&path);
        assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::Nerfstudio, 2));
        assert_eq!(dataset.views[1].name, "images/b.png");
        let camera = dataset.views[0].camera;
        assert_eq!((camera.focal, camera.center), (Vec2::new(35.0, 36.0), Vec2::new(19.0, 16.0)));
        assert_eq!(camera.position(), Vec3::new(2.0, 3.0, 5.0));
        let (pixel, depth) = camera.project(Vec3::new(3.0, 4.0, 3.0)).unwrap();
        assert_eq!((pixel, depth), (Vec2::new(19.0 + 17.5, 16.0 - 18.0), 2.0), "up is up");
        assert_eq!(camera.project(Vec3::new(2.0, 3.0, 6.0)), None, "behind");
    }
}

#[test]
fn a_frame_may_have_a_camera_of_its_own() {
    let place = folder();
    nerfstudio(place.path(), pinhole());
    let mut own = frame("images/a.png");
    own.as_object_mut().unwrap().extend(json!({"fl_x": 50.0, "fl_y": null, "k1": 0.01}).as_object().unwrap().clone());
    let mut file = pinhole();
    file["frames"] = json!([own, frame("images/b.png")]);
    write(place.path(), "transforms.json", &file);
    let views = read(place.path()).views;
    assert_eq!((views[0].source.focal, views[1].source.focal), (dvec2(50.0, 36.0), dvec2(35.0, 36.0)));
    assert!(!views[0].source.lens.is_pinhole() && views[1].source.lens.is_pinhole());
}

#[test]
fn angles_stand_for_focal_lengths() {
    let place = folder();
    nerfstudio(place.path(), json!({"camera_angle_x": 1.0}));
    let focal = 20.0 / 0.5_f64.tan();
    let source = read(place.path()).views[0].source;
    assert!(source.focal.distance(dvec2(focal, focal)) < 1e-9 && source.center == dvec2(20.0, 15.0));
    nerfstudio(place.path(), json!({"camera_angle_x": 1.0, "camera_angle_y": 0.5, "w": 80.0, "h": 60.0}));
    let source = read(place.path()).views[0].source;
    assert!(source.focal.distance(dvec2(focal, 15.0 / 0.25_f64.tan())) < 1e-9);
    nerfstudio(place.path(), json!({"fl_x": 30.0}));
    assert_eq!(read(place.path()).views[0].source.focal, dvec2(30.0, 30.0));
}

#[test]
fn lenses_follow_from_model_and_coefficients() {
    let place = folder();
    let lens = |fields: Value| {
        let mut all = pinhole();
        all.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        nerfstudio(place.path(), all);
        *read(place.path()).views[0].source.lens.distortion()
    };
    assert_eq!(lens(json!({"camera_model": "OPENCV", "k1": 0.0, "p2": 0.0})), Distortion::None);
    let Distortion::BrownConrady(bent) =
        lens(json!({"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4, "p1": 0.05, "p2": 0.06}))
    else {
        panic!("not a perspective lens")
    };
    assert_eq!((bent.radial, bent.tangential, bent.divisor), ([0.1, 0.2, 0.3, 0.4], [0.05, 0.06], [0.0; 3]));
    for fields in [json!({"camera_model": "OPENCV_FISHEYE", "k1": 0.1}), json!({"is_fisheye": true, "k1": 0.1})] {
        let Distortion::Fisheye(bent) = lens(fields) else { panic!("not a fisheye") };
        assert_eq!(bent.radial, [0.1, 0.0, 0.0, 0.0]);
    }
    nerfstudio(place.path(), json!({"camera_model": "EQUIRECTANGULAR"}));
    assert!(refusal(place.path()).contains("360° image"));
    nerfstudio(place.path(), json!({"camera_model": "PERISCOPE"}));
    assert!(refusal(place.path()).contains("camera model PERISCOPE is not known (known: OPENCV_FISHEYE"));
}

#[test]
fn smaller_copies_are_taken_where_the_originals_are_missing() {
    let place = folder();
    nerfstudio(place.path(), json!({"fl_x": 30.0}));
    fs::remove_dir_all(place.path().join("images")).unwrap();
    for name in ["a", "b"] {
        picture(place.path().join(format!("images_2/{name}.png")), 20, 15);
    }
    let view = &read(place.path()).views[0];
    assert_eq!((view.source.width, view.source.focal.x), (20, 15.0), "the folder's name gives the scale");
    picture(place.path().join("elsewhere/a.png"), 40, 30);
    let settings = DatasetSettings::default().with(|s| s.image_folder = Some("elsewhere".to_owned()));
    let dataset = read_dataset(place.path(), &settings).unwrap();
    assert_eq!((dataset.views.len(), skipped(&dataset, Skip::NoImage)), (1, 1));
}

#[test]
fn frames_that_cannot_be_used_are_counted() {
    let place = folder();
    nerfstudio(place.path(), pinhole());
    let matrix = |rows: Value| json!({"file_path": "images/b.png", "transform_matrix": rows});
    let mut reflected = pose();
    reflected[0][0] = json!(-1.0);
    let mut no_image = frame("images/c.png");
    no_image["mask_path"] = json!("masks/c.png");
    let mut file = pinhole();
    file["frames"] = json!([
        frame("images/a.png"),
        frame("./images/a.png"),
        no_image,
        matrix(json!([])),
        {"file_path": "images/1", "transform_matrix": reflected},
        {"file_path": "images/2", "transform_matrix": [[1, 0, 0, 0], [0, 1, 0], [0, 0, 1, 0]]},
        {"file_path": "images/3", "transform_matrix": pose(), "w": -40},
    ]);
    picture(place.path().join("images/3.png"), 40, 30);
    write(place.path(), "transforms.json", &file);
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 1);
    for (reason, count) in [(Skip::SameName, 1), (Skip::NoImage, 1), (Skip::BadPose, 3), (Skip::BadCamera, 1)] {
        assert_eq!(skipped(&dataset, reason), count, "{reason:?}: {:?}", dataset.remarks);
    }
    nerfstudio(place.path(), json!({"w": 40, "h": 30}));
    assert!(refusal(place.path()).contains("focal lengths"));
}

#[test]
fn a_split_that_the_file_lists_is_kept() {
    let place = folder();
    let mut fields = pinhole();
    fields["train_filenames"] = json!(["images/a.png"]);
    fields["test_filenames"] = json!(["./images/b.png"]);
    nerfstudio(place.path(), fields);
    let splits: Vec<_> = read(place.path()).views.iter().map(|view| view.split).collect();
    assert_eq!(splits, [Split::Train, Split::Test]);
    nerfstudio(place.path(), pinhole());
    let splits: Vec<_> = read(place.path()).views.iter().map(|view| view.split).collect();
    assert_eq!(splits, [Split::Test, Split::Train], "else every eighth");
}

#[test]
fn listed_points_are_in_the_files_world_and_colmaps_are_moved_there() {
    let place = folder();
    let mut fields = pinhole();
    fields["applied_transform"] = json!([[0, 1, 0, 10], [1, 0, 0, 0], [0, 0, -1, 0]]);
    fields["applied_scale"] = json!(2.0);
    fields["ply_file_path"] = json!("points.ply");
    nerfstudio(place.path(), fields.clone());
    assert!(read(place.path()).remarks.contains(&Remark::PointsMissing { file: "points.ply".to_owned() }));
    let in_world = DatasetSettings::default().with(|s| s.frame = Some(WorldFrame::WORLD));
    let first_point = || read_dataset(place.path(), &in_world).unwrap().points[0].position;
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    fs::write(place.path().join("points.ply"), ply).unwrap();
    assert_eq!(first_point(), Vec3::new(1.0, 2.0, 3.0));
    fs::write(place.path().join("points.ply"), "ply\n").unwrap();
    assert!(refusal(place.path()).contains("points.ply"));

    write_model(&place.path().join("colmap/sparse/0"), &binary(&model(1)), "bin");
    fields.as_object_mut().unwrap().remove("ply_file_path");
    nerfstudio(place.path(), fields);
    // (3, −½, 2) rotated, translated and scaled.
    assert_eq!(first_point(), Vec3::new(19.0, 6.0, -4.0));
    nerfstudio(place.path(), pinhole());
    assert_eq!(first_point(), Vec3::new(-0.5, 3.0, -2.0), "what old files did unsaid");
}

#[test]
fn blender_files_say_what_is_for_tests() {
    let place = folder();
    for (split, count) in [("train", 3), ("val", 1), ("test", 2)] {
        let frames: Vec<Value> = (0..count).map(|i| frame(&format!("./{split}/r_{i}"))).collect();
        (0..count).for_each(|i| drop(picture(place.path().join(format!("{split}/r_{i}.png")), 40, 40)));
        let file = json!({"camera_angle_x": 0.7, "frames": frames});
        write(place.path(), &format!("transforms_{split}.json"), &file);
    }
    let dataset = read(place.path());
    assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::Blender, 6));
    let count = |split| dataset.views_of(split).count();
    assert_eq!((count(Split::Train), count(Split::Validation), count(Split::Test)), (3, 1, 2));
    assert!(dataset.views_of(Split::Test).all(|view| view.name.starts_with("test/r_")));
    assert_eq!(dataset.remarks, [Remark::NoPoints]);
    for split in ["val", "test"] {
        fs::remove_file(place.path().join(format!("transforms_{split}.json"))).unwrap();
    }
    assert_eq!(read(place.path()).views_of(Split::Test).count(), 1, "every eighth, where all are for training");
}

#[test]
fn broken_json_is_refused_in_one_line() {
    let place = folder();
    nerfstudio(place.path(), pinhole());
    let good = fs::read_to_string(place.path().join("transforms.json")).unwrap();
    let nested = format!("{{\"frames\": {}", "[".repeat(100_000));
    for bad in [
        "",
        "{",
        "[]",
        "{\"frames\": 3}",
        "{}",
        "{\"frames\": [{}]}",
        "{\"frames\": NaN}",
        &nested,
        &good[..good.len() / 2],
        &good.replace("35.0", "1e999"),
    ] {
        fs::write(place.path().join("transforms.json"), bad).unwrap();
        assert!(refusal(place.path()).contains("transforms.json: "), "{bad:.40}");
    }
    fs::write(place.path().join("transforms.json"), "{\"frames\": []}").unwrap();
    assert!(refusal(place.path()).contains("it lists none"));
}

#[test]
fn a_data_set_is_written_with_other_cameras_and_read_again() {
    let place = folder();
    super::made::colmap(place.path(), 9);
    let dataset = super::made::read(place.path());
    let moved = |view: &crate::dataset::View| view.camera.moved(glam::Vec3::new(0.1, -0.2, 0.3), 0.02 * glam::Vec3::Y);
    let refined = place.path().join("refined");
    fs::create_dir(&refined).unwrap();
    fs::write(refined.join("transforms.json"), dataset.transforms_json(moved, Some("points.ply")).unwrap()).unwrap();
    fs::write(refined.join("points.ply"), dataset.points_ply()).unwrap();
    let transforms = read_dataset(&refined, &DatasetSettings::default().with(|s| s.allow_outside = true)).unwrap();
    assert!(transforms.views.iter().any(|view| view.split == crate::dataset::Split::Test));
    let model = place.path().join("model");
    fs::create_dir(&model).unwrap();
    for (name, text) in dataset.colmap_text(moved).unwrap() {
        fs::write(model.join(name), text).unwrap();
    }
    let images = dataset.views[0].image.parent().map(|folder| folder.display().to_string());
    let colmap = read_dataset(&model, &DatasetSettings::default().with(|s| s.image_folder = images)).unwrap();
    for again in [transforms, colmap] {
        assert_eq!((again.views.len(), again.points.len()), (dataset.views.len(), dataset.points.len()));
        for (view, of_file) in dataset.views.iter().zip(&again.views) {
            let (camera, found) = (moved(view), of_file.camera);
            assert_eq!((view.split, &view.image), (of_file.split, &of_file.image));
            assert_eq!((camera.focal, camera.center, camera.width), (found.focal, found.center, found.width));
            assert!(camera.rotation.abs_diff_eq(found.rotation, 1e-6), "{camera:?} {found:?}");
            assert!(camera.translation.abs_diff_eq(found.translation, 1e-5), "{camera:?} {found:?}");
        }
        for (point, found) in dataset.points.iter().zip(&again.points) {
            assert!(point.position.abs_diff_eq(found.position, 1e-6), "{point:?} {found:?}");
            assert!(point.color.iter().zip(found.color).all(|(a, b)| (a - b).abs() < 1e-6), "{point:?} {found:?}");
        }
    }
}

#[test]
fn lenses_are_written_and_read_again() {
    for fields in [
        json!({"k1": 0.1, "k2": -0.02, "p1": 0.005, "p2": 0.006}),
        json!({"camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k2": 0.01, "k3": 0.002, "k4": -0.001}),
    ] {
        let place = folder();
        let mut all = pinhole();
        all.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        nerfstudio(place.path(), all);
        let dataset = read(place.path());
        let written = place.path().join("written");
        fs::create_dir(&written).unwrap();
        fs::write(written.join("transforms.json"), dataset.transforms_json(|view| view.camera, None).unwrap()).unwrap();
        let again = read_dataset(&written, &DatasetSettings::default().with(|s| s.allow_outside = true)).unwrap();
        let lenses = |dataset: &crate::dataset::Dataset| -> Vec<Distortion> {
            dataset.views.iter().map(|view| *view.source.lens.distortion()).collect()
        };
        assert!(lenses(&dataset).iter().all(|lens| *lens != Distortion::None));
        assert_eq!(lenses(&again), lenses(&dataset));
    }
}
