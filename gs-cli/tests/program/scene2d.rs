//! 2D scenes outside of a fit: in output folders, in checkpoints, beside images.

use std::{fs, path::Path};

use gs_core::Image;
use serde_json::Value;

use crate::{
    process::{folder, gs, names_in, picture},
    train::{dataset_and_scene, small},
};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn read(path: &Path) -> Image {
    gs_io::read_image(path).unwrap().image
}

/// Fits a small picture, blended so.
fn fitted(place: &Path, blend: &str) -> std::path::PathBuf {
    let image = picture(place, 48, 32);
    let output = place.join(blend);
    let flags = ["-n", "150", "-i", "100", "--no-report", "--blend", blend, "--backend", "cpu"];
    gs(["fit", text(&image), "-o", text(&output)].into_iter().chain(flags)).done();
    output
}

#[test]
fn scenes_are_not_written_in_formats_of_the_other_kind() {
    let place = folder();
    let output = fitted(place.path(), "sum");
    let spz = gs(["convert", text(&output), text(&place.path().join("a.spz"))]);
    assert_eq!(spz.status, Some(2));
    assert!(spz.stderr.contains("a.spz: cannot write a 2D scene in this format: use .gs2d.safetensors"), "{spz:?}");
    let (_, scene) = dataset_and_scene(place.path());
    let refused = gs(["convert", text(&scene), text(&place.path().join("b.gs2d.safetensors"))]);
    assert_eq!(refused.status, Some(2));
    assert!(refused.refusal().contains("b.gs2d.safetensors: cannot write a 3D scene in this format"), "{refused:?}");
}

#[test]
fn a_compressed_scene_and_a_checkpoint_become_scene_files_without_loss() {
    let place = folder();
    let (image, output) = (picture(place.path(), 48, 32), place.path().join("fit"));
    let compressed = place.path().join("a.gsi");
    let fit = [
        "fit",
        text(&image),
        "-o",
        text(&output),
        "-n",
        "50",
        "-i",
        "20",
        "--checkpoint-every",
        "20",
        "--backend",
        "cpu",
    ];
    gs(fit).done();
    gs(["encode", text(&image), "-o", text(&compressed), "--bpp", "1", "--backend", "cpu"]).done();
    for (name, from) in [("b", compressed), ("c", output.join("checkpoint.safetensors"))] {
        let scene = place.path().join(format!("{name}.gs2d.safetensors"));
        let printed = gs(["convert", text(&from), text(&scene)]).done().stdout;
        assert!(printed.contains("lost        nothing"), "{printed}");
        let drawn = [&from, &scene].map(|file| {
            let png = file.with_extension("png");
            gs(["render", text(file), "-o", text(&png), "--backend", "cpu"]).done();
            fs::read(png).unwrap()
        });
        assert!(drawn[0] == drawn[1], "{printed}");
    }
    let (half, transparent) = (place.path().join("half.png"), place.path().join("half.gsi"));
    let see_through = vec![0.5; 48 * 32];
    let extras = gs_io::PngExtras { alpha: Some(&see_through), profile: None };
    gs_io::write_png_with(&half, &read(&image), extras).unwrap();
    gs(["encode", text(&half), "-o", text(&transparent), "--bpp", "1", "--backend", "cpu"]).done();
    let printed = gs(["convert", text(&transparent), text(&place.path().join("half.gs2d.safetensors"))]).done().stdout;
    assert!(printed.contains("lost        alpha") && !printed.contains("nothing"), "{printed}");
    let (_, scene) = dataset_and_scene(place.path());
    let refused = gs(["convert", text(&scene), text(&place.path().join("d.gs2d.safetensors"))]);
    assert_eq!(refused.status, Some(2));
    assert!(refused.refusal().contains("which holds only 2D scenes"), "{refused:?}");
}

#[test]
fn a_2d_scene_is_judged_by_an_image() {
    let place = folder();
    let output = fitted(place.path(), "sum");
    let image = place.path().join("picture-48x32.png");
    let scene = output.join("scene.gs2d.safetensors");
    let by_scene = gs(["eval", text(&scene), text(&image), "--json", "--backend", "cpu"]).json();
    let by_picture = gs(["eval", text(&output.join("reconstruction.png")), text(&image), "--json"]).json();
    assert_eq!(by_scene, by_picture, "the figures are those of the picture as it is written");
    assert_eq!(gs(["eval", text(&output), text(&image), "--json", "--backend", "cpu"]).json(), by_scene);
    let other = picture(place.path(), 32, 48);
    let refused = gs(["eval", text(&scene), text(&other)]);
    assert!(refused.refusal().contains("48x32 px") && refused.refusal().contains("32x48 px"), "{refused:?}");
    let (dataset, _) = dataset_and_scene(place.path());
    let ply = place.path().join("a.ply");
    let refused = gs(["convert", text(&scene), text(&ply), "-n", "9", "--dataset", text(&dataset)]);
    assert!(refused.status == Some(2) && refused.refusal().contains("--gaussians is for 3D scenes"), "{refused:?}");
    let equal = gs(["eval", text(&image), text(&image)]).done().stdout;
    assert!(equal.contains("PSNR     inf dB (the images are equal)"), "{equal}");
    assert_eq!(gs(["eval", text(&image), text(&image), "--json"]).json()["psnr"], Value::Null);
    let refused = gs(["eval", text(&scene), text(&dataset)]);
    assert_eq!(refused.status, Some(2));
    assert!(refused.refusal().contains("gs eval SCENE IMAGE"), "{refused:?}");
}

#[test]
fn an_output_folder_stands_for_its_scene() {
    let place = folder();
    let output = fitted(place.path(), "sum");
    let scene = output.join("scene.gs2d.safetensors");
    let opened = format!("opened {}", text(&scene));
    let info = gs(["info", text(&output), "--json"]).done();
    assert!(info.stderr.contains(&opened), "{info:?}");
    assert_eq!(info.json(), gs(["info", text(&scene), "--json"]).json());
    let png = place.path().join("a.png");
    assert!(gs(["render", text(&output), "-o", text(&png)]).done().stderr.contains(&opened));
    assert!(read(&png) == read(&output.join("reconstruction.png")));
    assert!(gs(["doctor", text(&output)]).done().stdout.contains("2D scene"));
    let empty = place.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let looked_for = "holds no scene: looked for scene.gs2d.safetensors, scene.ply";
    for command in [&["render", "-o", text(&png)][..], &["doctor"], &["convert", "b.ply"], &["popping"]] {
        let run = gs([command[0], text(&empty)].into_iter().chain(command[1..].iter().copied()));
        assert!(run.refusal().contains(looked_for), "{run:?}");
    }
    assert!(gs(["info", text(&empty)]).refusal().contains("no data set"));
    assert!(names_in(&empty).is_empty());
}

#[test]
fn a_checkpoint_of_a_fit_is_a_scene() {
    let place = folder();
    let (image, output, state) = (picture(place.path(), 48, 32), place.path().join("fit"), place.path().join("state"));
    let flags = ["-n", "60", "-i", "20", "--no-report", "--backend", "cpu", "--checkpoint", text(&state)];
    gs(["fit", text(&image), "-o", text(&output)].into_iter().chain(flags).chain(["--checkpoint-every", "12"])).done();
    let info = gs(["info", text(&state), "--json"]).json();
    assert_eq!(
        (&info["picture"][0], &info["picture"][1], &info["render"]["effects"]["blend"]),
        (&48.into(), &32.into(), &"sum".into())
    );
    let png = place.path().join("a.png");
    gs(["render", text(&state), "-o", text(&png)]).done();
    assert_eq!(read(&png).size(), (48, 32));
    let psnr =
        |path: &Path| gs(["eval", text(path), text(&image), "--json", "--backend", "cpu"]).json()["psnr"].clone();
    let (early, late) = (psnr(&state).as_f64().unwrap(), psnr(&output).as_f64().unwrap());
    assert!(early > 15.0 && early < late, "{early} {late}");
}

#[test]
fn a_checkpoint_of_a_training_is_a_scene() {
    let place = folder();
    let (dataset, _) = dataset_and_scene(place.path());
    let (output, state) = (place.path().join("out"), place.path().join("state"));
    let storing = ["--checkpoint", text(&state), "--checkpoint-every", "25", "--background", "0.2,0.3,0.4"];
    gs(small(&dataset, &output).into_iter().chain(storing)).done();
    let ply = place.path().join("state.ply");
    let printed: Value = gs(["convert", text(&state), text(&ply), "--json"]).json();
    assert_eq!(printed["read"]["format"], "checkpoint");
    let at_25 = gs_io::read_3d(&ply).unwrap().scene;
    assert_eq!(printed["gaussians"], gs_core::Scene::len(&at_25));
    let psnr = |path: &Path, flags: &[&str]| {
        let words = ["eval", text(path), text(&dataset), "--json", "--backend", "cpu"];
        gs(words.iter().chain(flags)).json()["psnr"].as_f64().unwrap()
    };
    let early = psnr(&state, &[]);
    assert!((early - psnr(&ply, &["--background", "0.2,0.3,0.4"])).abs() < 1e-6, "it knows its background: {early}");
    assert!((early - psnr(&ply, &["--background", "white"])).abs() > 0.01);
    let png = place.path().join("a.png");
    gs(["render", text(&state), "-o", text(&png), "--size", "32x24"]).done();
    assert_eq!(read(&png).size(), (32, 24));
    // A folder without results still has its checkpoint.
    let stopped = place.path().join("stopped");
    fs::create_dir(&stopped).unwrap();
    fs::copy(&state, stopped.join("checkpoint.safetensors")).unwrap();
    let run = gs(["info", text(&stopped), "--json"]).done();
    assert!(run.stderr.contains("checkpoint.safetensors"), "{run:?}");
    assert_eq!(run.json()["kind"], "checkpoint of a training in 3D");
    // A training can start from it, too.
    let again = place.path().join("again");
    let run = gs(small(&dataset, &again).into_iter().chain(["--start", text(&stopped), "--no-report"])).done();
    assert!(run.stderr.contains("from the Gaussians of "), "{run:?}");
}
