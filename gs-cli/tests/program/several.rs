//! `gs encode` and `gs fit` of several images and folders.

use std::{fs, path::Path};

use serde_json::Value;

use crate::process::{folder, gs, names_in, picture};

/// A folder with two images and a file that is none, but has the name of one.
fn photos(place: &Path) -> String {
    let photos = place.join("photos");
    for (name, width) in [("large.png", 40), ("small.png", 24)] {
        fs::create_dir_all(&photos).unwrap();
        fs::rename(picture(place, width, 24), photos.join(name)).unwrap();
    }
    fs::write(photos.join("broken.jpg"), "no picture").unwrap();
    fs::write(photos.join("notes.txt"), "no image").unwrap();
    photos.to_str().unwrap().to_owned()
}

#[test]
fn a_broken_file_does_not_keep_the_others_from_being_encoded() {
    let place = folder();
    let (photos, out) = (photos(place.path()), place.path().join("out"));
    let words = ["encode", &photos, "-o", out.to_str().unwrap(), "--quality", "20", "--backend", "cpu"];
    let run = gs(words);
    assert_eq!(run.status, Some(1), "{run:?}");
    assert_eq!(names_in(&out), ["large.gsi", "small.gsi"]);
    let table: Vec<&str> = run.stdout.lines().collect();
    assert!(table.len() == 4 && table[0].starts_with("image ") && table[3].starts_with("2 images "), "{run:?}");
    assert!(table[1].contains("large.png") && table[1].contains("40x24"), "{run:?}");
    assert!(run.stderr.lines().any(|line| line.starts_with("failed: ") && line.contains("broken.jpg: ")), "{run:?}");
    assert_eq!(run.stderr.lines().last(), Some("error: 1 of 3 images failed, as said above"));

    // Files of gs are replaced; the bytes are those of a single image.
    let one = place.path().join("one.gsi");
    let single = [&format!("{photos}/large.png"), "-o", one.to_str().unwrap(), "--quality", "20", "--backend", "cpu"];
    gs(["encode"].iter().chain(&single)).done();
    assert!(fs::read(&one).unwrap() == fs::read(out.join("large.gsi")).unwrap());
    let again = gs(words.iter().chain(&["--json"]));
    let list: Value = serde_json::from_str(&again.stdout).unwrap();
    let list = list.as_array().unwrap();
    assert_eq!((again.status, list.len()), (Some(1), 3));
    assert!(list[0]["error"].is_string() && list[0]["image"].as_str().unwrap().ends_with("broken.jpg"));
    assert_eq!(list[1]["bytes"], fs::metadata(out.join("large.gsi")).unwrap().len());
    assert_eq!((&list[2]["width"], &list[2]["height"]), (&24.into(), &24.into()));
}

#[test]
fn errors_common_to_all_images_stop_the_run_at_its_start() {
    let place = folder();
    let photos = photos(place.path());
    let path = |name: &str| place.path().join(name).to_str().unwrap().to_owned();
    fs::create_dir_all(path("other")).unwrap();
    fs::copy(format!("{photos}/small.png"), path("other/Small.png")).unwrap();
    let (out, other, large) = (path("out"), path("other"), format!("{photos}/large.png"));
    let refused = |words: &[&str], status: i32, parts: &[&str]| {
        let run = gs(words.iter().chain(&["-o", &out]));
        assert_eq!(run.status, Some(status), "{run:?}");
        parts.iter().for_each(|part| assert!(run.refusal().contains(part), "{part}: {run:?}"));
        assert!(!Path::new(&out).exists(), "{words:?}");
    };
    for command in ["encode", "fit"] {
        let twice = ["small.png and ", "Small.png have one name", "rename one"];
        refused(&[command, &photos, &other], 2, &twice);
        let empty = path("empty");
        fs::create_dir_all(&empty).unwrap();
        refused(&[command, &empty, &photos], 1, &["empty: there is no image in this folder"]);
    }
    refused(&["encode", &photos, "--psnr", "5"], 2, &["the PSNR", "10 to 60 dB"]);
    refused(&["encode", &large, "--progressive", "--preview"], 2, &["cannot be used with"]);
    refused(&["encode", &large], 2, &["a compressed image is written as .gsi"]);
    refused(&["fit", &photos, "--resume", &large], 2, &["--resume: names the checkpoint of one fit"]);
    refused(&["fit", &photos, "--checkpoint", "state"], 2, &["--checkpoint: names the checkpoint of one fit"]);
    refused(&["fit", &photos, "--policy", "fastgs"], 2, &["fastgs"]);
    let file = gs(["encode", &photos, "-o", &path("out.gsi")]);
    assert!(file.refusal().contains("several images are written into a folder"), "{file:?}");

    // A file of somebody else's is not replaced, unless a flag says so.
    fs::create_dir_all(&out).unwrap();
    fs::write(path("out/small.gsi"), "mine").unwrap();
    let words = ["encode", &photos, "-o", &out, "--quality", "5", "--backend", "cpu"];
    assert!(gs(words).refusal().contains("small.gsi: is in the way"));
    assert_eq!(names_in(out.as_ref()), ["small.gsi"]);
    assert_eq!(gs(words.iter().chain(&["--overwrite"])).status, Some(1), "the broken one");
    gs(["info", &path("out/small.gsi")]).done();
}

#[test]
fn each_image_is_fitted_into_a_folder_of_its_own() {
    let place = folder();
    let (photos, out) = (photos(place.path()), place.path().join("out"));
    let flags = ["-n", "30", "-i", "20", "--backend", "cpu", "--no-report"];
    let words = ["fit", &photos, "-o", out.to_str().unwrap()];
    let run = gs(words.iter().chain(&flags).chain(&["--json"]));
    assert_eq!(run.status, Some(1), "{run:?}");
    assert_eq!(names_in(&out), ["large", "small"]);
    let list: Value = serde_json::from_str(&run.stdout).unwrap();
    assert!(list[0]["error"].is_string(), "{list}");
    for (index, name) in [(1, "large"), (2, "small")] {
        let stored = fs::read(out.join(name).join("summary.json")).unwrap();
        assert_eq!(list[index], serde_json::from_slice::<Value>(&stored).unwrap());
        assert_eq!(list[index]["gaussians"], 30);
    }
    // Threads do not change the result.
    let one = place.path().join("one");
    let single = ["fit", &format!("{photos}/large.png"), "-o", one.to_str().unwrap()];
    gs(single.iter().chain(&flags)).done();
    let scene = |folder: &Path| fs::read(folder.join("scene.gs2d.safetensors")).unwrap();
    assert!(scene(&one) == scene(&out.join("large")));
}

/// A fit that would not end by itself, of several images.
#[cfg(unix)]
#[test]
fn ctrl_c_stops_between_images() {
    use std::{
        io::{BufRead, BufReader},
        process::Stdio,
    };

    use crate::process::{command, signal};
    let place = folder();
    let (photos, out) = (photos(place.path()), place.path().join("out"));
    let words = ["fit", &photos, "-o", out.to_str().unwrap(), "-n", "30", "-i", "4000000", "--threads", "1"];
    let mut fit = command();
    let mut fit =
        fit.args(words).args(["--backend", "cpu"]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    while !out.join("large/metrics.part.csv").exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    signal(&fit, "-INT", 1);
    let said: Vec<String> = BufReader::new(fit.stderr.take().unwrap()).lines().map(Result::unwrap).collect();
    assert_eq!(fit.wait().unwrap().code(), Some(130), "{said:?}");
    assert_eq!(said.last().unwrap(), "stopped after 1 of 3 images");
    assert!(said.iter().any(|line| line.contains("large") && line.contains(" --resume ")), "{said:?}");
    assert_eq!(names_in(&out), ["large"]);
}
