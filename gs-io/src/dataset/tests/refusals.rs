//! Data sets that leave their folder, impossible cameras, truncated files, and their messages.

use std::{fs, num::NonZeroU32, path::Path};

use crate::{
    ImageRemark,
    dataset::{DatasetSettings, Remark, Skip, View, read_dataset},
};
use gs_core::Image;
use image::{ExtendedColorType, ImageEncoder, codecs};
use serde_json::{Value, json};

use super::made::{binary, colmap, folder, model, picture, read, refusal, skipped, text, write_model, write_pictures};

fn frame(file: &str) -> Value {
    json!({"file_path": file, "transform_matrix": [[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 5], [0, 0, 0, 1]]})
}

/// A `transforms.json` with these frames, a camera of 40×30 px and these other fields.
fn transforms(root: &Path, frames: &[Value], fields: Value) {
    let mut file = json!({"fl_x": 35.0, "cx": 19.0, "cy": 16.0, "w": 40, "h": 30, "frames": frames});
    file.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    fs::write(root.join("transforms.json"), file.to_string()).unwrap();
}

fn anywhere() -> DatasetSettings {
    DatasetSettings::default().with(|s| s.allow_outside = true)
}

fn detail(remarks: &[Remark], reason: Skip) -> &str {
    remarks
        .iter()
        .find_map(|remark| match remark {
            Remark::Skipped { why, detail, .. } if *why == reason => detail.as_deref(),
            _ => None,
        })
        .unwrap_or_default()
}

#[test]
fn files_outside_the_folder_are_refused_unless_they_are_allowed() {
    let place = folder();
    let root = place.path().join("data");
    let outside = picture(place.path().join("secret/a.png"), 40, 30);
    picture(root.join("images/b.png"), 40, 30);
    let absolute = outside.to_str().unwrap();
    for name in [absolute, "../secret/a.png", "images/../../secret/a.png", "./../secret/a"] {
        transforms(&root, &[frame("images/b.png"), frame(name), frame("../c.png")], json!({}));
        let error = refusal(&root);
        assert!(
            error.contains(&format!("transforms.json: file_path `{name}` leads out of the data set's folder (and 1")),
            "{error}"
        );
        assert_eq!(read_dataset(&root, &anywhere()).unwrap().views.len(), 2, "{name}");
    }
    let mut masked = frame("images/b.png");
    masked["mask_path"] = json!("../secret/a.png");
    transforms(&root, &[masked], json!({}));
    assert!(refusal(&root).contains("mask_path `../secret/a.png`"));
    transforms(&root, &[frame("images/b.png")], json!({"ply_file_path": "/etc/passwd"}));
    assert!(refusal(&root).contains("ply_file_path `/etc/passwd`"));

    // References inside the folder are allowed in any form.
    let inside = root.join("images/b.png");
    for name in ["images/../images/b.png", inside.to_str().unwrap()] {
        transforms(&root, &[frame(name)], json!({}));
        assert_eq!(read(&root).views.len(), 1, "{name}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&outside, root.join("images/link.png")).unwrap();
        transforms(&root, &[frame("images/link.png")], json!({}));
        assert_eq!(read(&root).views.len(), 1, "links are followed");
    }
}

#[test]
fn image_names_of_colmap_stay_in_the_folder_of_images() {
    for (files, name) in [(binary as fn(&_) -> _, "images.bin"), (text, "images.txt")] {
        let place = folder();
        let mut model = model(2);
        write_pictures(&place.path().join("images"), &model, 1);
        model.images[1].name = "../images/view 001.png".to_owned();
        write_model(&place.path().join("sparse/0"), &files(&model), &name[7..]);
        let error = refusal(place.path());
        assert!(error.contains(name) && error.contains("the image name `../images/view 001.png` leads out"), "{error}");
        assert_eq!(read_dataset(place.path(), &anywhere()).unwrap().views.len(), 2);
    }
}

#[test]
fn cameras_that_cannot_be_are_refused_with_their_numbers() {
    let place = folder();
    picture(place.path().join("a.png"), 40, 30);
    for (fields, fault, numbers) in [
        (json!({"k1": 1e30}), "less than a fifth of the width or height for an image of 40x30 px", "k1 = 1e30"),
        (json!({"k1": -1e30}), "no such lens is possible", "k1 = -1e30"),
        (json!({"k1": 1000.0}), "less than a fifth", "k1 = 1000"),
        (json!({"p1": 1e30}), "no such lens is possible", "p1 = 1e30"),
        (json!({"cx": 1e30}), "a principal point at 1e30", "cx = 1e30"),
        (json!({"cy": -4100.0}), "a principal point at", "cy = -4100"),
        (json!({"fl_x": 1e-40}), "focal lengths of 1e-40", "fl_x = 1e-40"),
        (json!({"fl_x": 1e9}), "focal lengths of 1e9", "fl_x = 1e9"),
        (json!({"fl_y": 1e-9}), "focal lengths of", "fl_y = 1e-9"),
        (json!({"cx": 0, "cy": 1e30}), "a principal point at 0e0, 1e30", "cx = 0, cy = 1e30"),
    ] {
        transforms(place.path(), &[frame("a.png")], fields.clone());
        let error = refusal(place.path());
        assert!(error.contains("1 image skipped: the camera's size") && error.contains(fault), "{fields}: {error}");
        assert!(error.contains("transforms.json has ") && error.contains(numbers), "{fields}: {error}");
    }
    // Wide, long, off-centre and distorted, as real cameras are.
    for (fields, views) in [
        (json!({"fl_x": 2.0}), 1),
        (json!({"fl_x": 20_000.0}), 1),
        (json!({"cx": -700.0}), 1),
        (json!({"k1": -0.3, "k2": 0.1, "p1": 0.01}), 1),
        (json!({"camera_model": "OPENCV_FISHEYE", "fl_x": 13.0, "k1": 0.1}), 5),
    ] {
        transforms(place.path(), &[frame("a.png")], fields.clone());
        assert_eq!(read(place.path()).views.len(), views, "{fields}");
    }

    let place = folder();
    let mut model = colmap(place.path(), 3);
    model.cameras.get_mut(&7).unwrap().parameters[3] = 1e30;
    write_model(&place.path().join("sparse/0"), &text(&model), "txt");
    fs::remove_file(place.path().join("sparse/0/cameras.bin")).unwrap();
    let dataset = read(place.path());
    assert_eq!((dataset.views.len(), skipped(&dataset, Skip::BadCamera)), (2, 1));
    let detail = detail(&dataset.remarks, Skip::BadCamera);
    assert!(detail.ends_with("camera 7 of cameras.txt has f = 30, cx = 16, cy = 12, k = 1e30"), "{detail}");
}

/// A JPEG of 40×30 px.
fn jpeg(profile: Option<Vec<u8>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = codecs::jpeg::JpegEncoder::new(&mut bytes);
    profile.into_iter().for_each(|profile| encoder.set_icc_profile(profile).unwrap());
    let pixels: Vec<u8> = (0..40 * 30 * 3).map(|i| (i * 7 % 251) as u8).collect();
    encoder.write_image(&pixels, 40, 30, ExtendedColorType::Rgb8).unwrap();
    bytes
}

#[test]
fn images_that_are_cut_short_are_skipped_and_not_trained_with() {
    let place = folder();
    let model = colmap(place.path(), 5);
    let name = |i: usize| place.path().join("images").join(&model.images[i].name);
    let whole = jpeg(None);
    fs::write(name(0), &whole[..whole.len() / 2]).unwrap();
    let png = fs::read(name(1)).unwrap();
    fs::write(name(1), &png[..png.len() - 30]).unwrap();
    fs::write(name(3), &whole).unwrap();
    let dataset = read(place.path());
    assert_eq!((dataset.views.len(), skipped(&dataset, Skip::BadImage)), (3, 2));
    let detail = detail(&dataset.remarks, Skip::BadImage);
    assert!(detail.starts_with("damaged JPEG image: it ends at byte "), "{detail}");
    // Damage behind the header is found when the image is read.
    let view: &View = dataset.views.iter().find(|view| view.image == name(4)).unwrap();
    let mut png = fs::read(name(4)).unwrap();
    let middle = png.len() / 2;
    png[middle] ^= 0x55;
    fs::write(name(4), &png).unwrap();
    let error = view.read_image().unwrap_err().to_string();
    assert!(
        error.contains("view 004.png: damaged PNG") && error.ends_with("or remove the file, and the view is left out"),
        "{error}"
    );
}

#[test]
fn masks_are_used_and_unusable_ones_are_reported() {
    let place = folder();
    let half = Image::from_fn(20, 15, |x, _| if x < 5 { [0.0; 3] } else { [1.0; 3] }).unwrap();
    fs::create_dir(place.path().join("masks")).unwrap();
    crate::write_png(place.path().join("masks/a.png"), &half).unwrap();
    fs::write(place.path().join("masks/b.png"), "no mask").unwrap();
    crate::write_png(place.path().join("masks/c.png"), &Image::filled(20, 20, [1.0; 3]).unwrap()).unwrap();
    let frames = ["a", "b", "c", "d"].map(|name| {
        picture(place.path().join(format!("{name}.png")), 40, 30);
        let mut frame = frame(&format!("{name}.png"));
        frame["mask_path"] = json!(format!("masks/{name}.png"));
        frame["depth_file_path"] = json!(format!("depths/{name}.png"));
        frame
    });
    transforms(place.path(), &frames, json!({}));
    let dataset = read(place.path());
    let names: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!((names, skipped(&dataset, Skip::BadMask)), (vec!["a.png", "d.png"], 2));
    let mask = dataset.views[0].read_image().unwrap().mask.unwrap();
    assert_eq!(mask[..40], std::array::from_fn::<bool, 40, _>(|x| x >= 10));
    assert!(dataset.remarks.contains(&Remark::MasksMissing { count: 1, first: "masks/d.png".to_owned() }));
    assert!(dataset.remarks.contains(&Remark::DepthsMissing { count: 4, first: "depths/a.png".to_owned() }));
    let lines: Vec<String> = dataset.remarks.iter().map(ToString::to_string).collect();
    assert!(lines.contains(&"4 depth maps not found (first: depths/a.png)".to_owned()), "{lines:?}");
}

#[test]
fn for_images_alone_the_error_says_how_to_make_a_data_set() {
    let place = folder();
    for root in [place.path().join("a"), place.path().join("with blank")] {
        ["x.JPG", "y.png"].iter().for_each(|name| drop(picture(root.join(name), 4, 3)));
        let error = refusal(&root);
        assert!(error.contains("holds 2 images without camera poses") && error.contains("gs poses "), "{error}");
    }
    let (plain, quoted) = (place.path().join("a"), place.path().join("with blank"));
    assert!(refusal(&plain).contains(&format!("gs poses {} -o ", plain.display())));
    assert!(refusal(&quoted).contains(&format!("gs poses '{}' -o ", quoted.display())));
    let nested = place.path().join("nested");
    ["x.png", "y.png"].iter().for_each(|name| drop(picture(nested.join("images").join(name), 4, 3)));
    assert!(refusal(&nested).contains(&format!("gs poses {} -o ", nested.join("images").display())));

    // The result of the suggested command: a model beside the images.
    let model = model(2);
    write_model(&plain.join("sparse/0"), &binary(&model), "bin");
    write_pictures(&plain, &model, 1);
    assert_eq!(read(&plain).views.len(), 2);
}

#[test]
fn large_images_are_scaled_down_with_their_cameras() {
    let place = folder();
    colmap(place.path(), 3);
    let sized = |max_side: u32| {
        let settings = DatasetSettings::default().with(|s| s.max_side = NonZeroU32::new(max_side));
        read_dataset(place.path(), &settings).unwrap()
    };
    let (full, small) = (read(place.path()), sized(20));
    for (full, small) in full.views.iter().zip(&small.views) {
        assert_eq!(small.full, full.camera);
        assert_eq!((small.camera.width, small.camera.height), (20, 15));
        let (of_full, of_small) = (full.camera.focal.x / full.camera.width as f32, small.camera.focal.x / 20.0);
        assert!((of_full - of_small).abs() < 1e-6, "the field of view stays");
        let (whole, read) = (full.read_image().unwrap().image, small.read_image().unwrap().image);
        assert_eq!(read.size(), (20, 15));
        let mean = |image: &Image| {
            image.pixels().iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / image.pixels().len() as f64
        };
        // But for the rounding to 8 bits.
        assert!((mean(&whole) - mean(&read)).abs() < 3e-4, "light is kept");
    }
    assert!(small.remarks.contains(&Remark::Reduced { count: 3, max_side: 20, from: (40, 30), to: (20, 15) }));
    let same = sized(64);
    assert_eq!((&same.views, &same.remarks), (&full.views, &full.remarks), "smaller ones stay as they are");
}

#[test]
fn colour_conversions_are_reported_for_all_images_together() {
    let place = folder();
    let model = colmap(place.path(), 5);
    let profile = moxcms::ColorProfile::new_display_p3().encode().unwrap();
    for i in [0, 3] {
        fs::write(place.path().join("images").join(&model.images[i].name), jpeg(Some(profile.clone()))).unwrap();
    }
    let remark = ImageRemark::Converted { from: "the colour profile Display P3".to_owned() };
    let expected = Remark::Image { remark, count: 2, first: "view 000.png".to_owned() };
    let dataset = read(place.path());
    assert!(dataset.remarks.contains(&expected), "{:?}", dataset.remarks);
    assert_eq!(
        expected.to_string(),
        "2 images: colours converted from the colour profile Display P3 to sRGB (first: view 000.png)"
    );
}
