//! Camera poses that are refined while a scene is trained.

use gs_io::dataset::{Dataset, DatasetSettings, read_dataset};

use crate::{
    process::{folder, gs},
    train::{dataset_and_scene, text},
};

#[test]
fn refined_cameras_are_a_data_set_of_their_own() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let output = place.path().join("out");
    let train = |iterations: &'static str| {
        let words =
            ["train", text(&dataset), "-o", text(&output), "--backend", "cpu", "--preset", "quick", "-n", "300"];
        gs(words.into_iter().chain(["--no-report", "--refine-poses", "on", "-i", iterations]))
    };
    let run = train("20");
    assert!(
        run.status == Some(0) && run.stderr.contains("20 steps are too few for 7 views; at least 105"),
        "{}",
        run.stderr
    );
    assert!(!output.join("refined").exists());
    let run = train("120");
    assert!(run.status == Some(0) && run.stderr.contains("poses were refined: images moved by"), "{}", run.stderr);
    let refined = output.join("refined");
    let again = place.path().join("again");
    let words = ["train", text(&refined), "--allow-outside", "-o", text(&again), "--backend", "cpu", "-i", "20"];
    let summary = gs(words.into_iter().chain(["-n", "300", "--no-report", "--json"])).json();
    assert_eq!((&summary["train_views"], &summary["test_views"]), (&7.into(), &1.into()), "{summary}");
    let read = |name: &str, images: Option<String>| {
        let settings = DatasetSettings::default().with(|s| (s.image_folder, s.allow_outside) = (images, true));
        read_dataset(refined.join(name), &settings).unwrap()
    };
    let images = dataset.display().to_string();
    let (transforms, colmap) = (read("", None), read("colmap-model", Some(images)));
    let cameras = |dataset: &Dataset| dataset.views.iter().map(|view| view.camera.position()).collect::<Vec<_>>();
    let (transforms, colmap) = (cameras(&transforms), cameras(&colmap));
    assert!(colmap.len() == 8 && transforms.iter().zip(colmap).all(|(a, b)| a.distance(b) < 1e-5));
    let compared = gs(["eval", text(&scene), text(&dataset), "--refine-poses", "--json", "--backend", "cpu"]).json();
    assert!(compared["pose-matched"]["psnr"].as_f64().unwrap() > 20.0, "{compared}");
    let image = place.path().join("image.png");
    gs_io::write_png(&image, &gs_core::Image::filled(8, 8, [0.5; 3]).unwrap()).unwrap();
    let refused = gs(["eval", text(&image), text(&image), "--refine-poses"]);
    assert!(refused.status == Some(2) && refused.stderr.contains("only a 3D scene"), "{}", refused.stderr);
    // Without refinement, the cameras of an earlier run go.
    let words =
        ["train", text(&dataset), "-o", text(&output), "--backend", "cpu", "-n", "300", "--no-report", "-i", "20"];
    assert_eq!(gs(words).status, Some(0));
    assert!(!refined.exists());
}
