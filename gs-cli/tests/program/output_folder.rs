//! Output folders that hold more than results: a run replaces what runs wrote, and nothing else.

use std::{fs, path::Path};

use crate::{
    process::{folder, gs, names_in, picture},
    train::{dataset_and_scene, text},
};

/// The words of a small fit.
fn fit<'a>(image: &'a Path, output: &'a Path) -> Vec<&'a str> {
    vec!["fit", text(image), "-o", text(output), "-n", "20", "-i", "2", "--backend", "cpu"]
}

#[test]
fn every_command_refuses_to_replace_what_no_run_wrote() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let image = picture(place.path(), 24, 24);
    let (dataset, scene, image) = (text(&dataset), text(&scene), text(&image));
    let cases: [(&[&str], &str); 11] = [
        (&["fit", image], "curve.svg"),
        (&["fit", image, "--no-report"], "ellipses.png"),
        (&["fit"], "summary.json"),
        (&["train", dataset], "scene.ply"),
        (&["train", dataset, "--no-report"], "curve.svg"),
        (&["render", scene, "--orbit", "2"], "frame-00001.png"),
        (&["paper"], "index.html"),
        (&["popping", scene], "popping.png"),
        (&["frontier", scene], "frontier.json"),
        (&["study", "edges"], "report.html"),
        (&["study", "edges"], "plots/mine.svg"),
    ];
    for (words, name) in cases {
        let output = place.path().join("own");
        let file = output.join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, "mine").unwrap();
        let before = names_in(&output);
        let run = gs(words.iter().copied().chain(["-o", text(&output)]));
        let line = run.refusal();
        assert!(line.contains(&format!("{}: is in the way", file.display())) && line.contains("--overwrite"), "{line}");
        assert_eq!((fs::read(&file).unwrap(), names_in(&output)), (b"mine".to_vec(), before), "{words:?}");
        assert!(!output.join(".gs-lock").exists(), "{words:?}: nothing is begun");
        fs::remove_dir_all(&output).unwrap();
    }
}

#[test]
fn the_same_command_again_needs_no_flag_and_leaves_what_is_not_its_own() {
    let place = folder();
    let (image, output) = (picture(place.path(), 24, 24), place.path().join("out"));
    fs::create_dir(&output).unwrap();
    fs::write(output.join("notes.txt"), "mine").unwrap();
    gs(fit(&image, &output)).done();
    gs(fit(&image, &output)).done();
    gs(fit(&image, &output).into_iter().chain(["--no-report"])).done();
    assert!(!output.join("curve.svg").exists());

    // A file that was put in place of a removed picture is the user's.
    fs::write(output.join("curve.svg"), "mine").unwrap();
    assert!(gs(fit(&image, &output)).refusal().contains("curve.svg: is in the way"));
    gs(fit(&image, &output).into_iter().chain(["--overwrite"])).done();
    assert_ne!(fs::read(output.join("curve.svg")).unwrap(), b"mine");
    assert_eq!(fs::read(output.join("notes.txt")).unwrap(), b"mine");
}

#[test]
fn no_input_is_ever_replaced() {
    let place = folder();
    let (_, scene) = dataset_and_scene(place.path());
    let (image, picture) = (place.path().join("ellipses.png"), picture(place.path(), 24, 24));
    fs::copy(&picture, &image).unwrap();
    let [settings, linked] = ["settings.toml", "linked.png"].map(|name| place.path().join(name));
    fs::write(&settings, "gaussians = 25\niterations = 2\n").unwrap();
    fs::hard_link(&scene, &linked).unwrap();
    let [here, scene, image, picture, settings, linked] =
        [place.path(), &scene, &image, &picture, &settings, &linked].map(text);
    let other = format!("{here}/other");
    let cases: [&[&str]; 6] = [
        &["fit", image, "-o", here],
        &["fit", picture, "-o", here, "--settings", settings],
        &["fit", picture, "-o", &other, "--checkpoint", picture],
        &["render", scene, "-o", scene],
        &["render", scene, "-o", linked],
        &["convert", scene, scene],
    ];
    let before: Vec<_> = [scene, image, picture, settings].map(|file| fs::read(file).unwrap()).into();
    for words in cases {
        let overwrite = ["fit", "render"].contains(&words[0]).then_some("--overwrite");
        let run = gs(words.iter().copied().chain(overwrite));
        assert!(run.refusal().contains("is an input of this run"), "{words:?}: {run:?}");
        let after: Vec<_> = [scene, image, picture, settings].map(|file| fs::read(file).unwrap()).into();
        assert!(before == after, "{words:?}");
    }
    assert!(!Path::new(&other).exists());
}

#[cfg(unix)]
#[test]
fn files_of_an_input_folder_are_protected_as_inputs() {
    let place = folder();
    let (image, output) = (picture(place.path(), 24, 24), place.path().join("out"));
    gs(fit(&image, &output)).done();
    let scene = output.join("scene.gs2d.safetensors");
    let before = fs::read(&scene).unwrap();
    for words in [&["render", text(&output), "-o", text(&scene)][..], &["convert", text(&output), text(&scene)]] {
        let run = gs(words);
        assert!(run.status == Some(2) && run.stderr.contains("is an input of this run"), "{run:?}");
    }
    assert_eq!(fs::read(&scene).unwrap(), before);

    let (dataset, _) = dataset_and_scene(place.path());
    let mut files = vec![dataset.join("images/0.png")];
    for part in ["", "sparse", "sparse/0"] {
        let entries = fs::read_dir(dataset.join(part)).into_iter().flatten().flatten().map(|entry| entry.path());
        files.extend(entries.filter(|path| path.is_file()));
    }
    assert!(files.len() > 1, "{files:?}");
    for file in files.iter().filter(|file| file.exists()) {
        let run = gs(["train", text(&dataset), "--checkpoint", text(file), "--overwrite", "-o", text(&output)]);
        assert!(run.refusal().contains("is an input of this run"), "{run:?}");
    }
}

#[test]
fn results_of_a_fit_do_not_stay_beside_those_of_a_training() {
    let place = folder();
    let (image, output) = (picture(place.path(), 24, 24), place.path().join("out"));
    let (dataset, _) = dataset_and_scene(place.path());
    gs(fit(&image, &output)).done();
    let train =
        ["train", text(&dataset), "-o", text(&output), "-i", "2", "--start", "random", "-n", "50", "--backend", "cpu"];
    gs(train).done();
    let names = names_in(&output);
    assert!(
        names.contains(&"scene.ply".to_owned()) && !names.contains(&"scene.gs2d.safetensors".to_owned()),
        "{names:?}"
    );
    gs(fit(&image, &output)).done();
    assert!(!names_in(&output).contains(&"evaluation.json".to_owned()));
    let info = gs(["info", text(&output)]).done();
    assert!(info.stdout.contains("2D scene"), "{info:?}");
}

#[test]
fn a_second_run_in_the_same_folder_is_refused() {
    let place = folder();
    let (image, output) = (picture(place.path(), 32, 24), place.path().join("out"));
    let first = crate::fit::Endless::start(place.path(), &[]);
    let second = gs(fit(&image, &output));
    assert!(second.refusal().contains("out: another run of gs is at work in this folder: wait for it"), "{second:?}");
    let (status, said) = first.end("-INT", 1);
    assert_eq!(status, Some(130), "{said:?}");
    gs(fit(&image, &output)).done();
    assert_eq!(gs_io::read_image(output.join("reconstruction.png")).unwrap().image.size(), (32, 24));
}

#[test]
fn the_next_run_removes_half_written_files_of_a_killed_one() {
    let place = folder();
    let (image, output, states) =
        (picture(place.path(), 24, 24), place.path().join("out"), place.path().join("states"));
    let left = [&output, &states].map(|folder| folder.join(".gs-k1Ll3d.tmp"));
    [&output, &states].iter().for_each(|folder| fs::create_dir(folder).unwrap());
    left.iter().for_each(|file| fs::write(file, "half").unwrap());
    let state = states.join("state");
    gs(fit(&image, &output).into_iter().chain(["--checkpoint", text(&state)])).done();
    assert!(left.iter().all(|file| !file.exists()));
    assert_eq!(names_in(&states), ["state"]);
}
