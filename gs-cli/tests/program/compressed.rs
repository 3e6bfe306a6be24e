//! `.gsi` files: truncated ones, alpha and profiles.

use std::{fs, path::Path};

use gs_core::{Image, metrics};
use gs_io::{IccProfile, PngExtras, StoredImage, read_stored_image, write_png_with};

use crate::process::{folder, gs, picture};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn read(path: &Path) -> Image {
    gs_io::read_image(path).unwrap().image
}

#[test]
fn a_truncated_gsi_file_is_refused_or_shown_as_far_as_it_goes() {
    let place = folder();
    let (image, file, cut) = (picture(place.path(), 64, 48), place.path().join("a.gsi"), place.path().join("cut.gsi"));
    let flags = ["--bytes", "900", "--progressive", "--backend", "cpu"];
    gs(["encode", text(&image), "-o", text(&file)].into_iter().chain(flags)).done();
    let bytes = fs::read(&file).unwrap();
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let png = place.path().join("cut.png");
    let decode = ["decode", text(&cut), "-o", text(&png), "--backend", "cpu"];
    let refused = gs(decode);
    assert!(refused.refusal().contains("--partial") && !png.exists(), "{}", refused.stderr);
    let shown = gs(decode.into_iter().chain(["--partial"])).done();
    assert!(shown.stderr.contains("truncated") && shown.stderr.contains("1 of 2 layers"), "{}", shown.stderr);
    let psnr = metrics::psnr(&read(&png), &read(&image)).unwrap();
    assert!(psnr > 20.0, "{psnr} dB");
    let other = gs(["decode", text(&image), "-o", text(&png), "--partial"]);
    assert!(other.refusal().contains("not a .gsi file"), "{}", other.stderr);
}

/// A picture that is transparent on its left, in Display P3.
fn transparent(path: &Path) -> StoredImage {
    let image = read(&picture(path.parent().unwrap(), 64, 48));
    let alpha: Vec<f32> = (0..64 * 48).map(|k| ((k % 64) as f32 / 40.0).min(1.0)).collect();
    let profile = IccProfile::new(&moxcms::ColorProfile::new_display_p3().encode().unwrap()).unwrap();
    write_png_with(path, &image, PngExtras { alpha: Some(&alpha), profile: Some(&profile) }).unwrap();
    read_stored_image(path).unwrap()
}

#[test]
fn alpha_and_a_profile_come_back() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let (source, file, png) = (path("a.png"), path("a.gsi"), path("b.png"));
    let original = transparent(&source);
    let cpu = ["--backend", "cpu"];
    let encode = ["encode", text(&source), "-o", text(&file), "--json"];
    let made = gs(encode.iter().chain(&["--bytes", "2600", "--preview"]).chain(&cpu)).json();
    assert_eq!((&made["alpha"], &made["profile"]), (&true.into(), &"Display P3".into()), "{made}");
    assert_eq!(made["tune"], "psnr");
    assert!(fs::metadata(&file).unwrap().len() <= 2600);

    let decode = ["decode", text(&file), "-o", text(&png)];
    gs(decode.iter().chain(&cpu)).done();
    let back = read_stored_image(&png).unwrap();
    assert_eq!(back.profile, original.profile);
    let (psnr, alpha) =
        (metrics::psnr(&back.shown().unwrap(), &original.shown().unwrap()).unwrap(), back.alpha.unwrap());
    assert!(psnr > 26.0 && alpha[64] < 0.1 && alpha[120] > 0.9, "{psnr} dB, {} {}", alpha[64], alpha[120]);
    // It is as good as its PNG, and other commands see it on white.
    let seen = |file: &Path| {
        let run = gs(["eval", text(file), text(&source), "--json"].iter().chain(&cpu));
        run.json()["psnr"].as_f64().unwrap()
    };
    assert!((seen(&file) - psnr).abs() < 0.01 && (seen(&png) - psnr).abs() < 0.01, "{} {psnr} dB", seen(&file));
    let info = gs(["info", text(&file)]).done().stdout;
    assert!(info.contains("\nalpha ") && info.contains("Display P3, "), "{info}");

    gs(decode.iter().chain(&cpu).chain(&["--region", "0,0,32,24", "--size", "16x12"])).done();
    let part = read_stored_image(&png).unwrap();
    assert!(part.image.size() == (16, 12) && part.alpha.unwrap().iter().all(|alpha| *alpha < 0.9));

    // The beginning shows both, and a colour behind leaves no alpha.
    fs::write(&file, &fs::read(&file).unwrap()[..890]).unwrap();
    let shown = gs(decode.iter().chain(&cpu).chain(&["--partial"])).done();
    assert!(shown.stderr.contains("3 of 4 layers"), "{}", shown.stderr);
    assert!(read_stored_image(&png).unwrap().alpha.is_some());
    let made = gs(encode.iter().chain(&["--quality", "5", "--background", "black"]).chain(&cpu)).json();
    assert_eq!(made["alpha"], false, "{made}");
}
