//! Pictures of 3D scenes: from views, orbits and paths, before backgrounds and with alpha.

use std::{fs, path::Path};

use glam::{DVec2, DVec3, Vec3};
use gs_conformance::posed::small_scene;
use gs_core::{Gaussian3d, Image, Scene3d};
use gs_io::WorldFrame;
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

/// A scene of grey Gaussians on the ground, 80 m wide, and a red one that is 1 m above it, in this frame.
fn site(path: &Path, red: DVec3, frame: WorldFrame) {
    let gaussian = |world: DVec3, scale: f32, color: Vec3| Gaussian3d {
        mean: ((world - frame.origin) / frame.unit).as_vec3(),
        log_scale: Vec3::splat((f64::from(scale) / frame.unit).ln() as f32),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 6.0,
        sh: vec![color],
    };
    let ground = |i: u32| DVec3::new(512_300.0 + 10.0 * f64::from(i % 9), 5_412_300.0 + 10.0 * f64::from(i / 9), 0.0);
    let ground = (0..81).map(|i| gaussian(ground(i), 4.0, Vec3::splat(-1.0)));
    let scene: Scene3d = ground.chain([gaussian(red, 0.5, Vec3::new(1.7, -1.7, -1.7))]).collect();
    gs_io::write_3d(path, &scene, &gs_io::WriteOptions3d::default().with(|s| s.trained_with.frame = frame)).unwrap();
}

/// The mean place of the red pixels, px from the upper left corner.
fn middle_of_red(image: &Image) -> DVec2 {
    let weight = |x, y| f64::from((image.pixel(x, y)[0] - image.pixel(x, y)[1] - 0.3).max(0.0));
    let pixels = || (0..image.height()).flat_map(|y| (0..image.width()).map(move |x| (x, y)));
    let sum: f64 = pixels().map(|(x, y)| weight(x, y)).sum();
    let place = |x, y| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    pixels().map(|(x, y)| weight(x, y) * place(x, y)).sum::<DVec2>() / sum
}

#[test]
fn a_plan_has_its_place_on_the_map() {
    let place = folder();
    let at = |name: &str| place.path().join(name);
    let (scene, plan) = (at("site.ply"), at("plan.tif"));
    let red = DVec3::new(512_345.25, 5_412_345.5, 1.0);
    let frame = WorldFrame { origin: DVec3::new(512_000.0, 5_412_000.0, 300.0), unit: 100.0 };
    site(&scene, red, frame);
    let render = |output: &Path, flags: &[&str]| {
        let command = ["render", text(&scene), "-o", text(output), "--ortho", "200"];
        gs(command.iter().chain(flags))
    };
    for (picture, flags) in [("plan.tif", &["--size", "160x120"][..]), ("plan.png", &[]), ("below.tiff", &["--up=-z"])]
    {
        let (picture, run) = (at(picture), render(&at(picture), flags).done());
        let ending = if picture.extension().unwrap() == "png" { "pgw" } else { "tfw" };
        let world_file = picture.with_extension(ending);
        assert!(run.stderr.contains(&format!("and {}, ", world_file.display())), "{run:?}");
        assert!(run.stderr.contains(" px, 0.5 world units each: "), "{run:?}");
        let lines = fs::read_to_string(world_file).unwrap();
        let numbers: Vec<f64> = lines.lines().map(|line| line.parse().unwrap()).collect();
        let [column, row, center] = [0, 2, 4].map(|i| DVec2::new(numbers[i], numbers[i + 1]));
        assert!(column.x.abs() == 0.5 && row == DVec2::new(0.0, -0.5) && column.y == 0.0, "{numbers:?}");
        if flags.contains(&"--up=-z") {
            assert!(column.x == -0.5, "east is to the left from below");
            continue; // The ground hides what is above it.
        }
        let pixel = middle_of_red(&gs_io::read_image(&picture).unwrap().image) - 0.5;
        let found = center + pixel.x * column + pixel.y * row;
        assert!(column.x == 0.5 && found.distance(red.truncate()) < 0.05, "{found} and not {red}");
    }
    let run = render(&plan, &["--up", "x"]).done();
    assert!(run.stderr.contains("has no place on a map: only --up z"), "{run:?}");
    let image = render(&plan, &["--epsg", "25832", "--background", "none"]).done();
    assert!(image.stderr.contains("with alpha"), "{image:?}");
    assert!(gs_io::read_stored_image(&plan).unwrap().alpha.is_some());
    for (output, flags, part) in [
        (&plan, &["--epsg", "4326"][..], "must be a projected system"),
        (&plan, &["--epsg", "25832", "--up", "y"], "use --up z"),
        (&at("plan.png"), &["--epsg", "25832"], "only a TIFF names its coordinate system"),
    ] {
        assert!(render(output, flags).refusal().contains(part), "{part}");
    }
    let perspective = gs(["render", text(&scene), "-o", text(&plan)]);
    assert!(perspective.refusal().contains("in .tif with --ortho"), "{perspective:?}");
}

#[test]
fn a_plan_without_world_frame_is_a_plain_tiff() {
    let place = folder();
    let (scene, plan) = (place.path().join("site.ply"), place.path().join("plan.tif"));
    gs_io::write_3d(&scene, &small_scene(0), &gs_io::WriteOptions3d::default()).unwrap();
    let run = gs(["render", text(&scene), "-o", text(&plan), "--ortho", "20", "--size", "64x48"]).done();
    assert!(run.stderr.contains("px, 0.05 scene units each: "), "{run:?}");
    assert!(run.stderr.contains("has no place on a map: the scene has no world frame"), "{run:?}");
    assert_eq!(gs_io::read_image(&plan).unwrap().image.size(), (64, 48));
    assert_eq!(names_in(place.path()), ["plan.tif", "site.ply"]);
}
