//! Text as other programs write it: byte-order marks, NaN, numbers in quotes, and other keys.

use std::fs;

use crate::dataset::Skip;
use glam::dvec2;
use serde_json::json;

use super::{
    made::{folder, model, read, refusal, skipped, text, write_model, write_pictures},
    transforms::{frame, nerfstudio, pinhole, pose, write},
};

#[test]
fn a_byte_order_mark_is_skipped() {
    let place = folder();
    nerfstudio(place.path(), pinhole());
    let path = place.path().join("transforms.json");
    let json = fs::read_to_string(&path).unwrap();
    fs::write(&path, format!("\u{feff}{json}")).unwrap();
    assert_eq!(read(place.path()).views.len(), 2);

    let place = folder();
    let model = model(3);
    let marked = text(&model).map(|bytes| [b"\xef\xbb\xbf", &bytes[..]].concat());
    write_model(&place.path().join("sparse/0"), &marked, "txt");
    write_pictures(&place.path().join("images"), &model, 1);
    let dataset = read(place.path());
    assert_eq!((dataset.views.len(), dataset.points.len()), (3, 3));
}

#[test]
fn text_in_utf_16_is_named() {
    let utf_16 = |text: &str| -> Vec<u8> {
        [0xfeff].into_iter().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect()
    };
    let place = folder();
    nerfstudio(place.path(), pinhole());
    let path = place.path().join("transforms.json");
    let json = fs::read_to_string(&path).unwrap();
    fs::write(&path, utf_16(&json)).unwrap();
    assert!(refusal(place.path()).contains("transforms.json: is text in UTF-16, but must be in UTF-8"));
    fs::write(&path, &utf_16(&json)[2..]).unwrap();
    assert!(refusal(place.path()).contains("UTF-16"), "without a mark");

    let place = folder();
    let mut files = text(&model(2));
    files[1] = utf_16(str::from_utf8(&files[1]).unwrap());
    write_model(&place.path().join("sparse/0"), &files, "txt");
    assert!(refusal(place.path()).contains("images.txt: is text in UTF-16"));
}

#[test]
fn a_pose_with_nan_leaves_out_its_frame() {
    for literal in ["NaN", "Infinity", "-Infinity", "null", "\"nan\""] {
        let place = folder();
        nerfstudio(place.path(), pinhole());
        let path = place.path().join("transforms.json");
        let json = fs::read_to_string(&path).unwrap();
        fs::write(&path, json.replacen("5.0]", &format!("{literal}]"), 1)).unwrap();
        let dataset = read(place.path());
        assert_eq!((dataset.views.len(), skipped(&dataset, Skip::PoseNotFinite)), (1, 1), "{literal}");
        assert!(dataset.remarks.iter().any(|remark| remark.to_string().contains("the pose contains NaN or infinity")));
    }
}

#[test]
fn a_matrix_may_be_one_list_and_a_row_of_null_leaves_out_its_frame() {
    let place = folder();
    nerfstudio(place.path(), pinhole());
    let path = place.path().join("transforms.json");
    let nested = read(place.path());
    let mut json: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    for frame in json["frames"].as_array_mut().unwrap() {
        let flat: Vec<_> = frame["transform_matrix"]
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|row| row.as_array().unwrap().clone())
            .collect();
        frame["transform_matrix"] = flat.into();
    }
    fs::write(&path, json.to_string()).unwrap();
    assert_eq!(read(place.path()).views, nested.views);
    json["frames"][0]["transform_matrix"] = json!([[1.0, 0.0, 0.0, 0.0], null, [0.0, 0.0, 1.0, 0.0]]);
    fs::write(&path, json.to_string()).unwrap();
    assert_eq!(skipped(&read(place.path()), Skip::PoseNotFinite), 1);
    json["frames"][0]["transform_matrix"] = json!({ "rows": 4 });
    fs::write(&path, json.to_string()).unwrap();
    assert!(refusal(place.path()).contains("is not a matrix of numbers"));
}

#[test]
fn whole_numbers_of_a_text_model_may_have_a_point() {
    let place = folder();
    let model = model(3);
    let mut files = text(&model);
    let cameras = String::from_utf8(files[0].clone()).unwrap();
    let (width, height) = (model.cameras[&1].width, model.cameras[&1].height);
    files[0] = cameras.replace(&format!(" {width} {height} "), &format!(" {width}.0 {height}.00 ")).into_bytes();
    assert_ne!(files[0], text(&model)[0]);
    write_model(&place.path().join("sparse/0"), &files, "txt");
    write_pictures(&place.path().join("images"), &model, 1);
    assert_eq!(read(place.path()).views.len(), 3);
    files[0] = cameras.replace(&format!(" {width} "), &format!(" {width}.5 ")).into_bytes();
    write_model(&place.path().join("sparse/0"), &files, "txt");
    assert!(refusal(place.path()).contains("expected a width in px"));
}

#[test]
fn errors_have_the_position_in_the_file_with_nan() {
    let place = folder();
    fs::write(place.path().join("transforms.json"), "{\"a\": [NaN, -Infinity],\n \"b\": NaN, \"frames\" 3}").unwrap();
    let error = refusal(place.path());
    assert!(error.contains("at line 2 column 21"), "{error}");
}

#[test]
fn numbers_in_quotes_are_numbers() {
    let place = folder();
    let mut fields = pinhole();
    fields["w"] = json!("40");
    fields["fl_x"] = json!(" 3.5e1 ");
    nerfstudio(place.path(), fields);
    assert_eq!(read(place.path()).views[0].source.focal, dvec2(35.0, 36.0));
    let mut quoted = frame("images/a.png");
    quoted["transform_matrix"] = pose();
    quoted["transform_matrix"][0][3] = json!("2.0");
    let mut file = pinhole();
    file["frames"] = json!([quoted]);
    write(place.path(), "transforms.json", &file);
    assert_eq!(read(place.path()).views[0].camera.position().x, 2.0);
}

#[test]
fn angles_of_any_key_stand_for_focal_lengths() {
    let place = folder();
    let (x, y) = (2.0 * (20.0 / 35.0_f64).atan(), 2.0 * (15.0 / 36.0_f64).atan());
    for (fields, focal) in [
        (json!({"camera_angle_y": y}), dvec2(36.0, 36.0)),
        (json!({"camera_angle_y": y, "w": 40, "h": 30}), dvec2(36.0, 36.0)),
        (json!({"x_fov": x.to_degrees()}), dvec2(35.0, 35.0)),
        (json!({"y_fov": y.to_degrees()}), dvec2(36.0, 36.0)),
        (json!({"x_fov": x.to_degrees(), "y_fov": y.to_degrees()}), dvec2(35.0, 36.0)),
        (json!({"fl_y": 36.0}), dvec2(36.0, 36.0)),
        (json!({"fl_x": 35.0, "x_fov": 1.0}), dvec2(35.0, 35.0)),
    ] {
        nerfstudio(place.path(), fields.clone());
        assert!(read(place.path()).views[0].source.focal.distance(focal) < 1e-9, "{fields}");
    }
    // A frame's own angle comes before a length that all frames share.
    let mut own = frame("images/a.png");
    own["camera_angle_x"] = json!(x);
    write(place.path(), "transforms.json", &json!({"fl_x": 99.0, "frames": [own]}));
    assert!((read(place.path()).views[0].source.focal.x - 35.0).abs() < 1e-9);
}

#[test]
fn the_key_that_is_wrong_or_missing_is_named() {
    for (fields, fault) in [
        (json!({"fl_x": "wide"}), "fl_x is \"wide\", but must be a number"),
        (json!({"fl_x": [1]}), "fl_x is [1], but must be a number"),
        (json!({"fl_x": "NaN"}), "fl_x is NaN, but must be a number"),
        (json!({"fl_x": 0}), "fl_x is 0, but must be greater than 0"),
        (json!({"fl_x": 35, "fl_y": -1.5}), "fl_y is -1.5, but must be greater than 0"),
        (json!({"camera_angle_x": 40}), "camera_angle_x is 40, but must be between 0 and π rad"),
        (json!({"camera_angle_y": 0}), "camera_angle_y is 0, but must be between 0 and π rad"),
        (json!({"x_fov": 180}), "x_fov is 180, but must be between 0 and 180 degrees"),
        (json!({"fl_x": 35, "w": 40}), "h is missing, but w is there"),
        (json!({"fl_x": 35, "cy": 15}), "cx is missing, but cy is there"),
        (json!({"fl_x": 35, "w": 0, "h": 30}), "w is 0, but must be greater than 0"),
        (json!({"fl_x": 35, "k1": "Infinity"}), "k1 is inf, but must be a number"),
        (
            json!({"w": 40, "h": 30}),
            "no focal length, such as in one of fl_x, fl_y, camera_angle_x, camera_angle_y, x_fov, y_fov",
        ),
    ] {
        let place = folder();
        nerfstudio(place.path(), fields.clone());
        let error = refusal(place.path());
        assert!(error.contains("2 images skipped: the camera's size") && error.contains(fault), "{fields}: {error}");
        assert!(error.contains("(first: images/a.png: in transforms.json, "), "{error}");
    }
    let place = folder();
    nerfstudio(place.path(), json!({"camera_model": 7}));
    assert!(refusal(place.path()).contains("camera model 7 is not known"));
}

#[test]
fn a_frame_without_pose_is_left_out() {
    for pose in [Some(json!(null)), None] {
        let place = folder();
        nerfstudio(place.path(), pinhole());
        let mut file = pinhole();
        let mut bare = json!({"file_path": "images/a.png"});
        if let Some(pose) = pose {
            bare["transform_matrix"] = pose;
        }
        file["frames"] = json!([bare, frame("images/b.png")]);
        write(place.path(), "transforms.json", &file);
        let dataset = read(place.path());
        assert_eq!((dataset.views.len(), skipped(&dataset, Skip::NoPose)), (1, 1));
    }
}

#[test]
fn a_principal_point_outside_of_the_image_is_reported() {
    for (center, fault) in [
        (
            json!({"cx": 500.0}),
            Some(
                "2 images with a principal point outside of the image, as in a cut-out (first: images/a.png: cx is 500, of 40 px)",
            ),
        ),
        (json!({"cy": -0.5}), Some("cy is -0.5, of 30 px")),
        (json!({"cx": 40.0, "cy": 0.0}), None),
    ] {
        let place = folder();
        let mut fields = pinhole();
        fields.as_object_mut().unwrap().extend(center.as_object().unwrap().clone());
        nerfstudio(place.path(), fields);
        let remarks = read(place.path()).remarks.iter().map(ToString::to_string).collect::<String>();
        assert_eq!(remarks.contains("principal point"), fault.is_some(), "{remarks}");
        assert!(remarks.contains(fault.unwrap_or_default()), "{remarks}");
    }
}

#[test]
fn a_missing_line_of_keypoints_is_named() {
    for dropped in [3, 5] {
        let place = folder();
        let mut files = text(&model(3));
        let lines = String::from_utf8(files[1].clone()).unwrap();
        let kept = lines.lines().enumerate().filter(|(i, _)| *i != dropped).map(|(_, line)| format!("{line}\n"));
        files[1] = kept.collect::<String>().into_bytes();
        write_model(&place.path().join("sparse/0"), &files, "txt");
        let error = refusal(place.path());
        let name = if dropped == 3 { "view 000.png" } else { "view 001.png" };
        let expected = format!(
            "images.txt: line {}: expected the keypoints of {name}, the second line of each image, which may be \
             empty, found the next image",
            dropped + 1
        );
        assert!(error.contains(&expected), "{error}");
    }
}
