//! Wide fish-eyes are split into the faces of a cube that they see.

use std::{fs, path::Path};

use crate::dataset::{CameraModel, ColmapCamera, CubeFace, Dataset, Remark, Split, View};
use glam::{DVec2, DVec3, Vec2, Vec3, dvec2, dvec3};
use gs_core::Image;
use serde_json::json;

use super::made::{binary, folder, model, read, refusal, write_model};

const SIDE: u32 = 128;
/// Half the angle of view of the images, rad (95°).
const HALF_ANGLE: f64 = 95.0 / 180.0 * std::f64::consts::PI;
/// Radius of the image circle, px.
const CIRCLE: f64 = 62.0;

/// A smooth function of the direction in the camera, never black.
fn of_direction(direction: Vec3) -> [f32; 3] {
    let d = direction.normalize();
    [0.5 + 0.3 * (3.0 * d.x + d.z).sin(), 0.5 + 0.3 * (2.5 * d.y).cos() * d.z, 0.5 + 0.3 * (d.x * d.y + d.z) / 2.0]
}

/// The angle from the axis at a radius of the lens θ(1 + kθ²), by bisection.
fn angle_at(radius: f64, k: f64) -> f64 {
    let (mut low, mut high) = (0.0, 3.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if middle * (1.0 + k * middle * middle) < radius { low = middle } else { high = middle }
    }
    low
}

/// The direction of a position in an image with the focal length `focal`, in the camera's axes.
fn direction(at: DVec2, focal: f64, k: f64) -> (DVec3, f64) {
    let from_center = (at - 0.5 * f64::from(SIDE)) / focal;
    let angle = angle_at(from_center.length(), k);
    let around = from_center.normalize_or_zero() * angle.sin();
    (dvec3(around.x, around.y, angle.cos()), angle)
}

/// A fish-eye image that is black beyond an angle.
fn picture(focal: f64, k: f64, half_angle: f64) -> Image {
    let color = |x: u32, y: u32| {
        let (direction, angle) = direction(dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5), focal, k);
        if angle <= half_angle { of_direction(direction.as_vec3()) } else { [0.0; 3] }
    };
    Image::from_fn(SIDE, SIDE, color).unwrap()
}

/// A COLMAP data set of two such images; COLMAP states no image circle.
fn colmap(root: &Path, model_of_lens: CameraModel, focal: f64, lens: &[f64], image: &Image) -> Dataset {
    let mut model = model(2);
    let center = 0.5 * f64::from(SIDE);
    let parameters = match model_of_lens.parameter_names()[0] {
        "f" => [&[focal, center, center], lens].concat(),
        _ => [&[focal, focal, center, center], lens].concat(),
    };
    let camera = ColmapCamera { model: model_of_lens, width: SIDE.into(), height: SIDE.into(), parameters };
    model.cameras = [(1, camera)].into();
    model.images.iter_mut().for_each(|image| image.rotation = glam::DQuat::IDENTITY);
    write_model(&root.join("sparse/0"), &binary(&model), "bin");
    write(root, image)
}

/// Writes the images of a data set whose other files are there, and reads it.
fn write(root: &Path, image: &Image) -> Dataset {
    fs::create_dir_all(root.join("images")).unwrap();
    for name in ["view 000.png", "view 001.png"] {
        crate::write_png(root.join("images").join(name), image).unwrap();
    }
    read(root)
}

/// A `transforms.json` of two such images, with further fields.
fn nerfstudio(root: &Path, fields: serde_json::Value, image: &Image) -> Dataset {
    // Camera-to-world with axes right, up, back: the camera's own axes are those of the world.
    let rows = json!([[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
    let frames =
        [0, 1].map(|i| json!({"file_path": format!("images/view {i:03}.png"), "transform_matrix": rows.clone()}));
    let focal = CIRCLE / HALF_ANGLE;
    let mut file = json!({"camera_model": "OPENCV_FISHEYE", "fl_x": focal, "fl_y": focal, "cx": SIDE / 2,
        "cy": SIDE / 2, "w": SIDE, "h": SIDE, "frames": frames});
    file.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    fs::write(root.join("transforms.json"), file.to_string()).unwrap();
    write(root, image)
}

/// The direction of each pixel of a view that counts, in the world.
fn counting(view: &View) -> Vec<(Vec3, [f32; 3])> {
    let posed = view.read_image().unwrap();
    let (width, height) = posed.image.size();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let counts = |x: u32, y: u32| posed.mask.as_ref().is_none_or(|mask| mask[(y * width + x) as usize]);
    let ray = |x: u32, y: u32| {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let ray = ((at - view.camera.center) / view.camera.focal).extend(1.0);
        (view.camera.rotation.transpose() * ray).normalize()
    };
    pixels.filter(|&(x, y)| counts(x, y)).map(|(x, y)| (ray(x, y), posed.image.pixel(x, y))).collect()
}

/// Checks the colours of the pixels of the first image's views, and that their largest angle from the
/// axis is about as expected, in degrees.
fn check(dataset: &Dataset, expected: f32) {
    let mut widest = 0.0_f32;
    for view in dataset.views.iter().filter(|view| view.name.starts_with(&dataset.views[0].name[..10])) {
        for (ray, color) in counting(view) {
            widest = widest.max(ray.z.acos().to_degrees());
            let difference = of_direction(ray).into_iter().zip(color).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(difference < 0.01, "{} {ray}: {color:?}", view.name);
        }
    }
    assert!((widest - expected).abs() < 2.0, "{widest} instead of {expected} degrees");
}

fn faces(dataset: &Dataset) -> Vec<CubeFace> {
    let mut faces: Vec<_> = dataset.views.iter().map(|view| view.source.face().unwrap()).collect();
    faces.truncate(faces.len() / 2);
    faces
}

#[test]
fn a_fisheye_beyond_180_degrees_is_five_views_without_its_black_border() {
    let place = folder();
    let focal = CIRCLE / HALF_ANGLE;
    let image = picture(focal, 0.0, HALF_ANGLE);
    let dataset = colmap(place.path(), CameraModel::OpenCvFisheye, focal, &[0.0; 4], &image);
    assert_eq!(faces(&dataset), [CubeFace::Down, CubeFace::Front, CubeFace::Left, CubeFace::Right, CubeFace::Up]);
    assert_eq!(dataset.views[1].name, "view 000.png#front");
    assert_eq!((dataset.views[0].camera.width, dataset.views[0].camera.height), (75, 75));
    assert!(dataset.remarks.contains(&Remark::SplitFisheye { count: 2, views: 10 }), "{:?}", dataset.remarks);
    let lines: Vec<String> = dataset.remarks.iter().map(ToString::to_string).collect();
    assert!(lines.contains(&"2 wide fish-eye images split into 90° faces: 10 views".to_owned()), "{lines:?}");
    check(&dataset, 92.0);
    assert_eq!(dataset.views_of(Split::Test).count(), 5, "the views of one image");
    let all = crate::dataset::read_images(&dataset.views).unwrap();
    assert!(all.iter().zip(&dataset.views).all(|(image, view)| *image == view.read_compact().unwrap()));
}

#[test]
fn every_model_of_fisheyes_shows_what_its_lens_says() {
    let k = -0.03;
    let focal = CIRCLE / (HALF_ANGLE * (1.0 + k * HALF_ANGLE * HALF_ANGLE));
    let image = picture(focal, k, HALF_ANGLE);
    for (lens, parameters) in [
        (CameraModel::SimpleRadialFisheye, &[k][..]),
        (CameraModel::RadialFisheye, &[k, 0.0]),
        (CameraModel::OpenCvFisheye, &[k, 0.0, 0.0, 0.0]),
        (CameraModel::ThinPrismFisheye, &[k, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ] {
        let place = folder();
        let dataset = colmap(place.path(), lens, focal, parameters, &image);
        assert_eq!(dataset.views.len(), 10, "{}", lens.name());
        check(&dataset, 91.0);
        // The rays of all pixels that are seen come back.
        let source = dataset.views[4].source;
        let ray = source.to_ray(dvec2(90.0, 30.0)).unwrap_or_else(|| panic!("{:?}", source.face()));
        assert!(source.to_pixel(ray).unwrap().distance(dvec2(90.0, 30.0)) < 1e-6);
    }
}

#[test]
fn the_stated_image_circle_is_respected() {
    // The image goes on beyond it.
    let image = picture(CIRCLE / HALF_ANGLE, 0.0, 3.0);
    for (radius, half_angle) in [(CIRCLE, 95.0), (45.0, 45.0 / CIRCLE as f32 * 95.0)] {
        let place = folder();
        let dataset = nerfstudio(place.path(), json!({"fisheye_crop_radius": radius}), &image);
        check(&dataset, half_angle);
    }
    let place = folder();
    nerfstudio(place.path(), json!({"fisheye_crop_radius": CIRCLE}), &image);
    let text = fs::read_to_string(place.path().join("transforms.json")).unwrap();
    fs::write(place.path().join("transforms.json"), text.replace("radius\":62.0", "radius\":-1")).unwrap();
    let error = refusal(place.path());
    assert!(error.contains("fisheye_crop_radius is -1, but must be greater than 0"), "{error}");
}

#[test]
fn without_a_circle_the_whole_image_counts() {
    let place = folder();
    let image = picture(CIRCLE / HALF_ANGLE, 0.0, 3.0);
    let dataset = nerfstudio(place.path(), json!({}), &image);
    // As far towards the corners of the image, at 139°, as the faces at the sides reach.
    check(&dataset, 126.0);
}

#[test]
fn narrow_fisheyes_stay_one_view() {
    // 100° wide, even where its corners are black.
    let focal = 64.0 / 50.0_f64.to_radians();
    for half_angle in [60.0_f64, 180.0] {
        let place = folder();
        let image = picture(focal, 0.0, half_angle.to_radians());
        let dataset = colmap(place.path(), CameraModel::OpenCvFisheye, focal, &[0.0; 4], &image);
        assert_eq!(dataset.views.len(), 2);
        assert!(dataset.views.iter().all(|view| view.source.face().is_none() && !view.name.contains('#')));
        assert!(dataset.remarks.contains(&Remark::Undistorted { count: 2, lens: "fisheye" }));
        assert_eq!(dataset.views[0].read_image().unwrap().mask, None);
    }
}
