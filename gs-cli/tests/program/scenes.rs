//! `gs render`, `gs eval` and `gs info` on scenes that a fit has made, and on broken ones.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::process::{folder, gs, names_in, picture};

/// Fits a small picture and returns the picture and the scene.
fn fitted(place: &Path) -> (PathBuf, PathBuf) {
    let image = picture(place, 32, 24);
    let output = place.join("fit");
    let flags = ["-n", "40", "--iterations", "15", "--no-report"];
    gs(["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap()].into_iter().chain(flags)).done();
    (image, output.join("scene.gs2d.safetensors"))
}

#[test]
fn a_scene_is_rendered_at_any_size_and_in_parts() {
    let place = folder();
    let (_, scene) = fitted(place.path());
    let (scene, png) = (scene.to_str().unwrap(), place.path().join("a.png"));
    let render = |flags: &[&str]| {
        gs(["render", scene, "-o", png.to_str().unwrap()].iter().chain(flags)).done();
        gs_io::read_image(&png).unwrap().image
    };
    let natural = render(&[]);
    assert!(natural == gs_io::read_image(place.path().join("fit/reconstruction.png")).unwrap().image);
    assert_eq!(render(&["--size", "64x48"]).size(), (64, 48));
    let part = render(&["--region", "8,4,10,6"]);
    assert_eq!(part.size(), (10, 6));
    let differs =
        |x: u32, y: u32| part.pixel(x, y).iter().zip(natural.pixel(x + 8, y + 4)).any(|(a, b)| (a - b).abs() > 0.01);
    assert!(!(0..10).any(|x| (0..6).any(|y| differs(x, y))), "a part looks as it does in the whole");
    assert_eq!(render(&["--region", "-4,-4,8,8", "--size", "20x10"]).size(), (20, 10));
}

#[test]
fn impossible_renders_are_refused() {
    let place = folder();
    let (_, scene) = fitted(place.path());
    let scene = scene.to_str().unwrap();
    let png = place.path().join("a.png");
    for (flags, expected) in [(["--size", "20000x20000"], "20000x20000"), (["--region", "0,0,1e30,1"], "not possible")]
    {
        let run = gs(["render", scene, "-o", png.to_str().unwrap()].iter().chain(&flags));
        assert_eq!(run.status, Some(2), "{run:?}");
        assert!(run.refusal().contains(expected), "{flags:?}: {run:?}");
    }
    let nowhere = gs(["render", scene, "-o", place.path().join("no/such/a.png").to_str().unwrap()]);
    assert!(nowhere.refusal().contains("no folder"), "{nowhere:?}");
    assert!(!png.exists());
}

#[test]
fn broken_scenes_are_refused_by_every_command_that_reads_them() {
    let place = folder();
    let (image, scene) = fitted(place.path());
    let good = fs::read(&scene).unwrap();
    let broken = place.path().join("broken");
    let mut with_nan = good.clone();
    let end = with_nan.len();
    with_nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    let cases: [(&[u8], &str); 2] = [(&good[..good.len() / 2], "broken"), (&with_nan, "NaN")];
    let png = place.path().join("a.png");
    for (bytes, expected) in cases {
        fs::write(&broken, bytes).unwrap();
        let path = broken.to_str().unwrap();
        for run in [gs(["render", path, "-o", png.to_str().unwrap()]), gs(["info", path]), gs(["info", path, "--json"])]
        {
            assert_eq!(run.status, Some(1), "{run:?}");
            assert!(run.refusal().contains(expected), "{run:?}");
        }
        let resume = gs(["fit", image.to_str().unwrap(), "--resume", path, "-o", png.to_str().unwrap()]);
        assert!(resume.refusal().contains("broken"), "{resume:?}");
    }
    assert!(!png.exists());
    assert_eq!(names_in(place.path()), ["broken", "fit", "picture-32x24.png"]);
}

#[test]
fn images_are_compared() {
    let place = folder();
    let image = picture(place.path(), 192, 180);
    let (path, other) = (image.to_str().unwrap(), place.path().join("other.png"));
    let mut brighter = gs_io::read_image(&image).unwrap().image;
    brighter.pixels_mut().iter_mut().for_each(|pixel| pixel[0] = (pixel[0] + 0.1).min(1.0));
    gs_io::write_png(&other, &brighter).unwrap();

    let equal = gs(["eval", path, path, "--json"]).json();
    assert_eq!((&equal["l1"], &equal["ms_ssim"], &equal["psnr"]), (&0.0.into(), &1.0.into(), &serde_json::Value::Null));
    let differing = gs(["eval", path, other.to_str().unwrap(), "--json"]).json();
    assert!((differing["l1"].as_f64().unwrap() - 0.1 / 3.0).abs() < 2e-3, "{differing}");
    assert!((differing["psnr"].as_f64().unwrap() - 24.77).abs() < 0.2, "{differing}");
    assert!(differing["ms_ssim"].as_f64().is_some_and(|value| value < 1.0), "{differing}");
    let text = gs(["eval", path, other.to_str().unwrap()]).done().stdout;
    assert!(text.contains("PSNR") && text.contains("MS-SSIM"), "{text}");

    let smaller = picture(place.path(), 32, 24);
    let refused = gs(["eval", path, smaller.to_str().unwrap()]);
    assert!(refused.refusal().contains("192x180") && refused.refusal().contains("32x24"), "{refused:?}");
}

#[test]
fn info_describes_a_2d_scene() {
    let place = folder();
    let (_, scene) = fitted(place.path());
    let path = scene.to_str().unwrap();
    let info = gs(["info", path, "--json"]).json();
    assert_eq!((&info["kind"], &info["gaussians"]), (&"2D scene".into(), &40.into()));
    assert_eq!(&info["picture"], &serde_json::json!([32, 24]));
    assert_eq!(info["bytes"], fs::metadata(&scene).unwrap().len());
    assert!(info["quantiles"]["larger scale (px)"]["max"].as_f64().unwrap() > 0.2, "{info}");
    let text = gs(["info", path]).done().stdout;
    assert!(text.contains("32x24 px") && text.contains("sum"), "{text}");
}
