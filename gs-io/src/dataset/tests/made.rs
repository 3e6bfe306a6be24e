//! Small data sets in the formats of COLMAP, Nerfstudio and Blender.

use std::{
    fmt::Write,
    fs,
    path::{Path, PathBuf},
};

use crate::dataset::{
    CameraModel, ColmapCamera, ColmapModel, Dataset, DatasetSettings, Remark, Skip,
    colmap::{ColmapImage, ColmapObservation, ColmapPoint},
    read_dataset,
};
use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};
use gs_core::Image;

pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Writes a picture with gradients in x and y, and returns its path.
pub(crate) fn picture(path: PathBuf, width: u32, height: u32) -> PathBuf {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let color = |x: u32, y: u32| [x as f32 / width as f32, y as f32 / height as f32, 0.5];
    crate::write_png(&path, &Image::from_fn(width, height, color).unwrap()).unwrap();
    path
}

/// A model of two cameras (a pinhole of 40×30 px, a slightly distorted one of 32×24 px), `count`
/// images and three points.
pub(crate) fn model(count: u32) -> ColmapModel {
    let pinhole =
        ColmapCamera { model: CameraModel::Pinhole, width: 40, height: 30, parameters: vec![30.0, 31.0, 20.0, 15.5] };
    let bent = ColmapCamera {
        model: CameraModel::SimpleRadial,
        width: 32,
        height: 24,
        parameters: vec![30.0, 16.0, 12.0, -0.1],
    };
    let image = |i: u32| ColmapImage {
        id: i + 1,
        rotation: DQuat::from_rotation_y(0.1 * f64::from(i)),
        translation: dvec3(f64::from(i), 0.25, 4.0),
        camera_id: if i % 3 == 2 { 7 } else { 1 },
        name: format!("view {i:03}.png"),
        observations: (0..i % 3)
            .map(|k| ColmapObservation { position: dvec2(f64::from(k) + 0.5, 3.25), point: (k == 0).then_some(5) })
            .collect(),
    };
    let point =
        |id: u64| ColmapPoint { id, position: dvec3(id as f64, -0.5, 2.0), color: [255, 51, id as u8], error: 0.75 };
    ColmapModel {
        cameras: [(1, pinhole), (7, bent)].into(),
        images: (0..count).map(image).collect(),
        points: [3, 5, 9].map(point).into(),
    }
}

/// `cameras.bin`, `images.bin`, `points3D.bin`.
pub(crate) fn binary(model: &ColmapModel) -> [Vec<u8>; 3] {
    let mut cameras = (model.cameras.len() as u64).to_le_bytes().to_vec();
    for (id, camera) in &model.cameras {
        cameras.extend(id.to_le_bytes());
        cameras.extend((camera.model as u32).to_le_bytes());
        cameras.extend(camera.width.to_le_bytes());
        cameras.extend(camera.height.to_le_bytes());
        cameras.extend(camera.parameters.iter().flat_map(|v| v.to_le_bytes()));
    }
    let mut images = (model.images.len() as u64).to_le_bytes().to_vec();
    for image in &model.images {
        images.extend(image.id.to_le_bytes());
        let (q, t) = (image.rotation, image.translation);
        images.extend([q.w, q.x, q.y, q.z, t.x, t.y, t.z].iter().flat_map(|v| v.to_le_bytes()));
        images.extend(image.camera_id.to_le_bytes());
        images.extend(image.name.bytes().chain([0]));
        images.extend((image.observations.len() as u64).to_le_bytes());
        for ColmapObservation { position, point } in &image.observations {
            images.extend([position.x, position.y].iter().flat_map(|v| v.to_le_bytes()));
            images.extend(point.unwrap_or(u64::MAX).to_le_bytes());
        }
    }
    let mut points = (model.points.len() as u64).to_le_bytes().to_vec();
    for point in &model.points {
        points.extend(point.id.to_le_bytes());
        points.extend(point.position.to_array().iter().flat_map(|v| v.to_le_bytes()));
        points.extend(point.color);
        points.extend(point.error.to_le_bytes());
        points.extend(2_u64.to_le_bytes());
        points.extend([1_u32, 0, 2, 1].iter().flat_map(|v| v.to_le_bytes()));
    }
    [cameras, images, points]
}

/// `cameras.txt`, `images.txt`, `points3D.txt`.
pub(crate) fn text(model: &ColmapModel) -> [Vec<u8>; 3] {
    let mut cameras = "# Camera list\n".to_owned();
    for (id, camera) in &model.cameras {
        let _ = write!(cameras, "{id} {} {} {}", camera.model.name(), camera.width, camera.height);
        camera.parameters.iter().for_each(|v| write!(cameras, " {v}").unwrap());
        cameras.push('\n');
    }
    let mut images = "# Image list\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n".to_owned();
    for image in &model.images {
        let (q, t) = (image.rotation, image.translation);
        let _ = write!(images, "{} {} {} {} {} ", image.id, q.w, q.x, q.y, q.z);
        let _ = writeln!(images, "{} {} {} {} {}", t.x, t.y, t.z, image.camera_id, image.name);
        for ColmapObservation { position, point } in &image.observations {
            let point = point.map_or("-1".to_owned(), |point| point.to_string());
            let _ = write!(images, "{} {} {point} ", position.x, position.y);
        }
        images.push('\n');
    }
    let mut points = "# 3D point list\r\n".to_owned();
    for point in &model.points {
        let (p, [r, g, b]) = (point.position, point.color);
        let _ = write!(points, "{} {} {} {} {r} {g} {b} {} 1 0 2 1\r\n", point.id, p.x, p.y, p.z, point.error);
    }
    [cameras, images, points].map(String::into_bytes)
}

/// Writes a model's files into a folder.
pub(crate) fn write_model(folder: &Path, files: &[Vec<u8>; 3], extension: &str) {
    fs::create_dir_all(folder).unwrap();
    for (name, bytes) in ["cameras", "images", "points3D"].iter().zip(files) {
        fs::write(folder.join(name).with_extension(extension), bytes).unwrap();
    }
}

/// Writes the images of a model below `folder`, their sides divided by `shrink`.
pub(crate) fn write_pictures(folder: &Path, model: &ColmapModel, shrink: u32) {
    for image in &model.images {
        let Some(camera) = model.cameras.get(&image.camera_id) else { continue };
        picture(folder.join(&image.name), camera.width as u32 / shrink, camera.height as u32 / shrink);
    }
}

/// A whole COLMAP data set of `count` views.
pub(crate) fn colmap(root: &Path, count: u32) -> ColmapModel {
    let model = model(count);
    write_model(&root.join("sparse/0"), &binary(&model), "bin");
    write_pictures(&root.join("images"), &model, 1);
    model
}

pub(crate) fn read(root: &Path) -> Dataset {
    read_dataset(root, &DatasetSettings::default()).unwrap()
}

/// Number of views that were skipped for a reason.
pub(crate) fn skipped(dataset: &Dataset, reason: Skip) -> usize {
    let count = |remark: &Remark| match remark {
        Remark::Skipped { why, count, .. } if *why == reason => Some(*count),
        _ => None,
    };
    dataset.remarks.iter().find_map(count).unwrap_or(0)
}

/// Where a view's image file shows a point of the world, px; `None` if it does not.
pub(crate) fn pixel(dataset: &Dataset, name: &str, point: DVec3) -> Option<DVec2> {
    let view = dataset.views.iter().find(|view| view.name == name)?;
    let point = dataset.frame.to_frame(point);
    let seen = view.camera.rotation.as_dmat3() * point + view.camera.translation.as_dvec3();
    (seen.z > 0.0).then(|| view.source.to_pixel(seen.truncate() / seen.z))?
}

/// Points around the origin.
pub(crate) fn world_points() -> impl Iterator<Item = DVec3> {
    let at = |i: u32| 0.4 * (f64::from(i) - 1.0);
    (0..27).map(move |i| dvec3(at(i % 3), at(i / 3 % 3), at(i / 9)))
}

/// The error of reading this; its text must be one line that names the folder.
pub(crate) fn refusal(root: &Path) -> String {
    let error = read_dataset(root, &DatasetSettings::default()).unwrap_err().to_string();
    assert!(!error.contains('\n') && error.contains(root.to_str().unwrap()), "{error:?}");
    error
}
