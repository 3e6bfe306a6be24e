//! `gs effects` and the flag `--effects`: decisions, their verification, and what is printed.

use glam::Vec3;
use gs_core::{Scene, Scene3d};
use gs_io::{WriteOptions3d, write_3d};
use gs_lab::price::popping::discs;

use crate::{
    process::{folder, gs, picture},
    train::{dataset_and_scene, text},
};

/// Two discs, one through the other, with SH that change no pixel visibly.
fn faintly_shiny() -> Scene3d {
    let mut scene = Scene3d { sh_degree: 2, ..Scene3d::default() };
    let plain = discs();
    (0..plain.len()).for_each(|index| scene.push(plain.gaussian(index).with_degree(2)));
    for coefficients in scene.sh.chunks_exact_mut(9) {
        coefficients[1..].fill(Vec3::splat(1e-4));
    }
    scene
}

#[test]
fn required_effects_of_a_3d_scene_are_reported() {
    let place = folder();
    let path = place.path().join("discs.ply");
    write_3d(&path, &faintly_shiny(), &WriteOptions3d::default()).unwrap();
    let scene = path.to_str().unwrap();
    let flags = ["--size", "48x40", "--views", "3", "--repetitions", "2", "--backend", "cpu"];
    let run = |more: &[&str]| gs(["effects", scene].iter().chain(&flags).chain(more));
    let report = run(&["--json", "--order", "per-pixel"]).json();
    let effects = &report["proof"]["required"]["settings"]["effects"];
    assert_eq!((effects["order"].as_str(), effects["sh-degree"].as_u64()), (Some("per-pixel"), Some(0)));
    assert_eq!((effects["background"].as_str(), effects["antialias"].as_str()), (Some("none"), Some("dilate")));
    let most = report["proof"]["difference"]["most"].as_f64().unwrap();
    assert!(most > 0.0 && most < 1.0 / 512.0, "{most}");
    assert_eq!(report["proof"]["views"].as_u64(), Some(3));
    let order = &report["prices"]["each"][0];
    assert_eq!((order["effect"].as_str(), order["cheaper"].as_str()), (Some("order"), Some("global")));
    assert!(order["change"]["most"].as_f64().unwrap() > 0.1, "the discs pop: {order}");

    let text = run(&[]).done().stdout;
    assert!(text.contains("2 Gaussians, seen from 3 cameras around it, 48x40 px"), "{text}");
    assert!(text.contains("higher coefficients change no pixel by more than 0.00"), "{text}");
    assert!(text.contains("verified in 3 views: no pixel differs by more than 0.000"), "{text}");
}

#[test]
fn a_picture_is_rendered_with_the_required_effects_unless_the_flag_says_otherwise() {
    let place = folder();
    let path = place.path().join("discs.ply");
    write_3d(&path, &faintly_shiny(), &WriteOptions3d::default()).unwrap();
    let render = |flags: &[&str]| {
        let png = place.path().join("picture.png");
        let words = ["render", path.to_str().unwrap(), "-o", png.to_str().unwrap(), "--size", "48x40"];
        let run = gs(words.iter().chain(&["--backend", "cpu", "--verbose"]).chain(flags)).done();
        (gs_io::read_image(&png).unwrap().image, run.stderr)
    };
    let (auto, printed) = render(&[]);
    assert!(printed.contains("without sh-degree 2 (higher coefficients change no pixel by more than"), "{printed}");
    let (all, printed) = render(&["--effects", "all"]);
    assert!(printed.contains("sh-degree 2 (--effects all)"), "{printed}");
    let steps = auto.pixels().as_flattened().iter().zip(all.pixels().as_flattened());
    let most = steps.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(most <= 1.0 / 255.0 + 1e-6, "at most one step of an eight-bit picture: {most}");
    let (unordered, printed) = render(&["--effects", "sh-degree,antialias"]);
    assert!(printed.contains("without order global (not in --effects)"), "{printed}");
    assert!(unordered != auto);
    let refused = gs(["render", path.to_str().unwrap(), "-o", "a.png", "--effects", "order,glitter"]);
    assert!(refused.refusal().contains("order, sh-degree, antialias and background"), "{refused:?}");
}

#[test]
fn images_are_fitted_first_and_their_scenes_taken_as_they_are() {
    let place = folder();
    let image = picture(place.path(), 32, 24);
    let image = image.to_str().unwrap();
    let flags = ["--repetitions", "1", "--backend", "cpu", "--json"];
    let report = gs(["effects", image].iter().chain(&flags)).json();
    assert_eq!(report["proof"]["difference"]["most"].as_f64(), Some(0.0), "bit-identical");
    assert!(report["seen"].as_str().unwrap().contains("after 100 steps"), "{report}");
    let output = place.path().join("fit");
    let fit = ["fit", image, "-n", "40", "-i", "15", "--no-report", "--blend", "over", "--json", "-o"];
    let summary = gs(fit.iter().chain(&[output.to_str().unwrap()])).json();
    let verdicts = summary["effects"].as_array().unwrap();
    assert_eq!((verdicts.len(), verdicts[1]["answer"].as_str()), (5, Some("required")));
    let scene = output.join("scene.gs2d.safetensors");
    let report = gs(["effects", scene.to_str().unwrap(), "--size", "9x7"].iter().chain(&flags)).json();
    assert_eq!((report["width"].as_u64(), report["proof"]["views"].as_u64()), (Some(9), Some(1)));
}

#[test]
fn what_does_not_go_together_is_refused() {
    let place = folder();
    let image = picture(place.path(), 16, 12);
    for (flags, part) in [
        (vec!["--order", "global"], "is not a 3D scene"),
        (vec!["dataset"], "is not a 3D scene"),
        (vec!["--size", "99999x9"], "--size"),
        (vec!["--views", "0"], "--views"),
    ] {
        let run = gs(["effects", image.to_str().unwrap()].iter().chain(&flags));
        assert_eq!(run.status, Some(2), "{flags:?}: {run:?}");
        assert!(run.refusal().contains(part), "{flags:?}: {run:?}");
    }
    let nothing = gs(["effects", place.path().join("none.ply").to_str().unwrap()]);
    assert_eq!(nothing.status, Some(1), "{nothing:?}");
}

#[test]
fn corrections_of_a_training_are_priced_on_request() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let flags = ["--train", "12", "--size", "32x24", "--views", "2", "--repetitions", "1", "--backend", "cpu"];
    let run = |more: &[&str]| gs(["effects", text(&scene), text(&dataset)].iter().chain(&flags).chain(more));
    let report = run(&["--json"]).json();
    let [price] = &report["training"]["prices"].as_array().unwrap()[..] else { panic!("{report}") };
    assert_eq!((price["effect"].as_str(), report["training"]["steps"].as_u64()), (Some("exposure"), Some(12)));
    for side in ["with", "without"] {
        let outcome = &price[side];
        let numbers = ["milliseconds", "psnr", "color-matched"].map(|name| outcome[name].as_f64().unwrap());
        assert!(numbers.iter().all(|number| *number > 0.0), "{outcome}");
    }
    let printed = run(&[]).done().stdout;
    assert!(printed.contains("training of 12 steps") && printed.contains("\nexposure "), "{printed}");
    let refused = gs(["effects", text(&scene), "--train", "12"]);
    assert_eq!(refused.status, Some(2), "without a data set: {refused:?}");
}
