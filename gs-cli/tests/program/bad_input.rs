//! Bad files and flags: every failure prints one line that says what is wrong, exits with status 1
//! or 2, and leaves nothing behind.

use std::{fs, path::Path};

use crate::process::{command, folder, gs, names_in, picture};

/// A PNG of this size by its header, with right checksums but hardly any pixels: what a decoder
/// believes before it looks.
pub(crate) fn png_without_pixels(width: u32, height: u32) -> Vec<u8> {
    let mut header = Vec::new();
    header.extend(width.to_be_bytes());
    header.extend(height.to_be_bytes());
    header.extend([8, 2, 0, 0, 0]); // 8 bits, RGB, the only methods there are, not interlaced
    let nothing_deflated = [0x78, 0x9c, 0x03, 0x00, 0x00, 0x00, 0x00, 0x01];
    let chunks = [chunk(b"IHDR", &header), chunk(b"IDAT", &nothing_deflated), chunk(b"IEND", &[])];
    [b"\x89PNG\r\n\x1a\n".as_slice(), &chunks.concat()].concat()
}

/// A chunk of a PNG.
pub(crate) fn chunk(name: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let named = [name, data].concat();
    [&(data.len() as u32).to_be_bytes(), named.as_slice(), &crc32(&named).to_be_bytes()].concat()
}

/// The checksum of PNG (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), step))
}

/// Runs a fit that must be refused with a line that holds `expected`, and must leave no folder
/// behind.
#[track_caller]
fn refuse_fit(image: &Path, expected: &str) {
    let place = folder();
    let output = place.path().join("out");
    let run = gs([Path::new("fit"), image, Path::new("-o"), &output]);
    let line = run.refusal();
    assert!(line.contains(expected) && line.contains(image.to_str().unwrap()), "{line}");
    assert!(!output.exists(), "{:?}", names_in(&output));
}

#[test]
fn images_that_are_none() {
    let place = folder();
    let path = |name: &str| place.path().join(name);
    let good = fs::read(picture(place.path(), 32, 32)).unwrap();
    fs::write(path("text.png"), "This is not a picture.\n").unwrap();
    fs::write(path("empty.png"), "").unwrap();
    fs::write(path("short.png"), &good[..good.len() / 2]).unwrap();
    fs::write(path("none.png"), png_without_pixels(0, 0)).unwrap();
    fs::write(path("bomb.png"), png_without_pixels(20_000, 20_000)).unwrap();

    refuse_fit(&path("absent.png"), "no such file");
    let none = folder();
    refuse_fit(none.path(), "image");
    refuse_fit(&path("text.png"), "is text, not an image");
    refuse_fit(&path("empty.png"), "is empty");
    refuse_fit(&path("short.png"), "damaged");
    for part in ["none.png: ", "damaged PNG image: ", "Invalid image dimensions", "; fetch or export it again"] {
        refuse_fit(&path("none.png"), part);
    }
    refuse_fit(&path("bomb.png"), "20000x20000");
}

#[test]
fn flags_that_ask_for_what_cannot_be() {
    let place = folder();
    let image = picture(place.path(), 16, 16);
    let output = place.path().join("out");
    let cases: [(&[&str], &str); 16] = [
        (&["--gaussians", "0"], "--gaussians"),
        (&["--gaussians", "-3"], "-3"),
        (&["--gaussians", "1e9"], "1e9"),
        (&["--policy", "frobnicate"], "possible values: absolute"),
        (&["--init", "nowhere"], "possible values: random"),
        (&["--loss", "l3"], "possible values: l2"),
        (&["--blend", "under"], "possible values: sum"),
        (&["--preset", "worst"], "possible values: paper"),
        (&["--threads", "0"], "--threads"),
        (&["--threads", "4000000000"], "--threads"),
        (&["--simd", "mmx"], "mmx"),
        (&["--background", "1,2,3"], "from 0 to 1"),
        (&["--seed", "minus one"], "minus one"),
        (&["--frobnicate"], "--frobnicate"),
        (&["--settings", "/no/such/file.toml"], "/no/such/file.toml"),
        (&["--resume", "/no/such/checkpoint"], "/no/such/checkpoint"),
    ];
    for (flags, expected) in cases {
        let arguments = ["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap()];
        let run = gs(arguments.iter().chain(flags));
        assert!(run.refusal().contains(expected), "{flags:?}: {run:?}");
        assert!(!output.exists(), "{flags:?}");
    }
    let occupied = place.path().to_str().unwrap();
    let run = gs(["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap(), "--checkpoint", occupied]);
    assert!(run.refusal().contains("--checkpoint") && !output.exists(), "{run:?}");
    let contradiction = gs(["fit", "--resume", "a", "--seed", "1"]);
    assert_eq!(contradiction.status, Some(2));
    assert!(contradiction.refusal().contains("--resume"));
}

#[test]
fn settings_files_that_cannot_be() {
    let place = folder();
    let image = picture(place.path(), 16, 16);
    let output = place.path().join("out");
    let file = place.path().join("settings.toml");
    for (text, expected) in [
        ("iterations = \"many\"", "settings.toml:1: "),
        ("iteration = 3", "iteration"),
        ("gaussians = 0", "Gaussians"),
        ("iterations = [", "settings.toml:1: "),
        ("rebin-every = 0", "rebin-every"),
    ] {
        fs::write(&file, text).unwrap();
        let run = gs([Path::new("fit"), &image, "-o".as_ref(), &output, "--settings".as_ref(), &file]);
        let line = run.refusal();
        assert!(line.contains(expected) && line.contains("settings.toml"), "{text}: {line}");
        assert!(!output.exists());
    }
}

#[test]
fn a_folder_that_takes_no_files_is_refused_before_the_fit() {
    let place = folder();
    let image = picture(place.path(), 16, 16);
    let file = place.path().join("file");
    fs::write(&file, "").unwrap();
    // No user can write below a regular file, not even root.
    for output in [file.join("out"), file.clone()] {
        let run = gs([Path::new("fit"), &image, "-o".as_ref(), &output]);
        assert_eq!(run.status, Some(1));
        let line = run.refusal();
        assert!(line.contains(output.to_str().unwrap()) && line.contains("--output"), "{line}");
    }
    assert_eq!(fs::read(&file).unwrap(), b"");
}

#[test]
fn a_reader_that_has_read_enough_is_no_failure() {
    let mut child = command()
        .args(["fit", "--help"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(output.stderr.is_empty(), "{output:?}");
}

#[test]
fn help_and_version_are_results_and_nothing_is_bad_usage() {
    assert!(gs(["--help"]).done().stdout.contains("Examples:"));
    assert!(gs(["fit", "--help"]).done().stdout.contains("reconstruction.png"));
    assert!(gs(["--version"]).done().stdout.starts_with("gs "));
    let nothing = gs::<&str>([]);
    assert_eq!((nothing.status, nothing.stdout.as_str()), (Some(2), ""));
    assert!(nothing.stderr.contains("Usage"));
    assert!(gs(["frobnicate"]).refusal().contains("frobnicate"));
}

#[test]
fn an_error_about_a_number_names_its_range() {
    for (words, expected) in [
        (&["fit", "-n", "-5"][..], "invalid value '-5' for '--gaussians <N>': must be at least 1; see gs fit --help"),
        (&["fit", "--iterations", "-1"], "'--iterations <K>': must be at least 0"),
        (&["train", "x", "--sh-degree", "-2"], "must be from 0 to 3"),
        (&["train", "x", "--max-size", "0"], "'--max-size <PX>': must be at least 1 px, such as 1600, or none"),
        (&["study", "replay", "x", "1", "--threads", "-1"], "must be from 1 to 1024"),
        (&["frontier", "x", "--max-error", "-1"], "write a positive number"),
        (&["train", "x", "--policy", "residual"], "--policy residual is a policy for images, which gs fit takes"),
    ] {
        let run = gs(words);
        assert!(run.refusal().contains(expected) && run.status == Some(2), "{words:?}: {run:?}");
        assert!(!run.stderr.contains("tip: "), "{run:?}");
    }
    let offered = gs(["train", "--help"]).done().stdout;
    assert!(offered.contains("mcmc") && !offered.contains("image-gs"), "{offered}");
}
