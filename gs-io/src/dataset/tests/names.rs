//! Names of images that differ from those of the files: Windows paths, letter case, Unicode form and
//! folder.

use std::fs;

use crate::dataset::{Dataset, DatasetSettings, Remark, read_dataset};
use serde_json::json;

use super::{
    made::{binary, colmap, folder, model, picture, read, refusal, write_model, write_pictures},
    transforms::{frame, nerfstudio, pinhole, write},
};

/// The data set of frames with these names.
fn named(root: &std::path::Path, names: &[&str]) {
    let mut file = pinhole();
    file["frames"] = names.iter().map(|name| frame(name)).collect();
    write(root, "transforms.json", &file);
}

fn renamed(dataset: &Dataset) -> Option<(usize, &str, &str)> {
    dataset.remarks.iter().find_map(|remark| match remark {
        Remark::Renamed { count, first, file } => Some((*count, first.as_str(), file.as_str())),
        _ => None,
    })
}

#[test]
fn windows_paths_are_read() {
    let place = folder();
    picture(place.path().join("masks/a.png"), 40, 30);
    nerfstudio(place.path(), json!({}));
    let mut first = frame("images\\a.png");
    first["mask_path"] = json!(".\\masks\\a.png");
    let mut file = pinhole();
    file["frames"] = json!([first, frame(".\\images\\b.png")]);
    write(place.path(), "transforms.json", &file);
    let dataset = read(place.path());
    let names: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["images/a.png", "images/b.png"]);
    assert!(dataset.views[0].mask.is_some() && renamed(&dataset).is_none(), "{:?}", dataset.remarks);

    let place = folder();
    let mut model = model(2);
    model.images[0].name = "sub\\0.png".to_owned();
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    model.images[0].name = "sub/0.png".to_owned();
    write_pictures(&place.path().join("images"), &model, 1);
    assert_eq!(read(place.path()).views.len(), 2);
}

#[test]
fn windows_paths_do_not_leave_the_folder() {
    let place = folder();
    nerfstudio(place.path(), json!({}));
    for name in ["..\\secret\\a.png", "C:\\Users\\x.png", "images\\..\\..\\a.png", "\\\\server\\x.png", "\\x.png"] {
        named(place.path(), &["images/a.png", name]);
        let error = refusal(place.path());
        assert!(error.contains("leads out of the data set's folder"), "{name}: {error}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_single_similar_name_is_taken_with_a_remark() {
    for (file, name) in [
        ("images/IMG_1.JPG.png", "images/img_1.jpg.png"),
        ("Images/0.png", "images/0.png"),
        ("images/A.PNG", "images/a"),
        ("images/u\u{308}.png", "images/\u{fc}.png"),
        ("images/\u{fc}.PNG", "images/u\u{308}.jpg"),
        ("images\\0.png", "images/0.png"),
    ] {
        let place = folder();
        picture(place.path().join(file).with_extension("png"), 40, 30);
        let _ = fs::rename(place.path().join(file).with_extension("png"), place.path().join(file));
        named(place.path(), &[name]);
        let dataset = read(place.path());
        assert_eq!(renamed(&dataset), Some((1, name, file)));
        assert_eq!(dataset.views[0].read_image().unwrap().image.size(), (40, 30));
    }
    // COLMAP's names are relative to the folder of images.
    let place = folder();
    let model = model(3);
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    write_pictures(&place.path().join("Images"), &model, 1);
    let dataset = read(place.path());
    assert_eq!(renamed(&dataset), Some((3, "view 000.png", "Images/view 000.png")));
}

#[test]
#[cfg(target_os = "linux")]
fn an_ambiguous_name_matches_no_file() {
    let place = folder();
    for file in ["AB.png", "ab.PNG.png"] {
        picture(place.path().join("images").join(file), 40, 30);
    }
    fs::rename(place.path().join("images/ab.PNG.png"), place.path().join("images/ab.PNG")).unwrap();
    named(place.path(), &["images/aB.png"]);
    let error = refusal(place.path());
    assert!(error.contains("(first: images/aB.png: several files fit: images/AB.png, images/ab.PNG)"), "{error}");
}

#[test]
fn images_in_one_other_folder_are_taken_from_there() {
    let place = folder();
    for name in ["a", "b"] {
        picture(place.path().join(format!("photos/x/{name}.png")), 40, 30);
    }
    named(place.path(), &["images/a.png", "images/b.png"]);
    let dataset = read(place.path());
    assert!(
        dataset.views.len() == 2 && dataset.remarks.contains(&Remark::OtherFolder { folder: "photos/x".to_owned() })
    );
    // Masks and the like have the names of the images, but are none.
    for folder in ["masks", "Depth", "normals_2", "x/mask/y"] {
        picture(place.path().join(folder).join("a.png"), 40, 30);
    }
    assert_eq!(read(place.path()).views.len(), 2);
    // Which of two folders is meant is not guessed.
    picture(place.path().join("copies/a.png"), 40, 30);
    let error = refusal(place.path());
    let end = "(first: images/a.png, images/b.png: there is Depth/a.png, copies/a.png, masks/a.png)";
    assert!(error.contains("2 images skipped: no image file") && error.contains(end), "{error}");
}

#[test]
fn images_beside_the_folder_are_taken_if_that_is_allowed() {
    let place = folder();
    picture(place.path().join("undistorted_images/a.png"), 40, 30);
    let root = place.path().join("nerfstudio");
    fs::create_dir(&root).unwrap();
    named(&root, &["a.png"]);
    assert!(refusal(&root).contains("there is ../undistorted_images/a.png, but outside of the data set's folder"));
    let settings = DatasetSettings::default().with(|s| s.allow_outside = true);
    assert_eq!(read_dataset(&root, &settings).unwrap().views.len(), 1);
}

#[test]
fn missing_images_are_named_with_what_is_there() {
    let place = folder();
    picture(place.path().join("images/frame_1.png"), 40, 30);
    picture(place.path().join("images/0.png"), 40, 30);
    named(place.path(), &["images/0.png", "images/1.png", "images/2.png", "images/3.png", "images/4.png"]);
    let remark = read(place.path()).remarks[0].to_string();
    assert_eq!(
        remark,
        "4 images skipped: no image file (first: images/1.png, images/2.png, images/3.png: its folder has 2 other \
         images, such as images/0.png)"
    );
    named(place.path(), &["photos/1.png"]);
    assert!(refusal(place.path()).contains("(first: photos/1.png: there is no folder photos)"));
}

#[test]
#[cfg(target_os = "linux")]
fn masks_depth_maps_and_points_are_found_under_similar_names() {
    let place = folder();
    nerfstudio(place.path(), json!({}));
    picture(place.path().join("Masks/A.png"), 40, 30);
    picture(place.path().join("Depths/a.png"), 40, 30);
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    fs::write(place.path().join("Points.PLY"), ply).unwrap();
    let mut first = frame("images/a.png");
    first["mask_path"] = json!("masks/a.png");
    first["depth_file_path"] = json!("depths\\a.png");
    let mut file = pinhole();
    file["frames"] = json!([first]);
    file["ply_file_path"] = json!(".\\points.ply");
    write(place.path(), "transforms.json", &file);
    let dataset = read(place.path());
    let view = &dataset.views[0];
    assert!(view.mask.is_some() && view.depth.is_some() && dataset.points.len() == 1, "{:?}", dataset.remarks);
    // A picture of the depths is not the depths.
    file["frames"][0]["depth_file_path"] = json!("depths/a.npy");
    file["ply_file_path"] = json!("depths/a.ply");
    write(place.path(), "transforms.json", &file);
    let dataset = read(place.path());
    assert!(dataset.views[0].depth.is_none() && dataset.points.is_empty(), "{:?}", dataset.remarks);
}

#[test]
#[cfg(target_os = "linux")]
fn a_file_is_the_image_of_one_view_only() {
    let place = folder();
    picture(place.path().join("images/a.png"), 40, 30);
    named(place.path(), &["images/A.png", "images/a.png", "images/B.png"]);
    picture(place.path().join("images/b.png"), 40, 30);
    let dataset = read(place.path());
    let names: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["images/B.png", "images/a.png"]);
}

#[test]
fn masks_are_not_taken_for_missing_images() {
    let place = folder();
    let mut frames = json!([frame("images/a.png"), frame("images/b.png")]);
    for (i, name) in ["masks/a.png", "masks/b.png"].into_iter().enumerate() {
        picture(place.path().join(name), 40, 30);
        frames[i]["mask_path"] = json!(name);
    }
    let mut file = pinhole();
    file["frames"] = frames;
    write(place.path(), "transforms.json", &file);
    assert!(refusal(place.path()).contains("2 images skipped: no image file"));
}

#[test]
fn a_file_that_fits_two_frames_is_the_image_of_neither() {
    let near = "(first: left/0.png, right/0.png: there is images/0.png)";
    for names in [["left/0.png", "right/0.png"], ["right/0", "left/0.jpg"]] {
        let place = folder();
        picture(place.path().join("images/0.png"), 40, 30);
        named(place.path(), &names);
        let error = refusal(place.path());
        assert!(
            error.contains("2 images skipped: no image file") && error.contains("there is images/0.png"),
            "{error}"
        );
        assert!(names[0] != "left/0.png" || error.contains(near), "{error}");
    }
    // A name that is that of the file comes first.
    let place = folder();
    picture(place.path().join("images/0.png"), 40, 30);
    named(place.path(), &["images/0.jpg", "images/0.png", "images/0.PNG"]);
    let dataset = read(place.path());
    assert!(dataset.views.len() == 1 && dataset.views[0].name == "images/0.png" && renamed(&dataset).is_none());
}

#[test]
fn images_of_another_folder_or_extension_are_reported() {
    for (file, name) in [
        ("images/0.png", "images/0.jpg"),
        ("images/0.jpg.png", "images/0.jpg"),
        ("images/0.png", "0.png"),
        ("images/0.png", "color/0.png"),
        ("images_2/0.png", "images/0.png"),
    ] {
        let place = folder();
        picture(place.path().join(file), 40, 30);
        named(place.path(), &[name]);
        assert_eq!(renamed(&read(place.path())), Some((1, name, file)));
    }
    for (file, name) in [("images/0.png", "images/0"), ("images/0.5.png", "./images/0.5"), ("a/../0.png", "a/../0.png")]
    {
        let place = folder();
        fs::create_dir(place.path().join("a")).unwrap();
        picture(place.path().join(file), 40, 30);
        named(place.path(), &[name]);
        assert_eq!(renamed(&read(place.path())), None, "{name}");
    }
    // The folder of COLMAP's images is the usual one, and another may be asked for.
    let place = folder();
    colmap(place.path(), 2);
    assert_eq!(renamed(&read(place.path())), None);
    let place = folder();
    picture(place.path().join("small/0.png"), 40, 30);
    named(place.path(), &["images/0.png"]);
    let settings = DatasetSettings::default().with(|s| s.image_folder = Some("small".to_owned()));
    assert_eq!(renamed(&read_dataset(place.path(), &settings).unwrap()), None);
}

#[test]
fn masks_alone_are_no_photographs() {
    let place = folder();
    picture(place.path().join("data/masks/a.png"), 40, 30);
    named(place.path(), &["images/a.png"]);
    assert!(refusal(place.path()).contains("no image file (first: images/a.png: there is data/masks/a.png)"));
    // Unless the file names their folder.
    named(place.path(), &["masks/a.png"]);
    assert_eq!(read(place.path()).views.len(), 1);
}

#[test]
fn absolute_paths_of_another_machine_are_those_inside_that_end_alike() {
    for (name, file) in [
        ("/home/x/images/0.png", "images/0.png"),
        ("C:\\data\\images\\0.jpg", "images/0.png"),
        ("\\\\server\\..\\photos\\0.png", "photos/0.png"),
        ("/data/0.png", "0.png"),
        ("/data/0.png", "images/0.png"),
        ("/data/images/0.png", "photos/0.png"),
    ] {
        let place = folder();
        picture(place.path().join(file), 40, 30);
        picture(place.path().join("masks/0.png"), 40, 30);
        let mut only = frame(name);
        only["mask_path"] = json!("/home/x/masks/0.png");
        let mut file_of_frames = pinhole();
        file_of_frames["frames"] = json!([only]);
        write(place.path(), "transforms.json", &file_of_frames);
        for allow_outside in [false, true] {
            let settings = DatasetSettings::default().with(|s| s.allow_outside = allow_outside);
            let dataset = read_dataset(place.path(), &settings).unwrap();
            assert_eq!(renamed(&dataset), Some((1, name, file)));
            assert!(dataset.views[0].mask.is_some());
        }
    }
    // A file that two paths end in is that of neither.
    for file in ["0.png", "images/0.png"] {
        let place = folder();
        picture(place.path().join(file), 40, 30);
        named(place.path(), &["/home/left/0.png", "/home/right/0.png"]);
        let error = refusal(place.path());
        assert!(error.contains(&format!("there is {file}")), "{error}");
    }
    let place = folder();
    let mut model = colmap(place.path(), 2);
    model.images.iter_mut().for_each(|image| image.name = format!("/home/x/images/{}", image.name));
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    let dataset = read(place.path());
    assert_eq!(renamed(&dataset), Some((2, "/home/x/images/view 000.png", "images/view 000.png")));
    assert_eq!(dataset.views[1].name, "view 001.png");
}

#[test]
fn a_file_outside_is_never_read_for_one_inside() {
    let place = folder();
    let outside = picture(place.path().join("secret/a.png"), 40, 30);
    let root = place.path().join("data");
    picture(root.join("a.png"), 40, 30);
    named(&root, &[outside.to_str().unwrap()]);
    assert_eq!(read(&root).views[0].image, root.join("a.png"));
    let settings = DatasetSettings::default().with(|s| s.allow_outside = true);
    assert_eq!(read_dataset(&root, &settings).unwrap().views[0].image, outside);
}
