//! `gs convert` and `gs info` on 3D scenes of every format, and on broken ones.

use std::{
    fs,
    path::{Path, PathBuf},
};

use base64::{Engine, engine::general_purpose::STANDARD};
use glam::Vec3;
use gs_core::{Gaussian3d, Scene, Scene3d};
use gs_io::{WriteOptions3d, read_3d, write_3d};

use crate::{
    ply::break_ply,
    process::{Run, folder, gs, names_in},
    train::{dataset_and_scene, text},
};

/// Writes a PLY of ten Gaussians of degree 2 and returns its path.
pub(crate) fn ply(folder: &Path) -> PathBuf {
    let mut scene = Scene3d { sh_degree: 2, ..Scene3d::default() };
    for i in 0..10 {
        let t = i as f32;
        scene.push(Gaussian3d {
            mean: Vec3::new(t, -t, 0.5),
            log_scale: Vec3::new(-3.0, -2.0, -1.0),
            rotation: [1.0, 0.1 * t, 0.0, 0.0],
            opacity_logit: t - 5.0,
            sh: (0..9).map(|k| Vec3::splat(0.1 * k as f32)).collect(),
        });
    }
    let path = folder.join("scene.ply");
    write_3d(&path, &scene, &WriteOptions3d::default()).unwrap();
    path
}

fn convert(from: &Path, to: &Path, flags: &[&str]) -> Run {
    gs([Path::new("convert"), from, to].into_iter().chain(flags.iter().map(Path::new)))
}

#[test]
fn a_scene_goes_through_every_format() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let first = ply(place.path());
    let mut last = first.clone();
    for name in ["a.glb", "a.gltf", "a.spz", "b.ply"] {
        let json = convert(&last, &path(name), &["--json"]).json();
        assert_eq!((&json["gaussians"], &json["sh_degree"], &json["dropped"]), (&10.into(), &2.into(), &0.into()));
        let bytes = fs::metadata(path(name)).unwrap().len();
        assert_eq!(json["written"]["bytes"], bytes);
        assert_eq!(json["written"]["bytes_per_gaussian"], bytes as f64 / 10.0);
        last = path(name);
    }
    let (a, b) = (read_3d(&first).unwrap().scene, read_3d(&last).unwrap().scene);
    let far = a.means.iter().zip(&b.means).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max);
    assert!(far <= 0.5 / 4096.0, "{far}");

    let text = convert(&first, &path("a.splat"), &[]).done().stdout;
    for part in ["3DGS PLY", "32.0 a Gaussian", "above degree 0: 24 coefficients", "8 bits"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let same = convert(&first, &path("c.ply"), &[]).done().stdout;
    assert!(same.contains("lost        nothing"), "{same}");
    assert_eq!(fs::read(&first).unwrap(), fs::read(path("c.ply")).unwrap());
    let old = convert(&first, &path("old.spz"), &["--spz-version", "3"]).done();
    assert!(old.stdout.contains("SPZ") && fs::read(path("old.spz")).unwrap().starts_with(&[0x1f, 0x8b]));
}

#[test]
fn flags_of_a_reduction_need_its_number() {
    let place = folder();
    let (dataset, scene) = dataset_and_scene(place.path());
    let to = place.path().join("a.splat");
    for flags in [&["--dataset", text(&dataset)][..], &["--backend", "cpu"]] {
        let refused = convert(&scene, &to, flags);
        assert!(refused.status == Some(2) && refused.refusal().contains("--gaussians <N>"), "{refused:?}");
    }
    let refused = convert(&scene, &to, &["-n", "2", "--background", "white"]);
    assert!(refused.status == Some(2) && refused.refusal().contains("--dataset <DATASET>"), "{refused:?}");
    let nowhere = place.path().join("nowhere");
    let refused = convert(&scene, &to, &["-n", "2", "--dataset", text(&nowhere)]);
    assert!(refused.refusal().contains("no such file") && !to.exists(), "{refused:?}");
}

#[test]
fn how_a_scene_was_trained_goes_along() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let first = ply(place.path());
    let info = |name: &str| gs(["info", text(&path(name)), "--json"]).json();
    assert_eq!(info("scene.ply")["antialias"], serde_json::Value::Null);
    let picture = path("seen.png");
    let render = |name: &str, flags: &[&str]| {
        let scene = path(name);
        let words = ["render", text(&scene), "-o", text(&picture), "--size", "16x12", "--backend", "cpu"];
        gs(words.iter().chain(flags)).done().stderr
    };
    let guess = "does not say how the scene was antialiased in training";
    assert!(render("scene.ply", &[]).contains(guess));
    assert!(!render("scene.ply", &["--antialias", "dilate"]).contains(guess));

    // A flag says what the file does not; each further format keeps it.
    convert(&first, &path("a.ply"), &["--antialias", "compensated", "--order", "per-pixel"]).done();
    convert(&path("a.ply"), &path("a.glb"), &[]).done();
    let kept = info("a.glb");
    assert_eq!((&kept["antialias"], &kept["order"]), (&"compensated".into(), &"per-pixel".into()));
    let printed = render("a.glb", &["--effects", "all"]);
    assert!(printed.contains("order per-pixel, antialias compensated") && !printed.contains(guess), "{printed}");
    let lost = convert(&path("a.glb"), &path("a.spz"), &[]).done().stdout;
    assert!(
        lost.contains("lost        how the scene was trained, with antialias compensated, order per-pixel"),
        "{lost}"
    );
    assert_eq!(info("a.spz")["antialias"], "mip");
    let text = gs(["info", text(&path("a.ply"))]).done().stdout;
    assert!(text.contains("antialias           compensated in training"), "{text}");
}

#[test]
fn info_describes_a_3d_scene_of_any_format() {
    let place = folder();
    let first = ply(place.path());
    for name in ["a.ply", "a.splat", "a.spz", "a.gltf", "a.glb"] {
        let path = place.path().join(name);
        convert(&first, &path, &[]).done();
        let info = gs(["info", path.to_str().unwrap(), "--json"]).json();
        assert_eq!((&info["kind"], &info["gaussians"]), (&"3D scene".into(), &10.into()), "{info}");
        assert_eq!(info["bytes"], fs::metadata(&path).unwrap().len());
        assert_eq!(info["sh_degree"], if name == "a.splat" { 0 } else { 2 });
        let quantiles = &info["quantiles"];
        assert_eq!((&quantiles["y"]["min"], &quantiles["x"]["max"]), (&(-9.0).into(), &9.0.into()), "{info}");
        let scale = info["quantiles"]["largest scale"]["median"].as_f64().unwrap();
        assert!((scale - (-1.0_f64).exp()).abs() < 0.01, "{info}");
    }
    let text = gs(["info", first.to_str().unwrap()]).done().stdout;
    assert!(text.contains("3D scene, 3DGS PLY") && text.contains("SH degree           2"), "{text}");
}

#[test]
fn broken_gaussians_are_named_counted_and_dropped_on_request() {
    let place = folder();
    let first = ply(place.path());
    break_ply(&first, 3, 8, &[f32::NAN]);
    break_ply(&first, 7, 4, &[0.0; 4]);
    let to = place.path().join("a.spz");
    let refused = convert(&first, &to, &[]);
    assert_eq!(refused.status, Some(1));
    let line = refused.refusal();
    assert!(line.contains("opacity logit of Gaussian 3 is not finite") && line.contains("gs doctor"), "{line}");
    assert!(!to.exists());
    let text = convert(&first, &to, &["--drop-broken"]).done().stdout;
    assert!(text.contains("dropped     2 Gaussians") && text.contains("Gaussians   8"), "{text}");
    assert_eq!(read_3d(&to).unwrap().scene.len(), 8);
    break_ply(&first, 5, 0, &[1e30]);
    let text = convert(&first, &to, &["--drop-broken"]).done().stdout;
    assert!(text.contains("dropped     1 Gaussian that the format cannot hold\n"), "{text}");
    assert_eq!(read_3d(&to).unwrap().scene.len(), 7);
}

#[test]
fn scales_of_zero_are_raised_and_reported() {
    let place = folder();
    let (first, to) = (ply(place.path()), place.path().join("b.ply"));
    break_ply(&first, 3, 7, &[f32::NEG_INFINITY]);
    for flags in [&["--json"][..], &["--json", "--drop-broken"]] {
        let json = convert(&first, &to, flags).json();
        assert_eq!((&json["gaussians"], &json["dropped"]), (&10.into(), &0.into()), "{json}");
        let lost = "scales of 0 are raised to the smallest number above it: 1 Gaussian";
        assert_eq!(json["lost"], serde_json::json!([lost]), "{flags:?}");
        assert!(read_3d(&to).unwrap().losses.is_empty());
    }
}

#[test]
fn impossible_conversions_are_refused() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let first = ply(place.path());
    fs::write(path("short.ply"), &fs::read(&first).unwrap()[..2000]).unwrap();
    let before = names_in(place.path());
    for (from, to, status, expected) in [
        (&first, "a.obj", 2, "use .ply, .spz, .sog, .rad, .glb, .gltf or .splat"),
        (&first, "no/such/a.ply", 1, "no folder"),
        (&path("absent.ply"), "a.spz", 1, "no such file"),
        (&path("short.ply"), "a.spz", 1, "10 rows of element vertex"),
    ] {
        let run = convert(from, &path(to), &[]);
        assert_eq!(run.status, Some(status), "{run:?}");
        assert!(run.refusal().contains(expected), "{run:?}");
    }
    let broken = gs(["info", path("short.ply").to_str().unwrap()]);
    assert!(broken.refusal().contains("10 rows of element vertex"), "{broken:?}");
    assert_eq!(names_in(place.path()), before);
}

#[test]
fn the_buffer_that_a_gltf_is_read_from_is_not_replaced() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    convert(&ply(place.path()), &path("a.gltf"), &[]).done();
    let mut json: serde_json::Value = serde_json::from_slice(&fs::read(path("a.gltf")).unwrap()).unwrap();
    let uri = json["buffers"][0]["uri"].as_str().unwrap();
    let numbers = STANDARD.decode(uri.strip_prefix("data:application/octet-stream;base64,").unwrap()).unwrap();
    json["buffers"][0]["uri"] = "other.sog".into();
    fs::write(path("other.sog"), &numbers).unwrap();
    fs::write(path("b.gltf"), json.to_string()).unwrap();
    let run = convert(&path("b.gltf"), &path("other.sog"), &[]);
    assert!(run.refusal().contains("other.sog") && run.refusal().contains("is an input of this run"), "{run:?}");
    assert_eq!(fs::read(path("other.sog")).unwrap(), numbers);
}

#[test]
fn a_sog_is_written_in_one_file_or_in_a_folder() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let first = ply(place.path());
    fs::create_dir(path("folder")).unwrap();
    for to in [path("a.sog"), path("folder/meta.json")] {
        let json = convert(&first, &to, &["--json"]).json();
        assert_eq!(
            json["written"]["bytes"].as_u64(),
            gs(["info", "--json", to.to_str().unwrap()]).json()["bytes"].as_u64()
        );
    }
    let names = names_in(&path("folder"));
    assert!(names.contains(&"shN_labels.webp".to_owned()) && names.len() == 8, "{names:?}");
    // The images that a scene is read from are not replaced.
    let run = convert(&path("folder/meta.json"), &path("folder/META.json"), &[]);
    assert!(run.refusal().contains("is an input of this run"), "{run:?}");
}

#[test]
fn streamed_sog_and_rad_have_levels_of_detail() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let (first, city) = (ply(place.path()), path("city/lod-meta.json"));
    let json = convert(&first, &city, &["--json"]).json();
    assert_eq!((&json["gaussians"], &json["written"]["format"]), (&10.into(), &"streamed SOG".into()));
    for scene in [&city, &path("city")] {
        let info = gs(["info", "--json", text(scene)]).json();
        assert_eq!((&info["gaussians"], &info["levels"]), (&10.into(), &serde_json::json!([10, 5, 2, 1])));
    }
    assert_eq!(convert(&city, &path("back.ply"), &["--json"]).json()["gaussians"], 10);

    let picture = path("view.png");
    let render = |scene: &Path, flags: &[&str]| {
        gs(["render", text(scene), "-o", text(&picture), "--size", "60x40"].iter().chain(flags))
    };
    let run = render(&path("city"), &["--max-gaussians", "6"]).done();
    assert!(run.stderr.contains("drawing 5 Gaussians in place of 10, with an error of up to "), "{run:?}");
    let run = render(&city, &["--max-gaussians", "1000", "--orbit", "1"]).done();
    assert!(run.stderr.contains(" Gaussians in place of 10"), "{run:?}");
    assert_eq!(render(&city, &["--max-gaussians", "0"]).status, Some(2));
    let run = render(&first, &["--max-gaussians", "6"]);
    assert!(
        run.status == Some(2) && run.refusal().contains("is for levels of detail, and this scene has none"),
        "{run:?}"
    );

    let rad = path("city.rad");
    convert(&first, &rad, &[]).done();
    let info = gs(["info", "--json", text(&rad)]).json();
    let levels: Vec<u64> = info["levels"].as_array().unwrap().iter().filter_map(|count| count.as_u64()).collect();
    assert!(levels.len() > 2 && levels[0] == 10 && levels.ends_with(&[1]), "{info}");
    let run = render(&rad, &["--max-gaussians", "6"]).done();
    assert!(run.stderr.contains(&format!("drawing {} Gaussians in place of 10", levels[1])), "{run:?}");

    // What the scene is read from and what others wrote is not replaced.
    let run = convert(&path("city/0_0/meta.json"), &city, &[]);
    assert!(run.refusal().contains("is an input of this run"), "{run:?}");
    fs::create_dir(path("other")).unwrap();
    fs::write(path("other/lod-meta.json"), "mine").unwrap();
    let run = convert(&first, &path("other/lod-meta.json"), &[]);
    assert!(run.refusal().contains("is in the way") && run.refusal().contains("another folder"), "{run:?}");
    assert_eq!(names_in(&path("other")), ["lod-meta.json"]);
}

#[test]
fn tiles_are_written_with_their_place_on_the_globe() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let (first, tiles) = (ply(place.path()), path("globe/tileset.json"));
    // The frame of a data set in UTM.
    let (mut bytes, frame) = (fs::read(&first).unwrap(), "comment gs frame: origin 691600 5334760 520 unit 10\n");
    let end = bytes.windows(8).position(|at| at == b"element ").unwrap();
    bytes.splice(end..end, frame.bytes());
    fs::write(&first, bytes).unwrap();
    let json = convert(&first, &tiles, &["--json", "--epsg", "32632"]).json();
    assert_eq!((&json["gaussians"], &json["written"]["format"]), (&10.into(), &"3D Tiles".into()));
    let tileset = || serde_json::from_slice::<serde_json::Value>(&fs::read(&tiles).unwrap()).unwrap();
    assert_eq!(tileset()["root"]["transform"].as_array().unwrap().len(), 16);
    assert_eq!(gs(["info", "--json", text(&path("globe/0_0.glb"))]).json()["gaussians"], 10);
    assert!(!json["lost"].to_string().contains("in the world"), "{json}");
    let lost = convert(&first, &tiles, &[]).done().stdout;
    assert!(lost.contains("lost        where the scene is in the world: 1 unit is 10 of"), "{lost}");
    assert!(tileset()["root"]["transform"].is_null(), "the tiles that gs wrote are replaced");

    for scene in [&tiles, &path("globe")] {
        let run = convert(scene, &path("back.ply"), &[]);
        assert!(run.status == Some(1) && run.refusal().contains("3D Tiles are only written"), "{run:?}");
    }
    for (to, code, expected) in [("a.ply", "32632", "only 3D Tiles"), ("new/tileset.json", "2056", "EPSG:2056")] {
        let run = convert(&first, &path(to), &["--epsg", code]);
        assert!(run.refusal().contains(expected) && !path(to).exists(), "{run:?}");
    }
    // What the scene is read from and what others wrote is not replaced.
    let run = convert(&path("globe/0_0.glb"), &tiles, &[]);
    assert!(run.refusal().contains("is an input of this run"), "{run:?}");
    fs::create_dir(path("other")).unwrap();
    fs::write(path("other/tileset.json"), "mine").unwrap();
    let run = convert(&first, &path("other/tileset.json"), &[]);
    assert!(run.refusal().contains("is in the way") && run.refusal().contains("another folder"), "{run:?}");
    assert_eq!(names_in(&path("other")), ["tileset.json"]);
}

#[test]
fn a_scene_is_reduced_and_the_cost_is_printed() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let first = ply(place.path());
    let flags = ["--gaussians", "6", "--backend", "cpu", "--threads", "1", "--json"];
    let json = convert(&first, &path("a.ply"), &flags).json();
    let reduction = &json["reduction"];
    assert_eq!((&json["gaussians"], &reduction["from"], &reduction["to"]), (&6.into(), &10.into(), &6.into()));
    assert_eq!(reduction["merged"].as_u64().unwrap() + reduction["removed"].as_u64().unwrap(), 4);
    assert!(reduction["psnr_against_before"].as_f64().unwrap() > 15.0, "{reduction}");
    let text = convert(&first, &path("b.ply"), &flags[..6]).done().stdout;
    assert!(text.contains("reduced     10 to 6 Gaussians: ") && text.contains("mean over 16 cameras"), "{text}");
    let none = convert(&first, &path("c.ply"), &["--gaussians", "0"]);
    assert_eq!(none.status, Some(2));
    assert_eq!(convert(&first, &path("c.ply"), &["--threads", "1"]).status, Some(2));
}
