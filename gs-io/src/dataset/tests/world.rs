//! Data sets whose world `f32` cannot resolve, or whose unit is unusual.

use crate::{
    WorldFrame,
    dataset::{ColmapModel, Dataset, DatasetSettings, Remark, read_dataset},
};
use glam::{DQuat, DVec3};

use super::made::{binary, folder, model, text, write_model, write_pictures};

/// A model of eight views on a ring of radius 3, with a point for each, in the frame
/// world = offset + scale · frame.
fn ring(offset: DVec3, scale: f64) -> ColmapModel {
    let mut model = model(8);
    let point = model.points[0];
    model.points.clear();
    for (i, image) in model.images.iter_mut().enumerate() {
        let angle = i as f64 * 0.7;
        let eye = 3.0 * DVec3::new(angle.cos(), 0.1 * angle, angle.sin());
        image.rotation = DQuat::from_rotation_y(-angle);
        image.translation = -(image.rotation * (offset + scale * eye));
        let position = offset + scale * (0.3 * eye + DVec3::Y);
        model.points.push(crate::dataset::colmap::ColmapPoint { id: i as u64, position, ..point });
    }
    model
}

fn read_ring(offset: DVec3, scale: f64, frame: Option<WorldFrame>) -> Dataset {
    let place = folder();
    let model = ring(offset, scale);
    write_pictures(&place.path().join("images"), &model, 1);
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    let settings = DatasetSettings::default().with(|s| s.frame = frame);
    let from_binary = read_dataset(place.path(), &settings).unwrap();
    std::fs::remove_dir_all(place.path().join("sparse/0")).unwrap();
    write_model(&place.path().join("sparse/0"), &text(&model), "txt");
    let from_text = read_dataset(place.path(), &settings).unwrap();
    assert_eq!((from_binary.frame, &from_binary.points), (from_text.frame, &from_text.points));
    from_binary
}

/// The largest difference of a camera's position or a point, in units of the frame.
fn difference(a: &Dataset, b: &Dataset) -> f32 {
    let cameras = a.views.iter().zip(&b.views).map(|(a, b)| a.camera.position().distance(b.camera.position()));
    let points = a.points.iter().zip(&b.points).map(|(a, b)| a.position.distance(b.position));
    cameras.chain(points).fold(0.0, f32::max)
}

#[test]
fn units_and_origins_of_the_world_do_not_change_a_data_set() {
    let usual = read_ring(DVec3::ZERO, 1.0, None);
    assert_eq!(usual.frame, WorldFrame::WORLD);
    for exponent in [-5, -3, 3, 5] {
        let scaled = read_ring(DVec3::ZERO, 10f64.powi(exponent), None);
        assert_eq!(scaled.frame.unit, 10f64.powi(exponent));
        assert!(difference(&usual, &scaled) <= 1e-6);
        assert!(scaled.remarks.iter().any(|remark| matches!(remark, Remark::Frame { .. })));
    }
    let far = read_ring(DVec3::new(4.5e6, 451_230.0, 120.0), 1.0, None);
    assert_eq!(far.frame, WorldFrame { origin: DVec3::new(4.5e6, 451_230.0, 120.0), unit: 1.0 });
    assert!(difference(&usual, &far) <= 1e-6);
}

#[test]
fn a_data_set_is_read_into_the_frame_of_a_scene() {
    let offset = DVec3::new(4.5e6, 451_230.0, 120.0);
    let own = read_ring(offset, 100.0, None);
    assert_eq!(own.frame.unit, 100.0);
    let frame = WorldFrame { origin: offset + DVec3::X, unit: 10.0 };
    let moved = read_ring(offset, 100.0, Some(frame));
    assert_eq!(moved.frame, frame);
    for (a, b) in own.points.iter().zip(&moved.points) {
        let place = own.frame.to(&frame).transform_point3(a.position.as_dvec3());
        assert!(place.as_vec3().distance(b.position) < 2e-4, "{place} {}", b.position);
    }
}

#[test]
fn copies_of_points_are_left_out() {
    let place = folder();
    let model = ring(DVec3::ZERO, 1.0);
    write_pictures(&place.path().join("images"), &model, 1);
    let read = |model: &ColmapModel| {
        write_model(&place.path().join("sparse/0"), &binary(model), "bin");
        read_dataset(place.path(), &DatasetSettings::default()).unwrap()
    };
    let once = read(&model);
    let points = model.points.iter().flat_map(|point| [*point; 5]).collect();
    let copied = read(&ColmapModel { points, ..model });
    assert_eq!(copied.points, once.points);
    assert!(copied.remarks.contains(&Remark::PointsCoincide { count: 32 }), "{:?}", copied.remarks);
}
