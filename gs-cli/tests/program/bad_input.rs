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
    fs::write(path("text.png"), "This is not a picture.\n").unwrap();
    fs::write(path("bomb.png"), png_without_pixels(20_000, 20_000)).unwrap();

    refuse_fit(&path("absent.png"), "no such file");
    refuse_fit(&path("text.png"), "is text, not an image");
    refuse_fit(&path("bomb.png"), "20000x20000");
}

#[test]
fn flags_that_ask_for_what_cannot_be() {
    let place = folder();
    let image = picture(place.path(), 16, 16);
    let output = place.path().join("out");
    let cases: [(&[&str], &str); 4] = [
        (&["--policy", "frobnicate"], "possible values: absolute"),
        (&["--simd", "mmx"], "mmx"),
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
    for (text, expected) in [("iterations = \"many\"", "settings.toml:1: "), ("gaussians = 0", "Gaussians")] {
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
