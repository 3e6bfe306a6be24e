//! Messages about files that are not images, unreadable images, and files with several images.

use std::{fs, io::Cursor};

use gs_core::Image;
use gs_io::{Animation, Error, read_image, write_animation};
use image::{Frame, ImageBuffer, ImageFormat, codecs::gif::GifEncoder};
use tiff::encoder::{TiffEncoder, colortype::RGB8};

use super::{encoded, folder, refusal, rgb_pattern, saved};

#[test]
fn rejects_non_images() {
    let place = folder();
    let long = "é".repeat(1000);
    for (name, bytes, found) in [
        ("text.png", b"Not an image, only its name says so.".as_slice(), "is text, not an image; name an image file"),
        ("accents.png", &long.as_bytes()[..1023], "is text"),
        ("page.jpg", b"<!DOCTYPE html><html></html>", "is a web page"),
        ("drawing.svg", b"<?xml version=\"1.0\"?><svg></svg>", "is an SVG drawing"),
        ("empty.png", b"", "empty.png: is empty; fetch or export it again"),
        ("noise.png", &[0x00, 0xfe, 0x13], "begins with the bytes 00 fe 13"),
        ("photo.jxl", b"\xff\x0a\x1f\x41", "is a JPEG XL image"),
        ("photo2.jxl", b"\0\0\0\x0cJXL \r\n\x87\n", "magick photo.jxl photo.png"),
        ("photo.jp2", b"\0\0\0\x0cjP  \r\n\x87\n", "is a JPEG 2000 image"),
        ("photo.avif", b"\0\0\0\x1cftypavif\0\0\0\0", "is an AVIF image"),
        ("photo.heic", b"\0\0\0\x18ftypheic\0\0\0\0", "is a HEIC image"),
        ("photo.mp4", b"\0\0\0\x18ftypisom\0\0\0\0", "is a video"),
        ("photo.cr3", b"\0\0\0\x18ftypcrx \0\0\0\x01", "is a camera's raw image"),
        ("photo.nef", b"II\x2a\0\x08\0\0\0", "is a camera's raw image"),
        ("photo.psd", b"8BPS\0\x01", "is a Photoshop document"),
        ("photo.pdf", b"%PDF-1.7", "is a PDF document"),
        ("photo.exr", b"\x76\x2f\x31\x01\x02\0\0\0", "is an OpenEXR image"),
    ] {
        let error = refusal(place.path(), name, bytes);
        assert!(matches!(error, Error::NotAnImage { .. }) && error.to_string().contains(found), "{error}");
    }
    let qoi = refusal(place.path(), "photo.qoi", b"qoif\0\0\0\x01").to_string();
    assert!(qoi.contains("begins with the bytes 71 6f 69 66"), "{qoi}");
    let error = read_image(place.path()).unwrap_err();
    assert!(matches!(error, Error::NotAFile { found: "a folder", .. }), "{error}");
    let error = read_image(place.path().join("absent.png")).unwrap_err();
    assert!(matches!(error, Error::Missing { .. }), "{error}");
    let error = read_image(place.path().join("text.png/inside.png")).unwrap_err();
    assert!(matches!(error, Error::Missing { .. }), "{error}");
}

#[test]
fn a_printers_colours_are_refused() {
    let place = folder();
    let mut jpeg = encoded(&rgb_pattern(16, 16), ImageFormat::Jpeg);
    let frame = jpeg.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    // The number of channels.
    jpeg[frame + 9] = 4;
    let error = refusal(place.path(), "a.jpg", &jpeg).to_string();
    assert!(error.contains("CMYK") && error.ends_with("magick photo.jpg -profile sRGB.icc photo.png"), "{error}");
}

fn frames() -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = GifEncoder::new(&mut bytes);
    for i in 0..2 {
        let red = ImageBuffer::from_pixel(6, 4, image::Rgba([200 - 100 * i, 0, 0, 255]));
        encoder.encode_frame(Frame::new(red)).unwrap();
    }
    drop(encoder);
    bytes
}

/// A WebP animation of one frame, made of the lossless image of a still one.
fn animated_webp() -> Vec<u8> {
    let still = encoded(&rgb_pattern(6, 4), ImageFormat::WebP);
    let chunk = |name: &[u8; 4], data: &[u8]| {
        let padding = if data.len().is_multiple_of(2) { &[][..] } else { &[0] };
        [&name[..], &(data.len() as u32).to_le_bytes(), data, padding].concat()
    };
    let side = |pixels: u32| (pixels - 1).to_le_bytes()[..3].to_vec();
    let size = [side(6), side(4)].concat();
    // Position, 0 and 0, size, a duration and no flags; then the image's own chunk.
    let frame = [&[0; 6][..], &size, &[100, 0, 0, 0], &still[12..]].concat();
    let chunks = [
        chunk(b"VP8X", &[&[2, 0, 0, 0][..], &size].concat()),
        chunk(b"ANIM", &[0; 6]),
        chunk(b"ANMF", &frame),
        chunk(b"ANMF", &frame),
    ];
    let content = [&b"WEBP"[..], &chunks.concat()].concat();
    chunk(b"RIFF", &content)
}

#[test]
fn animation_reads_first_frame() {
    let place = folder();
    let path = place.path().join("a.png");
    let animation = Animation { width: 6, height: 4, frames: 2, fps: 10 };
    let frame = |number: u32| Ok::<_, gs_io::Error>(Image::filled(6, 4, [1.0 - number as f32, 0.5, 0.0]).unwrap());
    write_animation(&path, animation, frame).unwrap();
    let apng = fs::read(&path).unwrap();
    for (bytes, red) in [(frames(), 200.0 / 255.0), (apng, 1.0), (animated_webp(), 0.0)] {
        let loaded = read_image(saved(place.path(), "a", &bytes)).unwrap();
        assert_eq!((loaded.image.size(), loaded.image.pixel(0, 0)[0]), ((6, 4), red));
    }
}

#[test]
fn only_the_first_page_is_read() {
    let place = folder();
    let mut bytes = Cursor::new(Vec::new());
    {
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        encoder.write_image::<RGB8>(6, 6, &[200; 108]).unwrap();
        encoder.write_image::<RGB8>(3, 3, &[100; 27]).unwrap();
    }
    let loaded = read_image(saved(place.path(), "a.tif", &bytes.into_inner())).unwrap();
    assert_eq!(loaded.image.size(), (6, 6));
    assert!(loaded.image.pixels().iter().all(|pixel| *pixel == [200.0 / 255.0; 3]));
}

#[test]
fn a_gif_is_read_with_its_transparency() {
    let place = folder();
    let half = ImageBuffer::from_fn(4, 2, |x, _| image::Rgba(if x < 2 { [9, 200, 30, 255] } else { [0, 0, 0, 0] }));
    let mut bytes = Vec::new();
    GifEncoder::new(&mut bytes).encode_frame(Frame::new(half)).unwrap();
    let loaded = read_image(saved(place.path(), "a.gif", &bytes)).unwrap();
    assert_eq!((loaded.image.pixel(0, 0), loaded.image.pixel(3, 1)), ([9.0, 200.0, 30.0].map(|v| v / 255.0), [1.0; 3]));
    let error = refusal(place.path(), "b.gif", &bytes[..bytes.len() / 2]);
    assert!(error.to_string().contains("damaged GIF image"), "{error}");
}
