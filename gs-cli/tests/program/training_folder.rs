//! Output folders of `gs train` that hold more than results.

use std::fs;

use crate::{
    process::{folder, gs, names_in},
    train::{dataset_and_scene, small, text},
};

#[test]
fn only_what_a_training_wrote_is_replaced_by_the_next() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let views = output.join("views");
    fs::create_dir_all(&views).unwrap();
    let theirs = [("holiday.png", "a holiday"), ("images_0.png", "a view of theirs"), ("notes.txt", "notes")];
    theirs.iter().for_each(|(name, content)| fs::write(views.join(name), content).unwrap());
    let still_there = || theirs.iter().all(|(name, content)| fs::read(views.join(name)).unwrap() == content.as_bytes());

    gs(small(&dataset, &output).into_iter().chain(["--holdout", "4"])).done();
    assert_eq!(names_in(&views), ["holiday.png", "images_0-2.png", "images_0.png", "images_4.png", "notes.txt"]);
    assert!(still_there());
    gs(small(&dataset, &output)).done();
    assert_eq!(names_in(&views), ["holiday.png", "images_0-2.png", "images_0.png", "notes.txt"]);
    gs(small(&dataset, &output).into_iter().chain(["--no-report"])).done();
    assert_eq!(names_in(&views), ["holiday.png", "images_0.png", "notes.txt"]);
    assert!(still_there());
}

#[test]
fn results_never_replace_the_images_of_the_data_set() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let refused = gs(small(&dataset, &dataset));
    assert!(refused.refusal().contains("results could replace files of the data set"), "{refused:?}");

    // A data set beside whose file the images are in `views`.
    let inner = place.path().join("capture/data");
    fs::create_dir_all(&inner).unwrap();
    fs::rename(dataset.join("images"), place.path().join("capture/views")).unwrap();
    let transforms = fs::read_to_string(dataset.join("transforms.json")).unwrap();
    fs::write(inner.join("transforms.json"), transforms.replace("images/", "../views/")).unwrap();
    let capture = place.path().join("capture");
    let refused = gs(small(&inner, &capture));
    assert!(refused.refusal().contains("file_path `../views/0.png` leads out of the data set's folder"), "{refused:?}");
    assert!(refused.refusal().contains("--allow-outside"), "{refused:?}");
    let refused = gs(small(&inner, &capture).into_iter().chain(["--allow-outside"]));
    assert!(refused.refusal().contains("views/0.png") && refused.refusal().contains("--output"), "{refused:?}");
    assert_eq!(names_in(&capture), ["data", "views"]);
    assert_eq!(names_in(&capture.join("views")).len(), 8);
    let other = capture.join("results");
    gs(["train", text(&inner), "-o", text(&other), "-i", "2", "-n", "20", "--backend", "cpu", "--allow-outside"])
        .done();
    assert_eq!(names_in(&capture.join("views")).len(), 8);
}
