//! Pictures of 3D scenes: from views, orbits and paths, before backgrounds and with alpha.

use std::{fs, path::Path};

use serde_json::json;

use crate::{
    process::{folder, gs, names_in},
    train::{dataset_and_scene, make_blender, text},
};

#[test]
fn a_scene_is_shown_from_views_orbits_and_paths() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let at = |name: &str| place.path().join(name);
    let size = |path: &Path| gs_io::read_image(path).unwrap().image.size();

    let view = format!("{}:images/3.png", text(&dataset));
    let picture = at("view.png");
    gs(["render", text(&scene), "-o", text(&picture), "--camera", &view]).done();
    let (rendered, image) = (gs_io::read_image(&picture).unwrap(), dataset.join("images/3.png"));
    let difference = gs_core::metrics::psnr(&rendered.image, &gs_io::read_image(image).unwrap().image).unwrap();
    assert!(difference > 50.0, "the true scene looks like its image: {difference} dB");
    let short = format!("{}:3", text(&dataset));
    gs(["render", text(&scene), "-o", text(&picture), "--camera", &short, "--size", "64x48"]).done();
    assert_eq!(size(&picture), (64, 48));

    let overview = at("overview.png");
    let flags = ["--size", "40x30", "--up", "z", "--background", "white", "--antialias", "mip"];
    let run = gs(["render", text(&scene), "-o", text(&overview)].into_iter().chain(flags)).done();
    assert!(run.stderr.contains("order global, antialias mip, SH degree 0, background white"), "{run:?}");
    let seen = gs_io::read_image(&overview).unwrap().image;
    assert!(seen.pixels().iter().any(|p| p[0] < 0.5) && seen.pixel(0, 0) == [1.0; 3], "something on white");

    let frames = at("frames");
    gs(["render", text(&scene), "-o", text(&frames), "--orbit", "3", "--camera", &view]).done();
    assert_eq!(names_in(&frames), ["frame-00000.png", "frame-00001.png", "frame-00002.png"]);
    // A shorter film removes the remaining frames of a longer one, unless frames of the user are
    // there.
    gs(["render", text(&scene), "-o", text(&frames), "--orbit", "2", "--size", "8x8"]).done();
    assert_eq!(names_in(&frames), ["frame-00000.png", "frame-00001.png"]);
    fs::write(frames.join("frame-00004.png"), "mine").unwrap();
    let shorter = gs(["render", text(&scene), "-o", text(&frames), "--orbit", "2"]);
    assert!(shorter.refusal().contains("frame-00004.png: is in the way"), "{shorter:?}");
    let animation = at("turn.apng");
    gs(["render", text(&scene), "-o", text(&animation), "--orbit", "4", "--size", "20x20"]).done();
    assert_eq!(size(&animation), (20, 20));
    let path = at("path.json");
    let keys = json!([{ "position": [0, -4, 0], "target": [0, 0, 0] }, { "position": [4, 0, 0], "target": [0, 0, 0] }]);
    let flight = json!({ "width": 16, "height": 12, "fov": 50, "up": [0, 0, 1], "frames": 2, "keys": keys });
    fs::write(&path, flight.to_string()).unwrap();
    let flown = at("flown");
    gs(["render", text(&scene), "-o", text(&flown), "--path", text(&path)]).done();
    let single = place.path().join("single");
    let run = gs(["render", text(&scene), "-o", text(&single), "--orbit", "1", "--size", "8x8"]).done();
    assert_eq!(names_in(&single), ["frame-00000.png"], "a film of one frame is a film");
    assert!(run.stderr.contains(", 1 frame of 8x8 px: "), "{run:?}");
    let picture = place.path().join("single.png");
    gs(["render", text(&scene), "-o", text(&picture), "--orbit", "1", "--size", "8x8"]).done();
    assert!(picture.is_file());
    assert_eq!(size(&flown.join("frame-00001.png")), (16, 12));
}

#[test]
fn plans_panoramas_and_depths_show_the_scene() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let picture = place.path().join("picture.png");
    let view = format!("{}:3", text(&dataset));
    let render = |flags: &[&str]| {
        let command = ["render", text(&scene), "-o", text(&picture), "--overwrite"];
        gs(command.iter().chain(flags)).done();
        gs_io::read_image(&picture).unwrap().image
    };
    let shown = |image: &gs_core::Image| image.pixels().iter().filter(|p| p.iter().any(|c| *c > 0.02)).count();

    let plan = render(&["--ortho", "20", "--size", "64x48"]);
    let closer = render(&["--ortho", "40", "--size", "64x48"]);
    assert_eq!((plan.size(), closer.size()), ((64, 48), (64, 48)));
    assert!(shown(&plan) > 0 && shown(&closer) > shown(&plan), "{} and {}", shown(&plan), shown(&closer));

    let all = render(&["--panorama", "--camera", &view, "--size", "200x100"]);
    assert!(all.size() == (200, 100) && shown(&all) > 0);

    let [fine, coarse] = ["--depth", "--depth=0.1"].map(|flag| render(&[flag, "--camera", &view]));
    let steps = |image: &gs_core::Image| image.pixels().iter().map(|p| (p[0] * 65535.0).round()).collect::<Vec<f32>>();
    let (fine, coarse) = (steps(&fine), steps(&coarse));
    assert!(fine.iter().any(|steps| *steps > 0.0));
    assert!(fine.iter().zip(&coarse).all(|(fine, coarse)| (fine / 100.0 - coarse).abs() <= 0.51));
    let refused = gs(["render", text(&scene), "-o", text(&picture), "--ortho", "20", "--depth"]);
    assert_eq!(refused.status, Some(2));
}

#[test]
fn an_object_without_surroundings_is_shown_before_white() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    make_blender(&dataset);
    let (picture, view) = (place.path().join("view.png"), format!("{}:3", text(&dataset)));
    let corner = |flags: &[&str]| {
        let words = ["render", text(&scene), "-o", text(&picture), "--camera", &view];
        gs(words.iter().chain(flags)).done();
        gs_io::read_image(&picture).unwrap().image.pixel(0, 0)
    };
    assert_eq!(corner(&[]), [1.0; 3]);
    assert_eq!(corner(&["--background", "black"]), [0.0; 3]);
}

#[test]
fn a_scene_without_background_has_alpha() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let (picture, frames) = (place.path().join("view.png"), place.path().join("frames"));
    let view = format!("{}:images/3.png", text(&dataset));
    let render = |output: &Path, background: &str, flags: &[&str]| {
        let words = ["render", text(&scene), "-o", text(output), "--background", background];
        gs(words.iter().chain(flags))
    };
    let run = render(&picture, "none", &["--camera", &view]).done();
    assert!(run.stderr.contains("SH degree 0, with alpha"), "{run:?}");
    let found = gs_io::read_stored_image(&picture).unwrap();
    let alpha = found.alpha.clone().unwrap();
    assert!(alpha[0] == 0.0 && alpha.iter().any(|&alpha| alpha > 0.9), "{alpha:?}");
    for (background, color) in [("white", [1.0; 3]), ("0.25,0.5,0.75", [0.25, 0.5, 0.75])] {
        render(&picture, background, &["--camera", &view]).done();
        let expected = gs_io::read_image(&picture).unwrap().image;
        let off = gs_core::metrics::psnr(&found.clone().on(color).unwrap().image, &expected).unwrap();
        assert!(off > 50.0, "{background}: {off} dB");
    }
    render(&frames, "none", &["--orbit", "2", "--size", "16x12"]).done();
    assert!(gs_io::read_stored_image(frames.join("frame-00001.png")).unwrap().alpha.is_some());
    let film = render(&place.path().join("turn.apng"), "none", &["--orbit", "2"]);
    assert!(film.refusal().contains("animated PNGs are written without alpha"), "{film:?}");
    let eval = gs(["eval", text(&scene), text(&dataset), "--background", "none"]);
    assert!(eval.refusal().contains("only gs render writes transparent pictures"), "{eval:?}");
}
