//! Colours in other spaces than sRGB are converted, and sRGB colours stay bit-identical.

use glam::{DMat3, DVec3, dvec3};
use gs_io::{ImageRemark, read_image};
use image::{ExtendedColorType, ImageBuffer, ImageEncoder, codecs};
use moxcms::ColorProfile;
use png::chunk::{ChunkType, gAMA, sRGB};
use proptest::prelude::*;

use super::{folder, fresh, saved};

const CICP: ChunkType = ChunkType(*b"cICP");
const CHRM: ChunkType = ChunkType(*b"cHRM");

/// All hues, from black to white.
pub(super) fn hues() -> ImageBuffer<image::Rgb<u8>, Vec<u8>> {
    ImageBuffer::from_fn(16, 16, |x, y| image::Rgb([(17 * x) as u8, (17 * y) as u8, (255 - 15 * x - y) as u8]))
}

/// The hues as a PNG with these chunks before its pixels.
fn png_with(chunks: &[(ChunkType, &[u8])]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 16, 16);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().unwrap();
    chunks.iter().for_each(|(kind, data)| writer.write_chunk(*kind, data).unwrap());
    writer.write_image_data(hues().as_raw()).unwrap();
    writer.finish().unwrap();
    bytes
}

/// The hues as a PNG with an ICC profile.
pub(super) fn png_in(profile: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = codecs::png::PngEncoder::new(&mut bytes);
    encoder.set_icc_profile(profile.to_vec()).unwrap();
    encoder.write_image(hues().as_raw(), 16, 16, ExtendedColorType::Rgb8).unwrap();
    bytes
}

fn linear(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn encoded_srgb(value: f64) -> f64 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// Converts linear RGB with these primaries and the white point D65 to XYZ.
fn to_xyz(primaries: [(f64, f64); 3]) -> DMat3 {
    let xyz = |(x, y): (f64, f64)| dvec3(x / y, 1.0, (1.0 - x - y) / y);
    let columns = primaries.map(xyz);
    let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]);
    let amounts = matrix.inverse() * xyz((0.3127, 0.3290));
    matrix * DMat3::from_diagonal(amounts)
}

const SRGB: [(f64, f64); 3] = [(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)];
const P3: [(f64, f64); 3] = [(0.680, 0.320), (0.265, 0.690), (0.150, 0.060)];

/// The sRGB colours of the hues decoded with `decode` into linear light with these primaries.
fn expected(primaries: [(f64, f64); 3], decode: impl Fn(f64) -> f64) -> Vec<[f64; 3]> {
    let matrix = to_xyz(SRGB).inverse() * to_xyz(primaries);
    let convert = |pixel: &image::Rgb<u8>| {
        let light = matrix * DVec3::from_array(pixel.0.map(|value| decode(f64::from(value) / 255.0)));
        light.to_array().map(encoded_srgb)
    };
    hues().pixels().map(convert).collect()
}

/// Reads an image and compares its pixels, to a step and a half of 8 bits because D65 is rounded
/// differently everywhere; returns the remarks.
#[track_caller]
fn read_as(bytes: &[u8], expected: &[[f64; 3]]) -> Vec<ImageRemark> {
    let place = folder();
    let loaded = read_image(saved(place.path(), "a", bytes)).unwrap();
    for (found, expected) in loaded.image.pixels().iter().zip(expected) {
        let worst = found.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1.6 / 255.0, "{found:?} {expected:?}");
    }
    loaded.remarks
}

/// Reads the hues, which must be as stored; returns the remarks.
#[track_caller]
fn read_unchanged(bytes: &[u8]) -> Vec<ImageRemark> {
    let place = folder();
    let loaded = read_image(saved(place.path(), "a", bytes)).unwrap();
    let stored: Vec<[f32; 3]> = hues().pixels().map(|pixel| pixel.0.map(|value| f32::from(value) / 255.0)).collect();
    assert!(loaded.image.pixels() == stored, "not the bits that were stored");
    loaded.remarks
}

fn converted(from: &str) -> Vec<ImageRemark> {
    vec![ImageRemark::Converted { from: from.to_owned() }]
}

#[test]
fn a_display_p3_image_does_not_shift() {
    let profile = ColorProfile::new_display_p3().encode().unwrap();
    let expected = expected(P3, linear);
    assert_eq!(read_as(&png_in(&profile), &expected), converted("the colour profile Display P3"));
    assert!((expected[8][0] - 136.0 / 255.0).abs() > 5.0 / 255.0, "unconverted colours are further away");

    let mut tiff = std::io::Cursor::new(Vec::new());
    let mut encoder = codecs::tiff::TiffEncoder::new(&mut tiff);
    encoder.set_icc_profile(profile.clone()).unwrap();
    encoder.write_image(hues().as_raw(), 16, 16, ExtendedColorType::Rgb8).unwrap();
    assert_eq!(read_as(tiff.get_ref(), &expected), converted("the colour profile Display P3"));

    let mut webp = Vec::new();
    let mut encoder = codecs::webp::WebPEncoder::new_lossless(&mut webp);
    encoder.set_icc_profile(profile.clone()).unwrap();
    encoder.write_image(hues().as_raw(), 16, 16, ExtendedColorType::Rgb8).unwrap();
    assert_eq!(read_as(&webp, &expected), converted("the colour profile Display P3"));

    let mut jpeg = Vec::new();
    let mut encoder = codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 100);
    encoder.set_icc_profile(profile).unwrap();
    let red = ImageBuffer::from_pixel(16, 16, image::Rgb([200_u8, 60, 60]));
    encoder.write_image(red.as_raw(), 16, 16, ExtendedColorType::Rgb8).unwrap();
    let place = folder();
    let pixel = read_image(saved(place.path(), "a.jpg", &jpeg)).unwrap().image.pixel(8, 8).map(|value| value * 255.0);
    // P3's (200, 60, 60) in sRGB, within JPEG's error.
    assert!((pixel[0] - 217.4).abs() < 3.0 && (pixel[1] - 44.3).abs() < 4.0, "{pixel:?}");
}

#[test]
fn srgb_stays_as_it_is_bit_for_bit() {
    let profile = ColorProfile::new_srgb().encode().unwrap();
    let whole = [(CICP, &[1, 13, 0, 1][..])];
    for bytes in [png_in(&profile), png_with(&[]), png_with(&whole), png_with(&[(sRGB, &[0])])] {
        assert_eq!(read_unchanged(&bytes), []);
    }
    // By convention 1/2.2 and sRGB's own primaries stand for sRGB, with any number of digits.
    let primaries = [31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000_u32].map(u32::to_be_bytes).concat();
    for gamma in [45_455_u32, 45_454, 45_000, 46_000] {
        assert_eq!(read_unchanged(&png_with(&[(gAMA, &gamma.to_be_bytes()), (CHRM, &primaries)])), []);
    }
}

#[test]
fn a_pngs_gamma_is_applied_where_nothing_better_is_said() {
    let gamma = |value: u32| value.to_be_bytes();
    let srgb = |decode: &dyn Fn(f64) -> f64| expected(SRGB, decode);
    let bytes = png_with(&[(gAMA, &gamma(100_000))]);
    assert_eq!(read_as(&bytes, &srgb(&|value| value)), converted("gamma 1.00 (gAMA)"));
    let bytes = png_with(&[(gAMA, &gamma(55_556))]);
    assert_eq!(read_as(&bytes, &srgb(&|value| value.powf(1.0 / 0.555_56))), converted("gamma 1.80 (gAMA)"));
    assert_eq!(read_unchanged(&png_with(&[(sRGB, &[0]), (gAMA, &gamma(100_000))])), []);
    let p3 = [31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000_u32].map(u32::to_be_bytes).concat();
    let bytes = png_with(&[(CHRM, &p3), (gAMA, &gamma(45_455))]);
    assert_eq!(read_as(&bytes, &expected(P3, linear)), converted("other primaries (cHRM)"));
    let bytes = png_with(&[(CICP, &[12, 13, 0, 1]), (gAMA, &gamma(100_000))]);
    assert_eq!(read_as(&bytes, &expected(P3, linear)), converted("CICP 12/13"));
}

#[test]
fn grey_has_profiles_too() {
    let gamma = ColorProfile::new_gray_with_gamma(1.8).encode().unwrap();
    let grey: ImageBuffer<image::Luma<u8>, Vec<u8>> =
        ImageBuffer::from_fn(16, 16, |x, y| image::Luma([(16 * y + x) as u8]));
    let mut bytes = Vec::new();
    let mut encoder = codecs::png::PngEncoder::new(&mut bytes);
    encoder.set_icc_profile(gamma).unwrap();
    encoder.write_image(grey.as_raw(), 16, 16, ExtendedColorType::L8).unwrap();
    let expected: Vec<[f64; 3]> =
        (0..256).map(|value| [encoded_srgb((f64::from(value) / 255.0).powf(1.8)); 3]).collect();
    assert!(matches!(&read_as(&bytes, &expected)[..], [ImageRemark::Converted { .. }]));
}

#[test]
fn unusable_colour_profiles_are_ignored_with_a_remark() {
    let lab = ColorProfile::new_lab().encode().unwrap();
    let hdr = png_with(&[(CICP, &[9, 16, 0, 1])]);
    let unknown = png_with(&[(CICP, &[99, 13, 0, 1])]);
    for (bytes, why) in [
        (png_in(b"no profile"), "damaged"),
        (png_in(&ColorProfile::new_display_p3().encode().unwrap()[..200]), ""),
        (png_in(&lab), "not for RGB or grey"),
        (hdr, "HDR"),
        (unknown, "CICP 99/13"),
    ] {
        let remarks = read_unchanged(&bytes);
        assert!(
            matches!(&remarks[..], [ImageRemark::ProfileIgnored { why: found }] if found.contains(why)),
            "{remarks:?}"
        );
    }
    // Floating point has no range to convert.
    let values: ImageBuffer<image::Rgb<f32>, Vec<f32>> = ImageBuffer::from_pixel(3, 2, image::Rgb([-0.25, 0.5, 1.5]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = codecs::tiff::TiffEncoder::new(&mut bytes);
    encoder.set_icc_profile(ColorProfile::new_display_p3().encode().unwrap()).unwrap();
    let samples: Vec<u8> = values.as_raw().iter().flat_map(|value| value.to_ne_bytes()).collect();
    encoder.write_image(&samples, 3, 2, ExtendedColorType::Rgb32F).unwrap();
    let place = folder();
    let loaded = read_image(saved(place.path(), "a.tif", bytes.get_ref())).unwrap();
    assert_eq!(loaded.image.pixel(0, 1), [-0.25, 0.5, 1.5]);
    assert!(matches!(&loaded.remarks[..], [ImageRemark::ProfileIgnored { .. }]));
}

proptest! {
    #![proptest_config(fresh(60))]

    #[test]
    fn damaged_profiles_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8), which in 0..3_usize) {
        let profile = [ColorProfile::new_display_p3(), ColorProfile::new_adobe_rgb(), ColorProfile::new_gray_with_gamma(1.8)];
        let mut profile = profile[which].encode().unwrap();
        for (at, value) in changes {
            let at = at.index(profile.len());
            profile[at] = value;
        }
        let place = folder();
        let loaded = read_image(saved(place.path(), "a.png", &png_in(&profile))).unwrap();
        prop_assert!(loaded.image.pixels().as_flattened().iter().all(|value| (0.0..=1.0).contains(value)));
    }
}
