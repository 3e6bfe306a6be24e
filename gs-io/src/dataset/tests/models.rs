//! Which COLMAP model of a data set is read, and what is said where another folder should be named.

use std::fs;

use crate::dataset::{Dataset, Remark};

use super::made::{binary, colmap, folder, model, read, refusal, text, write_model, write_pictures};

/// The remark on several models: the one that is read, and the others.
fn models(dataset: &Dataset) -> (&str, &[String]) {
    let remark = dataset.remarks.iter().find_map(|remark| match remark {
        Remark::OtherModels { read, others } => Some((&**read, &**others)),
        _ => None,
    });
    remark.expect("a remark on other models")
}

#[test]
fn the_largest_of_several_models_is_read() {
    let place = folder();
    let whole = colmap(place.path(), 5);
    for (name, count) in [("0", 2), ("2", 3)] {
        write_model(&place.path().join("sparse").join(name), &binary(&model(count)), "bin");
    }
    write_model(&place.path().join("sparse/1"), &text(&whole), "txt");
    fs::create_dir(place.path().join("sparse/other")).unwrap();
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 5);
    let [Remark::OtherModels { read, others }] = &dataset.remarks[..1] else { panic!("{:?}", dataset.remarks) };
    assert_eq!(read, "sparse/1 (5 images)");
    assert_eq!(others, &["sparse/0 (2 images)", "sparse/2 (3 images)"]);
}

#[test]
fn models_of_different_folders_are_compared() {
    for larger in ["distorted/sparse/0", "dense/sparse", "undistorted/sparse", "colmap/sparse/0", "3"] {
        let place = folder();
        let whole = colmap(place.path(), 6);
        write_model(&place.path().join(larger), &binary(&whole), "bin");
        write_model(&place.path().join("sparse/0"), &binary(&model(2)), "bin");
        let dataset = read(place.path());
        assert_eq!(dataset.views.len(), 6, "{larger}");
        assert_eq!(models(&dataset), (&*format!("{larger} (6 images)"), &["sparse/0 (2 images)".to_owned()][..]));
    }
}

#[test]
fn a_model_without_its_photographs_is_not_read() {
    let place = folder();
    let mut gone = colmap(place.path(), 5);
    write_model(&place.path().join("sparse/1"), &binary(&model(3)), "bin");
    gone.images.iter_mut().for_each(|image| image.name = format!("gone {}", image.name));
    write_model(&place.path().join("sparse/0"), &binary(&gone), "bin");
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 3);
    let others = ["sparse/0 (5 images, 0 of them with a file)".to_owned()];
    assert_eq!(models(&dataset), ("sparse/1 (3 images)", &others[..]));
}

#[test]
fn an_undistorted_model_is_preferred_to_an_equal_one() {
    let place = folder();
    let mut whole = colmap(place.path(), 3);
    let dense = place.path().join("dense");
    whole.cameras.remove(&7);
    whole.images.iter_mut().for_each(|image| image.camera_id = 1);
    write_model(&dense.join("sparse"), &binary(&whole), "bin");
    write_pictures(&dense.join("images"), &whole, 1);
    let dataset = read(place.path());
    assert!(dataset.views.iter().all(|view| view.image.starts_with(&dense)));
    assert_eq!(models(&dataset).0, "dense/sparse (3 images)");
    // A copy of the same model needs no remark.
    write_model(&place.path().join("sparse/0"), &binary(&whole), "bin");
    let remarks = read(place.path()).remarks;
    assert!(!remarks.iter().any(|remark| matches!(remark, Remark::OtherModels { .. })), "{remarks:?}");
}

#[test]
fn a_damaged_model_beside_a_good_one_is_called_damaged() {
    let place = folder();
    colmap(place.path(), 3);
    write_model(&place.path().join("sparse/1"), &binary(&model(2)), "bin");
    let images = place.path().join("sparse/0/images.bin");
    let bytes = fs::read(&images).unwrap();
    fs::write(&images, &bytes[..bytes.len() / 2]).unwrap();
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 2);
    let (read, others) = models(&dataset);
    assert_eq!(read, "sparse/1 (2 images)");
    assert!(others[0].starts_with("sparse/0 (images.bin: byte ") && others[0].contains("damaged"), "{others:?}");
}

#[test]
fn models_are_found_where_programs_put_them() {
    let model = model(3);
    for (folder_of_model, folder_of_images) in [
        ("sparse", "images"),
        ("sparse/1", "images"),
        ("sparse/0", "input"),
        ("colmap/sparse/0", "images"),
        ("distorted/sparse/0", "input"),
        ("dense/sparse", "dense/images"),
        ("dense/0/sparse", "dense/0/images"),
        ("undistorted/sparse", "undistorted/images"),
        ("3", "images"),
        (".", "images"),
        (".", "."),
    ] {
        let place = folder();
        let (of_model, of_images) = (place.path().join(folder_of_model), place.path().join(folder_of_images));
        write_model(&of_model, &binary(&model), "bin");
        write_pictures(&of_images, &model, 1);
        let dataset = read(place.path());
        assert_eq!(dataset.views.len(), 3, "{folder_of_model}");
        let is_cameras = |file: &std::path::PathBuf| file.ends_with("cameras.bin");
        assert!(dataset.files().iter().any(is_cameras), "{folder_of_model}: which no run may replace");
        // The model's own folder may be named, too.
        assert_eq!(read(&of_model).views.len(), 3, "{folder_of_model}");
    }
}

#[test]
fn text_is_read_where_the_binary_files_are_damaged() {
    let place = folder();
    let model = colmap(place.path(), 3);
    let sparse = place.path().join("sparse/0");
    fs::write(sparse.join("cameras.bin"), b"").unwrap();
    assert!(refusal(place.path()).contains("cameras.bin"));
    write_model(&sparse, &text(&model), "txt");
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 3);
    assert!(matches!(&dataset.remarks[0], Remark::TextModel { error } if error.contains("cameras.bin")));
    // The empty file is the fault, not those that are missing beside it.
    fs::remove_file(sparse.join("images.bin")).unwrap();
    let dataset = read(place.path());
    assert!(matches!(&dataset.remarks[0], Remark::TextModel { error } if error.contains("cameras.bin")));
}

#[test]
fn a_part_of_a_data_set_may_be_named() {
    let place = folder();
    colmap(place.path(), 2);
    for part in ["sparse", "sparse/0/..", "sparse/0"] {
        assert_eq!(read(&place.path().join(part)).views.len(), 2, "{part}");
    }
    for part in ["images", "images/inner", "sparse/../images"] {
        let part = place.path().join(part);
        fs::create_dir_all(&part).unwrap();
        let expected = format!("it is part of the data set {}: name that", place.path().display());
        assert!(refusal(&part).ends_with(&expected), "{}", refusal(&part));
    }
}

#[test]
fn a_folder_above_a_data_set_names_it() {
    let place = folder();
    let scans = place.path().join("scans");
    colmap(&scans.join("house"), 2);
    let error = refusal(place.path());
    assert!(error.ends_with(&format!("; name {}", scans.join("house").display())), "{error}");
    fs::create_dir(scans.join("tree")).unwrap();
    fs::write(scans.join("tree/transforms.json"), "{}").unwrap();
    let error = refusal(place.path());
    assert!(error.ends_with(&format!("; name {}, one of 2 data sets in it", scans.join("house").display())), "{error}");
    // A model whose photographs are not near it.
    write_model(&scans.join("a/b/model"), &binary(&model(1)), "bin");
    fs::remove_dir_all(scans.join("house")).unwrap();
    fs::remove_dir_all(scans.join("tree")).unwrap();
    let error = refusal(place.path());
    assert!(error.ends_with("a/b/model with the folder of its images by --images"), "{error}");
}
