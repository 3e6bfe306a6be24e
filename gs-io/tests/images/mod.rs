//! Images made here are read correctly, and everything else is refused in one line.

mod colors;
mod kinds;
mod stored;

use std::{
    fs,
    io::Cursor,
    path::{Path, PathBuf},
};

use gs_conformance::properties::fresh;
use gs_core::Image;
use gs_io::{Error, read_image, read_image_on, read_stored_image, write_png};
use image::{DynamicImage, ImageBuffer, ImageEncoder, ImageFormat, codecs, metadata::Orientation};
use proptest::prelude::*;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn saved(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    path
}

/// The error of reading these bytes; its text must be one line that names the file.
fn refusal(folder: &Path, name: &str, bytes: &[u8]) -> Error {
    let error = read_image(saved(folder, name, bytes)).expect_err(name);
    let text = error.to_string();
    assert!(text.contains(name) && !text.contains('\n'), "{text:?}");
    error
}

fn rgb_pattern(width: u32, height: u32) -> DynamicImage {
    ImageBuffer::from_fn(width, height, |x, y| image::Rgb([(40 * x) as u8, (90 * y) as u8, (x * y) as u8])).into()
}

#[test]
fn every_lossless_format_gives_the_stored_values() {
    let folder = folder();
    let source = rgb_pattern(5, 3);
    for format in [ImageFormat::Png, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::WebP, ImageFormat::Pnm] {
        // The name is wrong: content decides.
        let loaded = read_image(saved(folder.path(), "a.jpg", &encoded(&source, format))).unwrap();
        assert_eq!(loaded.image.size(), (5, 3), "{format:?}");
        assert!(!loaded.had_alpha, "{format:?}");
        for (x, y, pixel) in source.to_rgb8().enumerate_pixels() {
            assert_eq!(loaded.image.pixel(x, y), pixel.0.map(|v| f32::from(v) / 255.0), "{format:?} ({x}, {y})");
        }
    }
}

#[test]
fn jpeg_is_read_to_within_its_losses() {
    let folder = folder();
    let grey: DynamicImage = ImageBuffer::from_pixel(17, 9, image::Rgb([200_u8, 100, 50])).into();
    let loaded = read_image(saved(folder.path(), "a.png", &encoded(&grey, ImageFormat::Jpeg))).unwrap();
    assert_eq!(loaded.image.size(), (17, 9));
    for (found, expected) in loaded.image.pixel(8, 4).into_iter().zip([200.0, 100.0, 50.0]) {
        assert!((found * 255.0 - expected).abs() <= 3.0, "{found} {expected}");
    }
}

#[test]
fn sixteen_bits_and_grey_keep_their_precision() {
    let folder = folder();
    let deep: DynamicImage =
        ImageBuffer::from_fn(3, 2, |x, y| image::Rgb([1 + 257 * x as u16, y as u16, 65535])).into();
    let grey: DynamicImage = ImageBuffer::from_pixel(2, 2, image::Luma([77_u8])).into();
    let deep_grey: DynamicImage = ImageBuffer::from_pixel(2, 2, image::Luma([30_001_u16])).into();
    for format in [ImageFormat::Png, ImageFormat::Tiff] {
        let read = |image| read_image(saved(folder.path(), "a", &encoded(image, format))).unwrap();
        let loaded = read(&deep);
        assert_eq!(loaded.image.pixel(2, 1), [515.0 / 65535.0, 1.0 / 65535.0, 1.0]);
        assert_eq!(read(&grey).image.pixel(1, 1), [77.0 / 255.0; 3]);
        assert_eq!(read(&deep_grey).image.pixel(1, 0), [30_001.0 / 65535.0; 3]);
    }
}

#[test]
fn floating_point_tiff_is_taken_as_it_is_but_must_be_finite() {
    let folder = folder();
    let mut values: ImageBuffer<image::Rgb<f32>, Vec<f32>> =
        ImageBuffer::from_pixel(3, 2, image::Rgb([-0.25, 0.5, 1.5]));
    let loaded =
        read_image(saved(folder.path(), "a.tif", &encoded(&values.clone().into(), ImageFormat::Tiff))).unwrap();
    assert_eq!(loaded.image.pixel(0, 1), [-0.25, 0.5, 1.5]);
    values.get_pixel_mut(1, 1).0[2] = f32::NAN;
    let error = refusal(folder.path(), "b.tif", &encoded(&values.into(), ImageFormat::Tiff));
    assert!(error.to_string().contains("pixel (1, 1) is NaN"), "{error}");
}

#[test]
fn alpha_is_read_as_requested() {
    let folder = folder();
    let rgba: DynamicImage =
        ImageBuffer::from_fn(2, 1, |x, _| image::Rgba([255, 0, 0, [51_u8, 255][x as usize]])).into();
    let path = saved(folder.path(), "a.png", &encoded(&rgba, ImageFormat::Png));
    let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);

    let over_white = read_image(&path).unwrap();
    assert!(over_white.had_alpha);
    assert!(close(over_white.image.pixel(0, 0), [1.0, 0.8, 0.8]), "{:?}", over_white.image);
    assert_eq!(over_white.image.pixel(1, 0), [1.0, 0.0, 0.0]);
    let over_green = read_image_on(&path, [0.0, 1.0, 0.0]).unwrap();
    assert!(close(over_green.image.pixel(0, 0), [0.2, 0.8, 0.0]), "{:?}", over_green.image);
    assert_eq!(read_stored_image(&path).unwrap().image.pixel(0, 0), [1.0, 0.0, 0.0]);

    let grey_alpha: DynamicImage = ImageBuffer::from_pixel(1, 1, image::LumaA([0_u8, 0])).into();
    let path = saved(folder.path(), "b.png", &encoded(&grey_alpha, ImageFormat::Png));
    assert_eq!(read_image(path).unwrap().image.pixel(0, 0), [1.0; 3]);
    let opaque: DynamicImage = ImageBuffer::from_pixel(1, 1, image::Rgba([9_u8, 9, 9, 255])).into();
    let path = saved(folder.path(), "c.png", &encoded(&opaque, ImageFormat::Png));
    assert!(!read_image(path).unwrap().had_alpha);
}

#[test]
fn palettes_are_looked_up_with_their_transparency() {
    let folder = folder();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 3, 1);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Two);
    encoder.set_palette(vec![255, 0, 0, 0, 255, 0, 0, 0, 255]);
    encoder.set_trns(vec![255, 255, 0]);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&[0b00_01_10_00]).unwrap();
    writer.finish().unwrap();
    let loaded = read_image(saved(folder.path(), "a.png", &bytes)).unwrap();
    assert_eq!(loaded.image.pixels(), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]]);
    assert!(loaded.had_alpha);
}

/// A little-endian EXIF block with one entry, the orientation.
fn exif(orientation: Orientation) -> Vec<u8> {
    let mut block = b"II\x2a\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    block.extend([orientation.to_exif(), 0, 0, 0, 0, 0, 0, 0]);
    block
}

#[test]
fn all_eight_exif_orientations_are_applied() {
    let folder = folder();
    let source = rgb_pattern(3, 2).to_rgb8();
    for tag in 1..=8 {
        let mut bytes = Vec::new();
        let mut encoder = codecs::png::PngEncoder::new(&mut bytes);
        encoder.set_exif_metadata(exif(Orientation::from_exif(tag).unwrap())).unwrap();
        encoder.write_image(source.as_raw(), 3, 2, image::ExtendedColorType::Rgb8).unwrap();
        let image = read_image(saved(folder.path(), "a.png", &bytes)).unwrap().image;
        assert_eq!(image.size(), if tag < 5 { (3, 2) } else { (2, 3) }, "orientation {tag}");
        for y in 0..image.height() {
            for x in 0..image.width() {
                // Position at which the pixel seen at (x, y) is stored (EXIF 2.3, §4.6.4, tag
                // 0x0112).
                let (column, row) = match tag {
                    1 => (x, y),
                    2 => (2 - x, y),
                    3 => (2 - x, 1 - y),
                    4 => (x, 1 - y),
                    5 => (y, x),
                    6 => (y, 1 - x),
                    7 => (2 - y, 1 - x),
                    _ => (2 - y, x),
                };
                let expected = source.get_pixel(column, row).0.map(|v| f32::from(v) / 255.0);
                assert_eq!(image.pixel(x, y), expected, "orientation {tag} at ({x}, {y})");
            }
        }
    }
}

#[test]
fn a_camera_jpeg_is_turned_upright() {
    let folder = folder();
    let sideways =
        ImageBuffer::from_fn(32, 16, |x, _| image::Rgb(if x < 16 { [250_u8, 10, 10] } else { [10, 10, 250] }));
    let mut bytes = Vec::new();
    let mut encoder = codecs::jpeg::JpegEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif(Orientation::Rotate90)).unwrap();
    encoder.write_image(sideways.as_raw(), 32, 16, image::ExtendedColorType::Rgb8).unwrap();
    let image = read_image(saved(folder.path(), "a.jpg", &bytes)).unwrap().image;
    assert_eq!(image.size(), (16, 32));
    assert!(image.pixel(8, 4)[0] > 0.8 && image.pixel(8, 28)[2] > 0.8, "red above blue");
}

#[test]
fn one_pixel_is_an_image_and_none_is_not() {
    let folder = folder();
    let one = read_image(saved(folder.path(), "one.png", &encoded(&rgb_pattern(1, 1), ImageFormat::Png))).unwrap();
    assert_eq!((one.image.size(), one.image.pixel(0, 0)), ((1, 1), [0.0; 3]));
    let mut empty_png = encoded(&rgb_pattern(1, 1), ImageFormat::Png);
    empty_png[16..24].fill(0);
    for (name, bytes) in [("a.ppm", b"P6\n0 0\n255\n".as_slice()), ("b.png", &empty_png)] {
        let error = refusal(folder.path(), name, bytes);
        assert!(matches!(error, Error::Unusable { .. }), "{error}");
    }
}

#[test]
fn a_header_that_claims_too_much_is_refused_by_its_size() {
    let folder = folder();
    let mut bomb = Vec::new();
    let mut encoder = png::Encoder::new(&mut bomb, 20_000, 20_000);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Sixteen);
    let mut writer = encoder.write_header().unwrap();
    writer.write_chunk(png::chunk::IDAT, &[0x78, 0x9c, 0x63, 0x00]).unwrap();
    drop(writer);
    let bmp = |width: u32| {
        let mut bytes = encoded(&rgb_pattern(2, 2), ImageFormat::Bmp);
        bytes[18..22].copy_from_slice(&width.to_le_bytes());
        bytes
    };
    for (name, bytes) in
        [("a.png", bomb), ("b.ppm", b"P6\n20000 20000\n255\n".to_vec()), ("c.bmp", bmp(20_000)), ("d.bmp", bmp(60_000))]
    {
        let error = refusal(folder.path(), name, &bytes);
        assert!(error.to_string().contains("each side must be 1 to 16384 px"), "{error}");
    }
}

#[test]
fn a_truncated_image_is_damaged_wherever_it_ends() {
    let folder = folder();
    let source = rgb_pattern(40, 30);
    for (format, complete) in [
        (ImageFormat::Png, 12), // the closing chunk holds nothing
        (ImageFormat::Jpeg, 0),
        (ImageFormat::Bmp, 0),
        (ImageFormat::Tiff, 0),
        (ImageFormat::WebP, 1), // one byte of padding
        (ImageFormat::Pnm, 0),
    ] {
        let bytes = encoded(&source, format);
        for end in 0..bytes.len() - complete {
            if end % 7 != 0 && end + 20 < bytes.len() {
                continue;
            }
            let result = read_image(saved(folder.path(), "cut", &bytes[..end]));
            assert!(result.is_err(), "{format:?} cut at {end} of {}", bytes.len());
        }
    }
}

#[test]
fn a_written_png_comes_back_rounded_to_eight_bits() {
    let folder = folder();
    let path = folder.path().join("a.png");
    let image =
        Image::from_pixels(2, 2, vec![[0.0, 1.0, 0.5], [-3.0, 7.0, 0.499_99], [0.3; 3], [f32::NAN; 3]]).unwrap();
    write_png(&path, &image).unwrap();
    let expected = [[0, 255, 128], [0, 255, 127], [77, 77, 77], [0, 0, 0]].map(|p| p.map(|v| v as f32 / 255.0));
    assert_eq!(read_image(&path).unwrap().image.pixels(), expected);
    let error = write_png(folder.path().join("no/a.png"), &image).unwrap_err();
    assert!(matches!(error, Error::NoFolder { .. }), "{error}");
}

proptest! {
    #![proptest_config(fresh(256))]

    #[test]
    fn eight_bit_images_survive_a_round_trip(width in 1..20_u32, height in 1..20_u32, seed in any::<u32>()) {
        let value = |k: u32| (seed.wrapping_mul(2_654_435_761).wrapping_add(k.wrapping_mul(40_503)) >> 7 & 255) as f32 / 255.0;
        let image = Image::from_fn(width, height, |x, y| [0, 1, 2].map(|c| value(c + 3 * (x + width * y)))).unwrap();
        let folder = folder();
        write_png(folder.path().join("a.png"), &image).unwrap();
        prop_assert_eq!(read_image(folder.path().join("a.png")).unwrap().image, image);
    }

    #[test]
    fn flipped_bytes_never_panic(at in any::<prop::sample::Index>(), mask in 1..=255_u8, which in 0..6_usize) {
        let formats =
            [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::WebP, ImageFormat::Pnm];
        let mut bytes = encoded(&rgb_pattern(16, 9), formats[which]);
        let at = at.index(bytes.len());
        bytes[at] ^= mask;
        let folder = folder();
        // Pixels may change, or the file may be refused.
        let _ = read_image(saved(folder.path(), "flipped", &bytes));
    }
}
