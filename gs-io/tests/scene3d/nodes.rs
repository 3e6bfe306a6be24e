//! Nodes, colour spaces and integers of glTF.

use glam::{Mat3, Quat, Vec3};
use gs_core::{Scene, Scene3d};
use gs_io::{ConversionLoss, WriteOptions3d};
use serde_json::{Value, json};

use super::samples::{read, scene, written};

fn document(scene: &Scene3d) -> Value {
    serde_json::from_slice(&written("a.gltf", scene, &WriteOptions3d::default())).unwrap()
}

fn decoded(json: &Value) -> gs_io::File3d {
    read(json.to_string().as_bytes(), "a.gltf").unwrap()
}

#[test]
fn nodes_move_turn_and_scale_what_is_below_them() {
    let before = scene(3, 2);
    let mut json = document(&before);
    let (turn, shift) = (Quat::from_rotation_y(0.5), Vec3::new(1.0, 2.0, 3.0));
    json["nodes"] = json!([
        { "children": [1], "rotation": turn.to_array(), "scale": [2, 2, 2] },
        { "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, shift.x, shift.y, shift.z, 1] }
    ]);
    let file = decoded(&json);
    assert_eq!(file.losses, []);
    // From our axes to glTF's, through the nodes, and back.
    let axes = Mat3::from_diagonal(Vec3::new(-1.0, -1.0, 1.0));
    let map = axes * Mat3::from_quat(turn) * 2.0 * axes;
    for i in 0..3 {
        let mean = axes * (Mat3::from_quat(turn) * 2.0 * (axes * before.means[i] + shift));
        assert!(file.scene.means[i].abs_diff_eq(mean, 1e-5), "{} {mean}", file.scene.means[i]);
        let frame = map * before.gaussian(i).factor().unwrap();
        let (expected, found) = (frame * frame.transpose(), file.scene.gaussian(i).covariance().unwrap());
        assert!(found.abs_diff_eq(expected, 1e-5 * expected.x_axis.length().max(1.0)), "{found} {expected}");
    }
    assert!(file.scene.sh[0] == before.sh[0] && file.scene.sh[1].abs_diff_eq(before.sh[1], 1e-6), "the colour, and y");
    assert!(!file.scene.sh[2].abs_diff_eq(before.sh[2], 0.01), "z turns");
}

#[test]
fn unequal_scales_are_said() {
    let mut json = document(&scene(2, 1));
    json["nodes"] = json!([{ "mesh": 0, "scale": [1, 2, 3] }]);
    assert_eq!(decoded(&json).losses, [ConversionLoss::Stretched]);
}

#[test]
fn a_mesh_stands_wherever_a_node_puts_it_and_degrees_mix() {
    let mut json = document(&scene(2, 1));
    let other = document(&scene(1, 0));
    // The second mesh has its own accessors, views and buffer.
    for (list, fields) in [("accessors", vec!["bufferView"]), ("bufferViews", vec!["buffer"]), ("buffers", vec![])] {
        let offset = match list {
            "accessors" => json["bufferViews"].as_array().unwrap().len(),
            _ => json["buffers"].as_array().unwrap().len(),
        };
        for item in other[list].as_array().unwrap() {
            let mut item = item.clone();
            fields.iter().for_each(|&field| item[field] = json!(item[field].as_u64().unwrap() + offset as u64));
            json[list].as_array_mut().unwrap().push(item);
        }
    }
    let mut mesh = other["meshes"][0].clone();
    let first = document(&scene(2, 1))["accessors"].as_array().unwrap().len() as u64;
    let attributes = mesh["primitives"][0]["attributes"].as_object_mut().unwrap();
    attributes.values_mut().for_each(|number| *number = json!(number.as_u64().unwrap() + first));
    json["meshes"].as_array_mut().unwrap().push(mesh);
    json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 1 }, { "mesh": 0, "translation": [0, 0, 5] }]);
    json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let scene = decoded(&json).scene;
    scene.validate().unwrap();
    assert_eq!((scene.len(), scene.sh_degree), (5, 1));
    assert_eq!(scene.means[3] - scene.means[0], Vec3::new(0.0, 0.0, 5.0));
    assert_eq!(scene.gaussian(2).sh[1..], [Vec3::ZERO; 3]);
}

#[test]
fn linear_light_and_draft_scales_are_converted_and_said() {
    let before = scene(2, 1);
    let mut json = document(&before);
    json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["colorSpace"] =
        json!("lin_rec709_display");
    let file = decoded(&json);
    assert_eq!(file.losses, [ConversionLoss::LinearLight]);
    assert!(file.scene.sh[0] != before.sh[0]);

    // Here SCALE refers to the means, some of which are negative, so they are read as logarithms.
    let mut json = document(&before);
    let attributes = &mut json["meshes"][0]["primitives"][0]["attributes"];
    attributes["KHR_gaussian_splatting:SCALE"] = attributes["POSITION"].clone();
    let file = decoded(&json);
    assert_eq!(file.losses, [ConversionLoss::DraftScales]);
    assert_eq!(file.scene.log_scales[1], Vec3::new(-1.0, -1.0, 1.0) * before.means[1]);
}
