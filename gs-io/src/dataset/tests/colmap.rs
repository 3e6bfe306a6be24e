//! COLMAP models: both encodings, folders, image sizes, splits, and unusable views.

use std::{fs, num::NonZeroU32};

use crate::{
    Error, WorldFrame,
    dataset::{CameraModel, ColmapModel, DatasetKind, DatasetSettings, Remark, Skip, Split, read_dataset},
};
use glam::{DQuat, Vec2, Vec3, dvec3};

use super::made::{binary, colmap, folder, model, picture, read, refusal, skipped, text, write_model, write_pictures};

#[test]
fn both_encodings_hold_the_same_model() {
    let place = folder();
    let model = model(5);
    for (files, extension) in [(binary(&model), "bin"), (text(&model), "txt")] {
        let folder = place.path().join(extension);
        write_model(&folder, &files, extension);
        assert_eq!(ColmapModel::read(&folder).unwrap(), model, "{extension}");
    }
}

#[test]
fn views_and_points_are_the_models() {
    let place = folder();
    colmap(place.path(), 4);
    let in_world = DatasetSettings::default().with(|s| s.frame = Some(WorldFrame::WORLD));
    let dataset = read_dataset(place.path(), &in_world).unwrap();
    assert_eq!((dataset.kind, dataset.views.len(), dataset.points.len()), (DatasetKind::Colmap, 4, 3));
    let view = &dataset.views[1];
    assert_eq!((view.name.as_str(), view.camera.width, view.camera.height), ("view 001.png", 40, 30));
    assert_eq!((view.camera.focal, view.camera.center), (Vec2::new(30.0, 31.0), Vec2::new(20.0, 15.5)));
    // World-to-camera as stored: the world's origin is at t.
    assert_eq!(view.camera.to_camera(Vec3::ZERO), Vec3::new(1.0, 0.25, 4.0));
    let x = view.camera.rotation * Vec3::X;
    assert!(x.abs_diff_eq(Vec3::new(0.1_f32.cos(), 0.0, -(0.1_f32.sin())), 1e-6), "{x}");
    assert_eq!(dataset.points[1].position, Vec3::new(5.0, -0.5, 2.0));
    assert_eq!(dataset.points[1].color, [1.0, 0.2, 5.0 / 255.0]);
    assert_eq!(dataset.remarks, [Remark::Undistorted { count: 1, lens: "Brown-Conrady" }]);
    let bent = &dataset.views[2];
    assert!(!bent.source.lens.is_pinhole() && bent.camera.width >= 32);
    let posed = bent.read_image().unwrap();
    assert_eq!(posed.image.size(), (bent.camera.width, bent.camera.height));
}

#[test]
fn every_eighth_view_by_name_is_held_out_or_as_many_as_one_likes() {
    let place = folder();
    colmap(place.path(), 17);
    let tests = |settings: DatasetSettings| -> Vec<usize> {
        let views = read_dataset(place.path(), &settings).unwrap().views;
        (0..views.len()).filter(|&i| views[i].split == Split::Test).collect()
    };
    assert_eq!(tests(DatasetSettings::default()), [0, 8, 16]);
    assert_eq!(tests(DatasetSettings::default().with(|s| s.test_every = NonZeroU32::new(7))), [0, 7, 14]);
    assert_eq!(tests(DatasetSettings::default().with(|s| s.test_every = None)), [0_usize; 0]);
    assert_eq!(tests(DatasetSettings::default().with(|s| s.test_every = NonZeroU32::MIN.into())), [0_usize; 0]);
    let dataset = read(place.path());
    assert_eq!((dataset.views_of(Split::Train).count(), dataset.views_of(Split::Test).count()), (14, 3));
}

#[test]
fn a_single_view_is_trained_with() {
    let place = folder();
    colmap(place.path(), 1);
    let dataset = read(place.path());
    assert_eq!(dataset.views[0].split, Split::Train);
    assert!(dataset.remarks.contains(&Remark::NothingHeldOut));
}

#[test]
fn models_are_found_in_the_usual_folders() {
    for folder_name in ["sparse/0", "sparse", "colmap/sparse/0", "."] {
        for extension in ["bin", "txt"] {
            let place = folder();
            let model = model(2);
            let files = if extension == "bin" { binary(&model) } else { text(&model) };
            write_model(&place.path().join(folder_name), &files, extension);
            write_pictures(&place.path().join("images"), &model, 1);
            // Files of newer versions are ignored.
            fs::write(place.path().join(folder_name).join("rigs.bin"), "not a rig").unwrap();
            fs::write(place.path().join(folder_name).join("frames.bin"), [0xff; 9]).unwrap();
            assert_eq!(read(place.path()).views.len(), 2, "{folder_name} {extension}");
        }
    }
}

#[test]
fn intrinsics_follow_the_size_of_the_image() {
    let place = folder();
    let model = colmap(place.path(), 2);
    fs::remove_dir_all(place.path().join("images")).unwrap();
    write_pictures(&place.path().join("images_2"), &model, 2);
    write_pictures(&place.path().join("images_4"), &model, 4);
    let dataset = read(place.path());
    let camera = &dataset.views[0].camera;
    assert_eq!((camera.width, camera.height, camera.focal), (20, 15, Vec2::new(15.0, 15.5)));
    assert_eq!(camera.center, Vec2::new(10.0, 7.75));
    assert!(dataset.remarks.contains(&Remark::Scaled { count: 2, from: (40, 30), to: (20, 15) }));
    // 30 / 4 is rounded to 7: each axis has its own factor.
    let settings = DatasetSettings::default().with(|s| s.image_folder = Some("images_4".to_owned()));
    let camera = read_dataset(place.path(), &settings).unwrap().views[0].camera;
    assert_eq!((camera.width, camera.height, camera.focal.x), (10, 7, 7.5));
    assert!((camera.focal.y - 31.0 * 7.0 / 30.0).abs() < 1e-6);
    let settings = DatasetSettings::default().with(|s| s.image_folder = Some("images_9".to_owned()));
    assert!(matches!(read_dataset(place.path(), &settings), Err(Error::Missing { .. })));
}

#[test]
fn the_same_images_in_another_format_are_taken() {
    let place = folder();
    let mut model = colmap(place.path(), 2);
    model.images.iter_mut().for_each(|image| image.name = image.name.replace(".png", ".JPG"));
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    let dataset = read(place.path());
    assert_eq!(dataset.views[0].name, "view 000.JPG");
    assert!(dataset.views[0].image.ends_with("images/view 000.png"));
}

#[test]
fn unusable_images_and_points_are_counted() {
    let place = folder();
    let mut model = colmap(place.path(), 16);
    let images = place.path().join("images");
    let name = |i: usize| images.join(format!("view {i:03}.png"));
    model.images[0].camera_id = 99;
    model.images[1].rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    model.images[3].translation.x = f64::NAN;
    model.images[4].rotation.x = f64::INFINITY;
    fs::remove_file(name(6)).unwrap();
    fs::write(name(7), "no image").unwrap();
    picture(name(9), 40, 40);
    model.images[10].name = "view 012.png".to_owned();
    model.images[13].name = "gone/view 013.png".to_owned();
    model.images[14].camera_id = 50;
    model.images[15].camera_id = 51;
    let mut broken = model.cameras[&1].clone();
    broken.parameters[0] = f64::NAN;
    model.cameras.insert(50, broken.clone());
    broken.model = CameraModel::Equirectangular;
    broken.parameters = vec![40.0, 30.0];
    model.cameras.insert(51, broken);
    model.points[0].position.z = f64::NAN;
    model.points[2].position.z = 1e300;
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    let dataset = read(place.path());
    let names: Vec<_> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["view 002.png", "view 005.png", "view 008.png", "view 011.png", "view 012.png"]);
    for (reason, count) in [
        (Skip::NoCamera, 1),
        (Skip::BadPose, 1),
        (Skip::PoseNotFinite, 2),
        (Skip::NoImage, 2),
        (Skip::BadImage, 1),
        (Skip::OtherShape, 1),
        (Skip::SameName, 1),
        (Skip::BadCamera, 1),
        (Skip::Panorama, 1),
    ] {
        assert_eq!(skipped(&dataset, reason), count, "{reason:?}: {:?}", dataset.remarks);
    }
    assert!(dataset.remarks.contains(&Remark::PointsNotFinite { count: 2 }));
    assert_eq!(dataset.points.len(), 1);
    let lines: Vec<String> = dataset.remarks.iter().map(ToString::to_string).collect();
    for (start, end) in [
        ("1 image skipped: the camera is not in the model (first: view 000.png)", ""),
        ("1 image skipped: the camera's size", "camera 50 of cameras.bin has fx = NaN, fy = 31, cx = 20, cy = 15.5)"),
        (
            "1 image skipped: the image has another shape",
            "(first: view 009.png: the camera has 40x30 px, the image 40x40 px)",
        ),
        ("2 images skipped: the pose contains NaN or infinity (first: view 003.png)", ""),
    ] {
        assert!(lines.iter().any(|line| line.starts_with(start) && line.ends_with(end)), "{start}: {lines:?}");
    }
}

#[test]
fn a_model_without_points_is_fine_and_says_so() {
    let place = folder();
    colmap(place.path(), 2);
    let points = place.path().join("sparse/0/points3D.bin");
    fs::write(&points, 0_u64.to_le_bytes()).unwrap();
    assert!(read(place.path()).remarks.contains(&Remark::NoPoints));
    fs::remove_file(points).unwrap();
    let dataset = read(place.path());
    assert!(dataset.points.is_empty() && dataset.remarks.contains(&Remark::NoPoints));
}

#[test]
fn photographs_that_cannot_be_read_are_named() {
    let place = folder();
    let images = place.path().join("images");
    fs::create_dir(&images).unwrap();
    let put = |ending: &str| (0..4).for_each(|i| fs::write(images.join(format!("IMG_{i}.{ending}")), b"").unwrap());
    put("NEF");
    let error = refusal(place.path());
    assert!(error.contains("4 photographs, such as IMG_0.NEF") && error.contains("images/*.NEF"), "{error}");
    put("HEIC");
    let error = refusal(place.path());
    let how = format!("gs poses {} -o DATASET converts them and finds these", images.display());
    assert!(error.contains(&format!("it holds 4 photographs without camera poses: {how}")), "{error}");
}

#[test]
fn photographs_of_listed_images_that_cannot_be_read_are_named() {
    let place = folder();
    colmap(place.path(), 2);
    for i in 0..2 {
        let name = |ending| place.path().join(format!("images/view 00{i}.{ending}"));
        fs::rename(name("png"), name("HEIC")).unwrap();
    }
    let error = refusal(place.path());
    assert!(error.contains("there is images/view 000.HEIC, which cannot be read: convert"), "{error}");
}

#[test]
fn no_data_set_says_what_was_looked_for() {
    let place = folder();
    let error = refusal(place.path());
    assert!(error.contains("transforms.json") && error.contains("sparse") && error.contains("cameras.bin"), "{error}");
    for program in ["OpenSfM", "Metashape", "RealityScan", "LLFF"] {
        assert!(error.contains(&format!("({program}")), "{error}");
    }
    let file = place.path().join("a.txt");
    fs::write(&file, "").unwrap();
    assert!(refusal(&file).contains("no data set"));
    assert!(refusal(&place.path().join("nowhere")).contains("no such file"));
}

#[test]
fn a_data_set_without_a_usable_view_says_why() {
    let place = folder();
    colmap(place.path(), 3);
    fs::remove_dir_all(place.path().join("images")).unwrap();
    let error = refusal(place.path());
    assert!(
        error.contains("has 3 views, of which none can be used")
            && error.contains(
                "3 images skipped: no image file (first: view 000.png, view 001.png, view 002.png: there are no images"
            ),
        "{error}"
    );
    fs::write(place.path().join("sparse/0/images.bin"), 0_u64.to_le_bytes()).unwrap();
    assert!(refusal(place.path()).contains("it lists none"));
    fs::remove_file(place.path().join("sparse/0/images.bin")).unwrap();
    assert!(refusal(place.path()).contains("images.bin: no such file"));
}

#[test]
fn truncated_binary_files_are_refused_at_every_byte() {
    let model = model(3);
    let [cameras, images, points] = binary(&model);
    let parse = |c: &[u8], i: &[u8], p: &[u8]| ColmapModel::from_binary("a".as_ref(), c, i, Some(p));
    assert_eq!(parse(&cameras, &images, &points).unwrap(), model);
    let refused = |result: Result<ColmapModel, Error>| matches!(result, Err(Error::Damaged { .. }));
    assert!((0..cameras.len()).all(|n| refused(parse(&cameras[..n], &images, &points))));
    assert!((0..images.len()).all(|n| refused(parse(&cameras, &images[..n], &points))));
    assert!((0..points.len()).all(|n| refused(parse(&cameras, &images, &points[..n]))));
    let longer = [&points[..], &[0]].concat();
    assert!(refused(parse(&cameras, &images, &longer)), "what follows is not ignored");
}

#[test]
fn absurd_counts_allocate_nothing() {
    let [cameras, images, points] = binary(&model(3));
    for count in [u64::MAX, 1 << 60, 1 << 32, 1000] {
        let lie = |bytes: &[u8]| [&count.to_le_bytes()[..], &bytes[8..]].concat();
        for (c, i, p) in [
            (lie(&cameras), images.clone(), points.clone()),
            (cameras.clone(), lie(&images), points.clone()),
            (cameras.clone(), images.clone(), lie(&points)),
        ] {
            let error = ColmapModel::from_binary("a".as_ref(), &c, &i, Some(&p)).unwrap_err();
            assert!(matches!(error, Error::Damaged { ref place, .. } if place == "byte 0"), "{error}");
            assert!(error.to_string().contains(&count.to_string()), "{error}");
        }
    }
}

#[test]
fn unknown_camera_models_are_named() {
    let [mut cameras, images, _] = binary(&model(1));
    cameras[12] = 18;
    let error = ColmapModel::from_binary("a".as_ref(), &cameras, &images, None).unwrap_err().to_string();
    assert!(error.contains("camera model 18") && error.contains("OPENCV_FISHEYE"), "{error}");
    let [cameras, images, _] = text(&model(1));
    let cameras = String::from_utf8(cameras).unwrap().replace("SIMPLE_RADIAL", "ROUND");
    let error = ColmapModel::from_text("a".as_ref(), cameras.as_bytes(), &images, None).unwrap_err().to_string();
    assert!(error.contains("camera model ROUND"), "{error}");
}

#[test]
fn broken_lines_are_named() {
    let [cameras, images, points] = text(&model(2)).map(|bytes| String::from_utf8(bytes).unwrap());
    let refused = |c: &str, i: &str, p: &str| {
        let result = ColmapModel::from_text("a".as_ref(), c.as_bytes(), i.as_bytes(), Some(p.as_bytes()));
        result.unwrap_err().to_string()
    };
    let error = refused(&cameras.replace("40 30", "40 thirty"), &images, &points);
    assert!(error.contains("cameras.txt: line 2: expected a height in px, found `thirty`"), "{error}");
    let error = refused(&cameras.replace("15.5", "15.5 1"), &images, &points);
    assert!(error.contains("line 2: expected the end of the line, found `1`"), "{error}");
    let error = refused(&cameras, &images.replace("view 001.png", ""), &points);
    assert!(error.contains("images.txt: line 5: expected an image's name"), "{error}");
    let error = refused(&cameras, &images.replace("3.25 5", "3.25"), &points);
    assert!(error.contains("line 6: expected a point's number or -1, found the end of the line"), "{error}");
    let error = refused(&cameras, &images, &points.replace("255", "256"));
    assert!(error.contains("points3D.txt: line 2: expected red, 0 to 255, found `256`"), "{error}");
    let error = ColmapModel::from_text("a".as_ref(), b"1 \xff", b"", None).unwrap_err().to_string();
    assert!(error.contains("line 1: expected UTF-8 text"), "{error}");
}

#[test]
fn poses_need_not_be_normalised() {
    let place = folder();
    let mut model = colmap(place.path(), 2);
    model.images[1].rotation *= 3.0;
    model.images[1].translation = dvec3(1.0, 0.25, 4.0);
    let before = read(place.path()).views[1].camera;
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    let after = read(place.path()).views[1].camera;
    assert!(after.rotation.abs_diff_eq(before.rotation, 1e-6) && after.translation == before.translation);
}
