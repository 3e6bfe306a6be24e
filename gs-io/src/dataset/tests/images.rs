//! The image of a view: undistorted, masked, with its alpha, the right way up.

use std::{fs, num::NonZeroU32};

use crate::{
    Error, Orientation, PngExtras,
    dataset::{AlphaMeaning, CameraModel, Dataset, DatasetSettings, PosedImage, Window, read_dataset},
    write_png_with,
};
use glam::{DVec2, dvec2};
use gs_core::Image;
use image::{ImageBuffer, ImageEncoder, Rgba, codecs::png::PngEncoder, metadata::Orientation as Exif};
use serde_json::json;

use super::{
    made::{binary, colmap, folder, model, picture, read, write_model},
    transforms::nerfstudio,
};

/// A data set of one view with a camera of 64×48 px, this model and this picture.
fn one_view(root: &std::path::Path, name: &str, parameters: &[f64], picture: &Image) -> Dataset {
    let mut model = model(1);
    let camera = model.cameras.get_mut(&1).unwrap();
    camera.model = <CameraModel as gs_core::Choice>::from_name(name).unwrap();
    (camera.width, camera.height, camera.parameters) = (64, 48, parameters.to_vec());
    write_model(&root.join("sparse/0"), &binary(&model), "bin");
    fs::create_dir_all(root.join("images")).unwrap();
    crate::write_png(root.join("images/view 000.png"), picture).unwrap();
    read(root)
}

/// A smooth function of the viewing ray, so that the picture of any camera is known exactly.
fn of_ray(ray: DVec2) -> [f32; 3] {
    [0.5 + 0.4 * (3.0 * ray.x).sin(), 0.5 + 0.4 * (2.5 * ray.y).cos(), 0.5 + 0.3 * ray.x * ray.y].map(|v| v as f32)
}

#[test]
fn undistorted_pictures_show_what_a_pinhole_would_have_seen() {
    for (name, parameters, lens) in [
        ("SIMPLE_RADIAL", &[60.0, 32.0, 24.0, -0.15][..], "barrel"),
        ("SIMPLE_RADIAL", &[60.0, 30.0, 25.0, 0.15], "pincushion"),
        ("OPENCV", &[60.0, 62.0, 31.0, 23.0, -0.1, 0.02, 0.004, -0.003], "decentred"),
        ("OPENCV_FISHEYE", &[45.0, 45.0, 32.0, 24.0, 0.02, -0.01, 0.0, 0.0], "fisheye"),
        ("FOV", &[60.0, 60.0, 32.0, 24.0, 0.8], "field of view"),
    ] {
        let place = folder();
        let blank = Image::filled(64, 48, [0.0; 3]).unwrap();
        let source = one_view(place.path(), name, parameters, &blank).views[0].source;
        let seen = |x: u32, y: u32| of_ray(source.to_ray(dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap());
        let picture = Image::from_fn(64, 48, seen).unwrap();
        let view = one_view(place.path(), name, parameters, &picture).views.remove(0);
        let PosedImage { image, mask, .. } = view.read_image().unwrap();
        assert_eq!(image.size(), (view.camera.width, view.camera.height));
        assert_eq!(mask, None, "{lens}: no pixel is blank");
        let (mut worst, mut unbent) = (0.0_f32, 0.0_f32);
        for y in 0..image.height() {
            for x in 0..image.width() {
                let place = dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let ray = (place - view.camera.center.as_dvec2()) / view.camera.focal.as_dvec2();
                let error = |expected: [f32; 3]| {
                    image.pixel(x, y).iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
                };
                worst = worst.max(error(of_ray(ray)));
                unbent = unbent.max(error(seen(x.min(63), y.min(47))));
            }
        }
        // Half a step of 8 bits, and the error of the cubic at the border, where its outer taps are
        // repeated.
        assert!(worst < 0.006, "{lens}: {worst}");
        assert!(unbent > 0.012, "{lens}: without undistortion it would be wrong, {unbent}");
    }
}

#[test]
fn pixels_that_the_lens_never_saw_do_not_count() {
    let place = folder();
    // Far more than a right angle from side to side, and folded in the corners.
    let picture = Image::filled(64, 48, [0.9, 0.5, 0.1]).unwrap();
    let view = one_view(place.path(), "SIMPLE_RADIAL", &[25.0, 32.0, 24.0, -0.3], &picture).views.remove(0);
    let PosedImage { image, mask, .. } = view.read_image().unwrap();
    let mask = mask.expect("the corners are blank");
    let (counted, width) = (mask.iter().filter(|counts| **counts).count(), image.width() as usize);
    assert!(counted > mask.len() / 2 && counted < mask.len(), "{counted} of {}", mask.len());
    assert!(!mask[0] && mask[mask.len() / 2 + width / 2]);
    for (pixel, counts) in image.pixels().iter().zip(&mask) {
        assert_eq!(*pixel == [0.0; 3], !counts, "{pixel:?}");
    }
}

fn rgba(width: u32, height: u32, color: impl Fn(u32, u32) -> [u8; 4]) -> ImageBuffer<Rgba<u8>, Vec<u8>> {
    ImageBuffer::from_fn(width, height, |x, y| Rgba(color(x, y)))
}

#[test]
fn alpha_is_opacity_or_a_mask() {
    let place = folder();
    colmap(place.path(), 1);
    // Transparent pixels of a glaring colour, which must not be visible.
    let file = place.path().join("images/view 000.png");
    rgba(40, 30, |x, _| if x < 20 { [255, 0, 0, 0] } else { [0, 102, 255, 204] }).save(&file).unwrap();
    let posed = read(place.path()).views[0].read_image().unwrap();
    let alpha = posed.alpha.as_ref().unwrap();
    assert_eq!((alpha[0], alpha[39], posed.mask.is_none()), (0.0, 0.8, true));
    assert_eq!(posed.image.pixel(39, 0), [0.0, 0.4, 1.0], "not multiplied");
    let over = posed.over([1.0; 3]).unwrap();
    assert_eq!((over.pixel(0, 0), over.pixel(39, 0)[1]), ([1.0; 3], 0.4 * 0.8 + 1.0 * (1.0 - 0.8)));

    let settings = DatasetSettings::default().with(|s| s.alpha = AlphaMeaning::Mask);
    let posed = read_dataset(place.path(), &settings).unwrap().views[0].read_image().unwrap();
    assert_eq!(posed.alpha, None);
    assert_eq!(posed.mask.unwrap()[..40], std::array::from_fn::<bool, 40, _>(|x| x >= 20));
}

#[test]
fn transparent_colours_do_not_bleed_when_undistorted() {
    let place = folder();
    let blank = Image::filled(64, 48, [0.0; 3]).unwrap();
    let mut dataset = one_view(place.path(), "SIMPLE_RADIAL", &[60.0, 32.0, 24.0, -0.1], &blank);
    let file = place.path().join("images/view 000.png");
    rgba(64, 48, |x, _| if x % 7 < 3 { [255, 0, 0, 0] } else { [0, 102, 255, 255] }).save(&file).unwrap();
    let posed = dataset.views.remove(0).read_image().unwrap();
    let alpha = posed.alpha.as_ref().unwrap();
    assert!(alpha.iter().any(|a| *a > 0.2 && *a < 0.8), "edges are between");
    for (pixel, alpha) in posed.image.pixels().iter().zip(alpha).filter(|(_, alpha)| **alpha > 0.1) {
        assert!(pixel[0] < 1e-6 && (pixel[2] - 1.0).abs() < 1e-5, "{pixel:?} at {alpha}");
    }
}

#[test]
fn masks_of_any_size_black_out_what_does_not_count() {
    let place = folder();
    colmap(place.path(), 3);
    fs::create_dir(place.path().join("masks")).unwrap();
    let half = Image::from_fn(20, 15, |x, _| if x < 5 { [0.0; 3] } else { [1.0; 3] }).unwrap();
    crate::write_png(place.path().join("masks/view 000.png.png"), &half).unwrap();
    crate::write_png(place.path().join("masks/view 002.png"), &half).unwrap();
    let views = read(place.path()).views;
    let mask = views[0].read_image().unwrap().mask.unwrap();
    assert_eq!(mask[..40], std::array::from_fn::<bool, 40, _>(|x| x >= 10));
    assert_eq!(views[1].mask, None);
    let bent = views[2].read_image().unwrap();
    let masked = bent.mask.unwrap().iter().filter(|counts| !**counts).count() as f32;
    let share = masked / bent.image.pixels().len() as f32;
    assert!((share - 0.25).abs() < 0.03, "{share}: masks are undistorted as well");

    crate::write_png(place.path().join("masks/view 000.png.png"), &Image::filled(20, 20, [1.0; 3]).unwrap()).unwrap();
    let error = views[0].read_image().unwrap_err();
    assert!(error.to_string().contains("is 20x20 px, but 40x"), "{error}");
}

#[test]
fn a_window_is_what_the_whole_image_has_there() {
    let window = Window { left: 5, top: 3, width: 11, height: 9 };
    let lenses = [
        ("SIMPLE_RADIAL", &[60.0, 32.0, 24.0, -0.1][..], false),
        ("SIMPLE_RADIAL", &[25.0, 32.0, 24.0, -0.3], false),
        ("PINHOLE", &[60.0, 60.0, 32.0, 24.0], false),
        ("PINHOLE", &[60.0, 60.0, 32.0, 24.0], true),
    ];
    for (lens, parameters, has_mask) in lenses {
        for max_side in [None, NonZeroU32::new(37)] {
            let place = folder();
            let blank = Image::filled(64, 48, [0.0; 3]).unwrap();
            one_view(place.path(), lens, parameters, &blank);
            if has_mask {
                let striped = Image::from_fn(64, 48, |x, y| [f32::from((x + y) % 3 > 0); 3]).unwrap();
                fs::create_dir(place.path().join("masks")).unwrap();
                crate::write_png(place.path().join("masks/view 000.png"), &striped).unwrap();
            }
            let file = place.path().join("images/view 000.png");
            for alpha in [255, 60] {
                let color = |x: u32, y: u32| [(4 * x) as u8, (5 * y) as u8, (x * y) as u8];
                let pixels = |x: u32, y: u32| {
                    let [r, g, b] = color(x, y);
                    [r, g, b, if x % 5 < 2 { alpha } else { 255 }]
                };
                rgba(64, 48, pixels).save(&file).unwrap();
                let settings = DatasetSettings::default().with(|s| s.max_side = max_side);
                let view = read_dataset(place.path(), &settings).unwrap().views.remove(0);
                let expected = view.read_compact().unwrap().cropped(window).to_posed().unwrap();
                let read = view.read_window(window).unwrap().to_posed().unwrap();
                assert_eq!((&read.image, &read.alpha), (&expected.image, &expected.alpha));
                // A window of which all pixels count has no mask.
                let all = vec![true; 99];
                assert_eq!(read.mask.unwrap_or(all.clone()), expected.mask.unwrap_or(all));
                let is_folded = parameters.last() == Some(&-0.3);
                assert_eq!(view.read_compact().unwrap().to_posed().unwrap().mask.is_some(), has_mask || is_folded);
            }
        }
    }
}

#[test]
fn an_image_that_changed_since_is_refused() {
    let place = folder();
    colmap(place.path(), 1);
    let view = read(place.path()).views.remove(0);
    crate::write_png(&view.image, &Image::filled(20, 15, [1.0; 3]).unwrap()).unwrap();
    assert!(view.read_image().unwrap_err().to_string().contains("the image is 20x15 px, but 40x30 px"));
    fs::remove_file(&view.image).unwrap();
    assert!(matches!(view.read_image(), Err(Error::Missing { .. })));
}

/// A PNG of these sides that is to be shown turned by a quarter.
fn turned_png((width, height): (u32, u32)) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = PngEncoder::new(&mut bytes);
    let exif: Vec<u8> = [
        &b"II\x2a\0\x08\0\0\0"[..], // little-endian, the first directory at 8
        &[1, 0, 0x12, 1, 3, 0, 1, 0, 0, 0, Exif::Rotate90.to_exif(), 0, 0, 0], // one entry: orientation
        &[0; 4],
    ]
    .concat();
    encoder.set_exif_metadata(exif).unwrap();
    let pixels = vec![7; 3 * (width * height) as usize];
    encoder.write_image(&pixels, width, height, image::ExtendedColorType::Rgb8).unwrap();
    bytes
}

#[test]
fn a_principal_point_decides_the_orientation_where_no_size_is_given() {
    for (center, expected) in [
        (json!({"cx": 15.5, "cy": 19.0}), Orientation::Exif),
        (json!({"cx": 20, "cy": 15}), Orientation::AsStored),
        (json!({"cx": 17.5, "cy": 17.5}), Orientation::AsStored),
        (json!({}), Orientation::AsStored),
        (json!({"cx": 15, "cy": 20, "w": 40, "h": 30}), Orientation::AsStored),
    ] {
        let place = folder();
        let mut fields = json!({"fl_x": 35.0});
        fields.as_object_mut().unwrap().extend(center.as_object().unwrap().clone());
        nerfstudio(place.path(), fields);
        fs::write(place.path().join("images/a.png"), turned_png((40, 30))).unwrap();
        let view = read(place.path()).views.remove(0);
        assert_eq!(view.orientation, expected, "{center}");
        let size = if expected == Orientation::Exif { (30, 40) } else { (40, 30) };
        assert_eq!(view.read_image().unwrap().image.size(), size);
    }
}

#[test]
fn pictures_are_taken_as_stored_unless_only_the_turned_one_fits() {
    for (stored, expected) in [((40, 30), Orientation::AsStored), ((30, 40), Orientation::Exif)] {
        let place = folder();
        colmap(place.path(), 1);
        fs::write(place.path().join("images/view 000.png"), turned_png(stored)).unwrap();
        let view = read(place.path()).views.remove(0);
        assert_eq!(view.orientation, expected);
        assert_eq!(view.read_image().unwrap().image.size(), (40, 30));
    }
}

#[test]
fn a_mask_may_be_in_alpha() {
    let place = folder();
    colmap(place.path(), 2);
    fs::create_dir(place.path().join("masks")).unwrap();
    let file = place.path().join("masks/view 000.png");
    // The right half counts.
    let alpha: Vec<f32> = (0..40 * 30).map(|i| if i % 40 >= 20 { 1.0 } else { 0.0 }).collect();
    let lower = |_: u32, y: u32| if y >= 15 { [1.0; 3] } else { [0.0; 3] };
    let row = |y: usize| read(place.path()).views[0].read_image().unwrap().mask.unwrap()[40 * y..][..40].to_vec();
    let right = std::array::from_fn::<bool, 40, _>(|x| x >= 20);
    for color in [[1.0; 3], [0.0; 3]] {
        let image = Image::filled(40, 30, color).unwrap();
        write_png_with(&file, &image, PngExtras { alpha: Some(&alpha), profile: None }).unwrap();
        assert_eq!((row(0), row(29)), (right.to_vec(), right.to_vec()), "{color:?}");
    }
    // Transparent pixels may store anything.
    let noise = |x: u32, y: u32| if x >= 20 { [0.0; 3] } else { [0.1 * (x + y) as f32 % 1.0; 3] };
    let image = Image::from_fn(40, 30, noise).unwrap();
    write_png_with(&file, &image, PngExtras { alpha: Some(&alpha), profile: None }).unwrap();
    assert_eq!((row(0), row(29)), (right.to_vec(), right.to_vec()));
    // Where both vary, both must say so.
    let image = Image::from_fn(40, 30, lower).unwrap();
    write_png_with(&file, &image, PngExtras { alpha: Some(&alpha), profile: None }).unwrap();
    assert_eq!((row(0), row(29)), (vec![false; 40], right.to_vec()));
    write_png_with(&file, &image, PngExtras { alpha: Some(&[1.0; 1200]), profile: None }).unwrap();
    assert_eq!((row(0), row(29)), (vec![false; 40], vec![true; 40]));
}

#[test]
fn integers_of_0_and_1_are_a_mask() {
    let place = folder();
    colmap(place.path(), 1);
    fs::create_dir(place.path().join("masks")).unwrap();
    let right: Vec<u8> = (0..40 * 30).map(|i| u8::from(i % 40 >= 20)).collect();
    let wide: Vec<u16> = right.iter().copied().map(u16::from).collect();
    for pixels in [
        image::DynamicImage::from(image::GrayImage::from_raw(40, 30, right).unwrap()),
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(40, 30, wide).unwrap().into(),
    ] {
        pixels.save(place.path().join("masks/view 000.png")).unwrap();
        let mask = read(place.path()).views[0].read_image().unwrap().mask.unwrap();
        assert!(mask.iter().enumerate().all(|(i, counts)| *counts == (i % 40 >= 20)), "{:?}", pixels.color());
    }
}

#[test]
fn square_pixels_decide_the_orientation_where_angles_alone_are_given() {
    let angle = |side: f64| 2.0 * (0.5 * side / 35.0).atan();
    for (x, y, expected) in [(30.0, 40.0, Orientation::Exif), (40.0, 30.0, Orientation::AsStored)] {
        let place = folder();
        nerfstudio(place.path(), json!({"camera_angle_x": angle(x), "camera_angle_y": angle(y)}));
        fs::write(place.path().join("images/a.png"), turned_png((40, 30))).unwrap();
        let view = read(place.path()).views.remove(0);
        assert_eq!(view.orientation, expected);
        assert!(view.source.focal.distance(DVec2::splat(35.0)) < 1e-9);
    }
}

#[test]
fn folders_of_masks_that_are_not_used_are_reported() {
    let unused = |place: &tempfile::TempDir| {
        let remarks = read(place.path()).remarks;
        remarks.iter().map(ToString::to_string).find(|remark| remark.contains("is not used"))
    };
    for folder_of_masks in ["masks", "mask"] {
        let place = folder();
        nerfstudio(place.path(), json!({"fl_x": 35.0}));
        assert_eq!(unused(&place), None);
        picture(place.path().join(folder_of_masks).join("a.png"), 40, 30);
        let expected = format!("{folder_of_masks}/ is not used: name the mask of each frame in its mask_path");
        assert_eq!(unused(&place), Some(expected));
    }
    let place = folder();
    colmap(place.path(), 1);
    picture(place.path().join("mask/view 000.png"), 40, 30);
    assert!(unused(&place).unwrap().contains("the mask of an image is masks/NAME"));
    picture(place.path().join("masks/view 000.png"), 40, 30);
    assert_eq!(unused(&place), None);
}
