//! Real data sets in `$GS_DATA` or `../shared/data`, if they are there.

use std::collections::HashMap;

use crate::dataset::{ColmapModel, Dataset, DatasetKind, Distortion, Remark, Split};
use glam::{DVec3, Vec2};
use gs_conformance::data;

use super::made::read;

/// Mean distance between projected and observed positions of the model's points, px at full size:
/// with the lens in the original image, and through the views' pinholes. Also the number of points.
fn reprojection_errors(dataset: &Dataset, model: &ColmapModel) -> (f64, f64, usize) {
    let points: HashMap<u64, DVec3> = model.points.iter().map(|point| (point.id, point.position)).collect();
    let (mut bent, mut straight, mut count) = (0.0, 0.0, 0);
    for image in &model.images {
        let full = model.cameras[&image.camera_id].source().unwrap();
        let view = dataset.views.iter().find(|view| view.name == image.name).unwrap();
        let scale = f64::from(view.source.width) / f64::from(full.width);
        for observation in &image.observations {
            let Some(world) = observation.point.map(|id| points[&id]) else { continue };
            let p = image.rotation.normalize() * world + image.translation;
            bent += full.to_pixel(p.truncate() / p.z).unwrap().distance(observation.position);
            let (pixel, _) = view.camera.project(world.as_vec3()).unwrap();
            // Where the pinhole would have observed it.
            let ray = full.to_ray(observation.position).unwrap();
            let observed = ray.as_vec2() * view.camera.focal + view.camera.center;
            straight += f64::from(pixel.distance(observed)) / scale;
            count += 1;
        }
    }
    (bent / f64::from(count), straight / f64::from(count), count as usize)
}

#[test]
fn banana() {
    let Some(folder) = data::find("banana") else { return };
    let dataset = read(&folder);
    assert_eq!((dataset.kind, dataset.views.len(), dataset.points.len()), (DatasetKind::Colmap, 14, 5932));
    assert_eq!((dataset.views_of(Split::Test).count(), dataset.views_of(Split::Train).count()), (2, 12));
    let scaled = Remark::Scaled { count: 14, from: (1600, 1063), to: (800, 532) };
    assert_eq!(dataset.remarks, [scaled, Remark::PointsCoincide { count: 345 }]);
    let model = ColmapModel::read(&folder.join("sparse/0")).unwrap();
    let full = model.cameras.values().next().unwrap().source().unwrap();
    let camera = dataset.views[0].camera;
    let expected = Vec2::new(full.focal.x as f32 * 0.5, full.focal.y as f32 * 532.0 / 1063.0);
    assert!(camera.focal.abs_diff_eq(expected, 1e-3) && (camera.center - Vec2::new(400.0, 266.0)).length() < 1.0);
    let (bent, straight, count) = reprojection_errors(&dataset, &model);
    eprintln!("banana: {count} observations, {bent:.3} px, through the views {straight:.3} px");
    assert!(count > 20_000 && bent < 1.5 && (straight - bent).abs() < 0.01, "{bent} {straight} {count}");
    let posed = dataset.views[3].read_image().unwrap();
    assert_eq!((posed.image.size(), posed.alpha, posed.mask), ((800, 532), None, None));
}

#[test]
fn lund_door() {
    let Some(folder) = data::find("lund_door") else { return };
    let dataset = read(&folder);
    assert_eq!((dataset.kind, dataset.views.len(), dataset.points.len()), (DatasetKind::Colmap, 12, 10_960));
    let undistorted = Remark::Undistorted { count: 12, lens: "Brown-Conrady" };
    assert_eq!(dataset.remarks, [undistorted, Remark::PointsCoincide { count: 424 }]);
    let view = &dataset.views[0];
    assert!(matches!(view.source.lens.distortion(), Distortion::BrownConrady(lens) if lens.radial[0] == -0.0336422));
    assert_eq!((view.source.width, view.source.height), (1296, 1936));
    assert!(
        (1297..1320).contains(&view.camera.width) && (1937..1970).contains(&view.camera.height),
        "{:?}",
        view.camera
    );
    let model = ColmapModel::read(&folder.join("sparse/0")).unwrap();
    let (bent, straight, count) = reprojection_errors(&dataset, &model);
    eprintln!("lund_door: {count} observations, {bent:.3} px, through the views {straight:.3} px");
    assert!(count > 50_000 && bent < 1.5 && (straight - bent).abs() < 0.05, "{bent} {straight} {count}");
    let posed = view.read_image().unwrap();
    assert_eq!((posed.image.size(), posed.mask), ((view.camera.width, view.camera.height), None));

    // COLMAP's point colours are those of the undistorted pixels where they project.
    let (mut at_place, mut elsewhere, mut seen) = (0.0, 0.0, 0.0);
    let difference = |color: [f32; 3], pixel: [f32; 3]| (0..3).map(|k| (color[k] - pixel[k]).abs()).sum::<f32>() / 3.0;
    let numbers: HashMap<u64, usize> = model.points.iter().enumerate().map(|(i, point)| (point.id, i)).collect();
    for id in
        model.images.iter().find(|image| image.name == view.name).unwrap().observations.iter().filter_map(|o| o.point)
    {
        let point = &model.points[numbers[&id]];
        let color = point.color.map(|c| f32::from(c) / 255.0);
        let (pixel, _) = view.camera.project(point.position.as_vec3()).unwrap();
        let (x, y) = (pixel.x as u32, pixel.y as u32);
        if x < view.camera.width && y < view.camera.height {
            at_place += difference(color, posed.image.pixel(x, y));
            elsewhere += difference(color, posed.image.pixel(view.camera.width - 1 - x, y));
            seen += 1.0;
        }
    }
    assert!(seen > 1000.0 && at_place / seen < 0.06 && elsewhere > 2.0 * at_place, "{at_place} {elsewhere} {seen}");
}

#[test]
fn lego() {
    let Some(folder) = data::find("lego") else { return };
    let dataset = read(&folder);
    assert_eq!((dataset.kind, dataset.points.len()), (DatasetKind::Blender, 0));
    assert_eq!((dataset.views_of(Split::Train).count(), dataset.views_of(Split::Test).count()), (100, 25));
    assert_eq!(dataset.remarks, [Remark::NoPoints]);
    let expected = 200.0 / (0.5 * 0.691_111_2_f32).tan();
    for view in &dataset.views {
        assert_eq!((view.camera.width, view.camera.height), (400, 400));
        assert!(view.camera.focal.abs_diff_eq(Vec2::splat(expected), 1e-2));
        // Every camera looks at the object in the middle of the world from a distance of about 4.
        let (pixel, depth) = view.camera.project(glam::Vec3::ZERO).unwrap();
        assert!(
            pixel.distance(Vec2::splat(200.0)) < 1.0 && (depth - 4.03).abs() < 0.1,
            "{} {pixel} {depth}",
            view.name
        );
    }
    let posed = dataset.views[0].read_image().unwrap();
    let alpha = posed.alpha.as_ref().unwrap();
    let opaque = alpha.iter().filter(|a| **a > 0.99).count() as f32 / alpha.len() as f32;
    assert!((0.1..0.5).contains(&opaque) && alpha[0] == 0.0, "{opaque}");
    assert_eq!(posed.over([1.0; 3]).unwrap().pixel(0, 0), [1.0; 3]);
}
