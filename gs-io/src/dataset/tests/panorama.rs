//! 360° images are split into six views, the faces of a cube.

use std::{f64::consts::PI, fs, path::Path};

use crate::dataset::{
    AlphaMeaning, CameraModel, ColmapCamera, CubeFace, Dataset, DatasetSettings, Skip, Split, read_dataset,
};
use glam::{DMat3, DQuat, DVec3, Vec2, Vec3, dvec3};
use gs_core::{Camera, Image};
use image::{ImageBuffer, Rgba};
use serde_json::json;

use super::made::{binary, folder, model, picture, read, refusal, skipped, write_model};

const SIZE: (u32, u32) = (512, 256);

/// A smooth function of the direction in the world.
fn of_direction(direction: Vec3) -> [f32; 3] {
    let d = direction.normalize();
    [0.5 + 0.4 * (3.0 * d.x + d.z).sin(), 0.5 + 0.4 * (2.5 * d.y).cos() * d.z, 0.5 + 0.3 * (d.x * d.y + d.z)]
}

/// The direction of a pixel of a 360° image in the camera's axes: right, down, forward.
fn direction((x, y): (u32, u32), (width, height): (u32, u32)) -> DVec3 {
    let longitude = 2.0 * PI * ((f64::from(x) + 0.5) / f64::from(width) - 0.5);
    let latitude = PI * ((f64::from(y) + 0.5) / f64::from(height) - 0.5);
    dvec3(longitude.sin() * latitude.cos(), latitude.sin(), longitude.cos() * latitude.cos())
}

/// The 360° image of a camera with this world-to-camera rotation.
fn panorama(rotation: DMat3, size: (u32, u32)) -> Image {
    let color = |x, y| of_direction((rotation.transpose() * direction((x, y), size)).as_vec3());
    Image::from_fn(size.0, size.1, color).unwrap()
}

/// A COLMAP data set of `count` 360° images of this size.
fn colmap(root: &Path, count: u32, (width, height): (u32, u32)) -> Vec<DMat3> {
    let mut model = model(count);
    let parameters = vec![f64::from(width), f64::from(height)];
    let (width, height) = (width.into(), height.into());
    let camera = ColmapCamera { model: CameraModel::Equirectangular, width, height, parameters };
    model.cameras = [(1, camera.clone()), (7, camera)].into();
    model.images.iter_mut().for_each(|image| image.rotation *= DQuat::from_rotation_z(0.4));
    write_model(&root.join("sparse/0"), &binary(&model), "bin");
    fs::create_dir_all(root.join("images")).unwrap();
    let write = |image: &crate::dataset::colmap::ColmapImage| {
        let rotation = DMat3::from_quat(image.rotation);
        let size = (width as u32, height as u32);
        crate::write_png(root.join("images").join(&image.name), &panorama(rotation, size)).unwrap();
        rotation
    };
    model.images.iter().map(write).collect()
}

/// Direction of a pixel in the world.
fn ray(camera: &Camera, x: u32, y: u32) -> Vec3 {
    let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
    camera.rotation.transpose() * ((at - camera.center) / camera.focal).extend(1.0)
}

/// Largest difference of the views' pixels from the function of their direction.
fn worst(dataset: &Dataset) -> f32 {
    let mut worst = 0.0_f32;
    for view in &dataset.views {
        let posed = view.read_image().unwrap();
        assert_eq!((posed.image.size(), &posed.mask), ((view.camera.width, view.camera.height), &None));
        for y in 0..view.camera.height {
            for x in 0..view.camera.width {
                let expected = of_direction(ray(&view.camera, x, y));
                let differences = posed.image.pixel(x, y).into_iter().zip(expected).map(|(a, b)| (a - b).abs());
                worst = differences.fold(worst, f32::max);
            }
        }
    }
    worst
}

#[test]
fn each_face_shows_what_a_pinhole_there_would_have_seen() {
    let place = folder();
    colmap(place.path(), 2, SIZE);
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 12);
    assert!(dataset.views.windows(2).all(|pair| pair[0].name < pair[1].name));
    for view in &dataset.views {
        view.camera.validate().unwrap();
        assert_eq!((view.camera.width, view.camera.height, view.camera.focal), (128, 128, Vec2::splat(64.0)));
        let face = view.source.face().unwrap();
        assert!(view.name.ends_with(&format!(".png#{}", face.name())), "{}", view.name);
    }
    let positions: Vec<Vec3> = dataset.views.iter().map(|view| view.camera.position()).collect();
    assert!(positions[..6].iter().all(|position| position.distance(positions[0]) < 1e-6));
    // Half a step of 8 bits in the file and in the face, and the interpolation's error.
    let worst = worst(&dataset);
    assert!(worst < 0.006, "{worst}");
    let lines: Vec<String> = dataset.remarks.iter().map(ToString::to_string).collect();
    let expected = "2 360° images split into the six faces of a cube each: 12 views".to_owned();
    assert!(lines.contains(&expected), "{lines:?}");
}

#[test]
fn nerfstudio_means_the_same() {
    let place = folder();
    // Camera-to-world with axes right, up, back; turned about the upward axis by a right angle, so
    // that the camera looks along world +x.
    let rows = json!([[0.0, 0.0, -1.0, 1.0], [0.0, 1.0, 0.0, 2.0], [1.0, 0.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0]]);
    let rotation = DMat3::from_cols(DVec3::Z, DVec3::NEG_Y, DVec3::X).transpose();
    fs::create_dir(place.path().join("images")).unwrap();
    let write = |name: &str, size| crate::write_png(place.path().join(name), &panorama(rotation, size)).unwrap();
    write("images/a.png", SIZE);
    let frame = json!({"file_path": "images/a.png", "transform_matrix": rows});
    let transforms = |fields: serde_json::Value| {
        let mut file = json!({"camera_model": "EQUIRECTANGULAR", "frames": [frame]});
        file.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        fs::write(place.path().join("transforms.json"), file.to_string()).unwrap();
    };
    for fields in [json!({}), json!({"w": 512, "h": 256, "fl_x": 256.0, "fl_y": 256.0, "cx": 256.0, "cy": 128.0})] {
        transforms(fields);
        let dataset = read(place.path());
        let front = dataset.views.iter().find(|view| view.name == "images/a.png#front").unwrap();
        assert!(front.camera.rotation.row(2).distance(Vec3::X) < 1e-6 && front.source.face() == Some(CubeFace::Front));
        assert!(front.camera.position().distance(Vec3::new(1.0, 2.0, 3.0)) < 1e-5);
        let worst = worst(&dataset);
        assert!(worst < 0.004, "{worst}");
    }
    write("images/a.png", (512, 200));
    transforms(json!({}));
    let error = refusal(place.path());
    assert!(error.contains("a 360° image (equirectangular) must be twice as wide as high"), "{error}");
    assert!(error.contains("images/a.png: it is 512x200 px"), "{error}");
}

#[test]
fn whole_images_are_held_out() {
    let place = folder();
    colmap(place.path(), 10, (32, 16));
    let dataset = read(place.path());
    let held: Vec<&str> = dataset.views_of(Split::Test).map(|view| view.name.split('#').next().unwrap()).collect();
    assert_eq!(held, [["view 000.png"; 6], ["view 008.png"; 6]].concat());
    assert_eq!(dataset.views_of(Split::Train).count(), 48);
    assert_eq!(skipped(&dataset, Skip::Panorama), 0);
}

#[test]
fn only_images_twice_as_wide_as_high_show_all_directions() {
    let place = folder();
    colmap(place.path(), 2, (512, 200));
    assert!(
        refusal(place.path())
            .contains("2 images skipped: a 360° image (equirectangular) must be twice as wide as high")
    );
}

#[test]
fn faces_are_scaled_down_and_keep_alpha_and_mask() {
    let place = folder();
    let rotation = colmap(place.path(), 1, SIZE)[0];
    let settings = DatasetSettings::default().with(|s| s.max_side = std::num::NonZeroU32::new(50));
    let small = read_dataset(place.path(), &settings).unwrap();
    assert_eq!(small.views[0].camera.width, 50);
    let difference = worst(&small);
    assert!(difference < 0.01, "means over areas bend a little: {difference}");

    // Opaque where the world's x is positive, in an image whose transparent half is glaring.
    let right = |x, y| (rotation.transpose() * direction((x, y), SIZE)).x > 0.0;
    let pixel = |x, y| Rgba(if right(x, y) { [0_u8, 102, 255, 255] } else { [255, 0, 0, 0] });
    let file = place.path().join("images/view 000.png");
    ImageBuffer::from_fn(SIZE.0, SIZE.1, pixel).save(&file).unwrap();
    for meaning in [AlphaMeaning::Opacity, AlphaMeaning::Mask] {
        let settings = DatasetSettings::default().with(|s| s.alpha = meaning);
        for view in read_dataset(place.path(), &settings).unwrap().views {
            let posed = view.read_image().unwrap();
            for y in 0..128 {
                for x in 0..128 {
                    let (index, along) = ((y * 128 + x) as usize, ray(&view.camera, x, y).normalize().x);
                    // Where the cubic reaches over the edge, both are possible.
                    if along.abs() < 0.06 {
                        continue;
                    }
                    match (&posed.alpha, &posed.mask) {
                        (Some(alpha), None) => assert!((alpha[index] - f32::from(along > 0.0)).abs() < 1e-5),
                        (None, Some(mask)) => assert_eq!(mask[index], along > 0.0),
                        _ => assert!(meaning == AlphaMeaning::Mask && along > 0.0, "a face without masked pixels"),
                    }
                    if along > 0.0 {
                        let [red, _, blue] = posed.image.pixel(x, y);
                        assert!(red < 1e-5 && blue > 0.999, "{red} {blue}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_360_image_of_a_perspective_camera_is_one_clear_error() {
    let place = folder();
    let mut model = model(2);
    let parameters = vec![100.0, 100.0, 128.0, 64.0];
    let camera = ColmapCamera { model: CameraModel::Pinhole, width: 256, height: 128, parameters };
    model.cameras = [(1, camera)].into();
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    let file = |i: usize| place.path().join("images").join(&model.images[i].name);
    (0..2).for_each(|i| drop(picture(file(i), 256, 128)));
    assert_eq!(read(place.path()).views.len(), 2, "ordinary wide images");
    crate::write_png(file(0), &panorama(DMat3::IDENTITY, (256, 128))).unwrap();
    let error = refusal(place.path());
    assert!(
        error.contains("view 000.png: it is twice as wide as high") && error.contains("EQUIRECTANGULAR"),
        "{error}"
    );
    // A drawing before white has equal borders, too, but nothing on them.
    let drawing = |x: u32, y: u32| [if (100..140).contains(&x) && (40..90).contains(&y) { 0.0 } else { 1.0 }; 3];
    crate::write_png(file(0), &Image::from_fn(256, 128, drawing).unwrap()).unwrap();
    assert_eq!(read(place.path()).views.len(), 2);
}
