//! Splits as data sets state them: lists, separate files, and what is done without.

use std::{fs, num::NonZeroU32, path::Path};

use crate::dataset::{Dataset, DatasetSettings, Remark, Skip, Split, SplitOrigin, read_dataset};
use serde_json::{Value, json};

use super::{
    made::{colmap, folder, picture, read, refusal, skipped},
    transforms::{frame, pinhole, write},
};

/// A `transforms.json` with frames `images/0.png` and so on, and these other fields.
fn listed(root: &Path, count: u32, fields: Value) {
    let names: Vec<String> = (0..count).map(|i| format!("images/{i}.png")).collect();
    names.iter().for_each(|name| drop(picture(root.join(name), 40, 30)));
    let mut file = pinhole();
    file["frames"] = names.iter().map(|name| frame(name)).collect();
    file.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    write(root, "transforms.json", &file);
}

/// Files of NeRF-synthetic with so many frames each; without images where `has_images` is false.
fn blender(root: &Path, files: &[(&str, u32, bool)]) {
    for &(split, count, has_images) in files {
        let names: Vec<String> = (0..count).map(|i| format!("./{split}/r_{i}")).collect();
        let pictures = names.iter().filter(|_| has_images);
        pictures.for_each(|name| drop(picture(root.join(format!("{name}.png")), 40, 40)));
        let frames: Vec<Value> = names.iter().map(|name| frame(name)).collect();
        write(root, &format!("transforms_{split}.json"), &json!({"camera_angle_x": 0.7, "frames": frames}));
    }
}

/// Numbers of views for training, validation and tests.
fn counts(dataset: &Dataset) -> [usize; 3] {
    [Split::Train, Split::Validation, Split::Test].map(|split| dataset.views_of(split).count())
}

fn every(n: u32) -> SplitOrigin {
    SplitOrigin::Every(NonZeroU32::new(n).unwrap())
}

#[test]
fn unlisted_frames_are_left_out() {
    let place = folder();
    let lists = json!({
        "train_filenames": ["images/0.png", "images/1.png"],
        "val_filenames": ["./images/2.png"],
        "test_filenames": ["images/3.png"],
    });
    listed(place.path(), 6, lists);
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([2, 1, 1], SplitOrigin::Lists));
    let unlisted = Remark::Skipped { why: Skip::Unlisted, count: 2, first: "images/4.png".to_owned(), detail: None };
    assert!(dataset.remarks.contains(&unlisted), "{:?}", dataset.remarks);
}

#[test]
fn frames_train_where_only_the_others_are_listed() {
    let place = folder();
    listed(place.path(), 4, json!({"train_filenames": [], "test_filenames": ["images/3.png"]}));
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([3, 0, 1], SplitOrigin::Lists));
    assert!(dataset.remarks.contains(&Remark::UnlistedTrained { count: 3, first: "images/0.png".to_owned() }));
}

#[test]
fn listed_names_are_compared_leniently() {
    for [train, test] in [["0.png", "1.png"], ["IMAGES\\0.PNG", ".\\images\\1.png"], ["data/images/0", "./images/1"]] {
        let place = folder();
        listed(place.path(), 2, json!({"train_filenames": [train], "test_filenames": [test]}));
        let dataset = read(place.path());
        assert_eq!(counts(&dataset), [1, 0, 1], "{train}, {test}");
        assert!(dataset.views[0].split == Split::Train, "{train}");
        let other = |remark: &&Remark| matches!(remark, Remark::ListedOtherwise { .. });
        assert!(dataset.remarks.iter().any(|remark| other(&remark)), "{:?}", dataset.remarks);
    }
}

#[test]
fn a_list_that_names_no_frame_is_refused() {
    let place = folder();
    listed(place.path(), 9, json!({"train_filenames": ["images/0.png"], "test_filenames": ["images/x.png"]}));
    let error = refusal(place.path());
    assert!(
        error.contains("transforms.json: test_filenames names no frame of the data set: it begins with `images/x.png`"),
        "{error}"
    );
    // A frame of another folder is another frame.
    listed(place.path(), 2, json!({"test_filenames": ["other/0.png"]}));
    assert!(refusal(place.path()).contains("test_filenames names no frame"));
    // Which of two frames a name without folder means is not guessed.
    let mut file = pinhole();
    file["frames"] = json!([frame("a/0.png"), frame("b/0.png")]);
    file["test_filenames"] = json!(["0.png"]);
    write(place.path(), "transforms.json", &file);
    assert!(refusal(place.path()).contains("test_filenames names no frame"));
}

#[test]
fn frames_listed_twice_and_names_without_frame_are_reported() {
    let place = folder();
    let lists = json!({
        "train_filenames": ["images/0.png", "images/1.png", "images/7.png"],
        "test_filenames": ["images/1.png"],
    });
    listed(place.path(), 2, lists);
    let dataset = read(place.path());
    assert_eq!(counts(&dataset), [1, 0, 1], "what is held out is not trained on");
    assert!(dataset.remarks.contains(&Remark::ListedTwice { count: 1, first: "images/1.png".to_owned() }));
    assert!(dataset.remarks.contains(&Remark::ListedWithoutFrame { count: 1, first: "images/7.png".to_owned() }));
}

#[test]
fn test_frames_are_held_out_and_bad_ones_left_out() {
    let place = folder();
    let mut test = frame("images/8.png");
    picture(place.path().join("images/8.png"), 40, 30);
    test["is_bad"] = json!(false);
    listed(place.path(), 8, json!({"test_frames": [test]}));
    let path = place.path().join("transforms.json");
    let mut file: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    file["frames"][3]["is_bad"] = json!(true);
    file["frames"][4]["mask_path"] = json!("4.png");
    file["has_mask"] = json!(false);
    write(place.path(), "transforms.json", &file);
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([7, 0, 1], SplitOrigin::Lists));
    assert_eq!(skipped(&dataset, Skip::MarkedBad), 1);
    assert_eq!(dataset.remarks.len(), 2, "no mask is missed: {:?}", dataset.remarks);
}

#[test]
fn withheld_test_images_do_not_hold_out_training_views() {
    let place = folder();
    blender(place.path(), &[("train", 8, true), ("test", 2, false)]);
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([8, 0, 0], SplitOrigin::Files));
    assert_eq!(skipped(&dataset, Skip::NoImage), 2);
    assert!(dataset.remarks.contains(&Remark::NoTestViews));
    blender(place.path(), &[("val", 2, true)]);
    assert_eq!(counts(&read(place.path())), [8, 0, 2], "validation views are there");
}

#[test]
fn validation_views_are_held_out_where_there_are_no_test_views() {
    let place = folder();
    blender(place.path(), &[("train", 8, true), ("val", 2, true)]);
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([8, 0, 2], SplitOrigin::Files));
    assert!(dataset.remarks.contains(&Remark::ValidationTested { count: 2 }));
    listed(place.path(), 3, json!({"train_filenames": ["0.png"], "val_filenames": ["1.png", "2.png"]}));
    let dataset = read(&place.path().join("transforms.json"));
    assert_eq!(counts(&dataset), [1, 0, 2]);
}

#[test]
fn a_data_set_is_not_trained_on_its_test_views() {
    let place = folder();
    blender(place.path(), &[("train", 3, false), ("test", 2, true)]);
    let error = refusal(place.path());
    assert!(error.contains("no view for training can be used: 3 images skipped"), "{error}");
    let place = folder();
    listed(place.path(), 2, json!({"test_filenames": ["0.png", "1.png"]}));
    assert!(refusal(place.path()).contains("no view for training can be used: its split lists none"));
}

#[test]
fn without_a_split_the_origin_is_the_setting() {
    let place = folder();
    blender(place.path(), &[("train", 8, true)]);
    let read = |n: u32| {
        let settings = DatasetSettings::default().with(|s| s.test_every = NonZeroU32::new(n));
        let dataset = read_dataset(place.path(), &settings).unwrap();
        (counts(&dataset), dataset.split)
    };
    assert_eq!(read(8), ([7, 0, 1], every(8)));
    assert_eq!(read(0), ([8, 0, 0], SplitOrigin::None));
    assert_eq!(read(1), ([8, 0, 0], SplitOrigin::None), "one must be for training");
    assert_eq!(every(8).to_string(), "1 of 8 images by name held out: the data set states no split");
}

#[test]
fn a_split_may_be_replaced() {
    let place = folder();
    listed(place.path(), 6, json!({"train_filenames": ["images/0.png"], "test_filenames": ["images/3.png"]}));
    let replaced = |test_every| {
        let settings = DatasetSettings::default().with(|s| (s.test_every, s.replace_split) = (test_every, true));
        read_dataset(place.path(), &settings).unwrap()
    };
    let dataset = replaced(NonZeroU32::new(3));
    assert_eq!((counts(&dataset), dataset.split), ([4, 0, 2], SplitOrigin::Replaced(NonZeroU32::new(3))));
    assert!(dataset.remarks.contains(&Remark::SplitReplaced));
    assert_eq!(counts(&replaced(None)), [6, 0, 0]);
    // Without a split, nothing is replaced.
    listed(place.path(), 6, json!({}));
    let dataset = replaced(NonZeroU32::new(3));
    assert_eq!((dataset.split, dataset.remarks.contains(&Remark::SplitReplaced)), (every(3), false));
}

#[test]
fn lists_of_scannetpp_are_read() {
    let place = folder();
    let inner = place.path().join("nerfstudio");
    listed(&inner, 6, json!({}));
    write(place.path(), "train_test_lists.json", &json!({"train": ["0.png", "2.png"], "test": ["5.png"]}));
    assert_eq!(read(&inner).split, every(8), "files outside are not read unless they are allowed");
    let dataset = read_dataset(&inner, &DatasetSettings::default().with(|s| s.allow_outside = true)).unwrap();
    assert_eq!((counts(&dataset), dataset.split), ([2, 0, 1], SplitOrigin::Lists));
    assert_eq!(skipped(&dataset, Skip::Unlisted), 3);
    colmap(place.path(), 4);
    let lists = json!({"train": ["view 000.png", "view 001.png"], "test": ["view 003.png"]});
    write(place.path(), "train_test_lists.json", &lists);
    assert_eq!(counts(&read(place.path())), [2, 0, 1]);
}

#[test]
fn the_test_list_of_3dgs_is_read() {
    let place = folder();
    colmap(place.path(), 4);
    let list = place.path().join("sparse/0/test.txt");
    fs::write(&list, "\u{feff}view 001.png\r\nview 002.png\r\n\r\n").unwrap();
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([2, 0, 2], SplitOrigin::Lists));
    assert!(!dataset.remarks.iter().any(|remark| matches!(remark, Remark::UnlistedTrained { .. })));
    fs::write(&list, "other.png\n").unwrap();
    assert!(refusal(place.path()).contains("test.txt: the list names no frame of the data set"));
}

#[test]
fn a_test_frame_that_is_also_a_training_frame_is_held_out() {
    let place = folder();
    // The same image with and without its extension is one image, too.
    listed(place.path(), 4, json!({"test_frames": [frame("./images/1.png"), frame("images/3")]}));
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([2, 0, 2], SplitOrigin::Lists));
    assert!(dataset.remarks.contains(&Remark::ListedTwice { count: 2, first: "images/1.png".to_owned() }));
    let replaced = DatasetSettings::default().with(|s| s.replace_split = true);
    assert_eq!(read_dataset(place.path(), &replaced).unwrap().views.len(), 4);
    // So is one by its path on another machine.
    listed(place.path(), 4, json!({"test_frames": [frame("/home/x/images/1.png")]}));
    assert_eq!(counts(&read(place.path())), [3, 0, 1]);

    let place = folder();
    blender(place.path(), &[("train", 4, true)]);
    let test = json!({"camera_angle_x": 0.7, "frames": [frame("train/r_2"), frame("./train/r_0.png")]});
    write(place.path(), "transforms_test.json", &test);
    let dataset = read(place.path());
    assert_eq!((counts(&dataset), dataset.split), ([2, 0, 2], SplitOrigin::Files));
    assert!(dataset.remarks.iter().any(|remark| matches!(remark, Remark::ListedTwice { count: 2, .. })));
    fs::copy(place.path().join("transforms_train.json"), place.path().join("transforms_test.json")).unwrap();
    assert!(refusal(place.path()).contains("4 frames listed both for training and for tests or validation"));
}

#[test]
fn frames_may_say_their_split() {
    let place = folder();
    let with_splits = |splits: &[Value], fields: Value| {
        listed(place.path(), 6, fields);
        let path = place.path().join("transforms.json");
        let mut file: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        (0..6).for_each(|i| file["frames"][i]["split"] = splits[i].clone());
        write(place.path(), "transforms.json", &file);
        read(place.path())
    };
    let splits = ["train", "val", "test", "eval", "train", "other"].map(Value::from);
    let dataset = with_splits(&splits, json!({}));
    assert_eq!((counts(&dataset), dataset.split), ([2, 1, 2], SplitOrigin::Lists));
    assert_eq!(skipped(&dataset, Skip::Unlisted), 1);
    // Beside lists, what either holds out is held out.
    let dataset =
        with_splits(&splits, json!({"train_filenames": ["images/2.png"], "test_filenames": ["images/4.png"]}));
    assert_eq!(counts(&dataset), [1, 1, 3]);
    let mut splits = vec![Value::Null; 6];
    assert_eq!(with_splits(&splits, json!({})).split, every(8));
    splits[5] = json!("test");
    assert_eq!(counts(&with_splits(&splits, json!({}))), [5, 0, 1]);
}
