//! Encoding images: targets are met by the decoded picture, and settings out of range are refused.

use gs_codec::{Extent, decode};
use gs_core::{
    Canvas, Image, Rasterizer as _,
    metrics::{l1_and_psnr, mse_of_psnr, psnr_of_mse},
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_io::{File2d, GsiFile, decode_gsi, premultiplied, straight};
use gs_train::{
    EncodeImage, EncodeLayers, EncodeSettings, EncodeTarget, EncodeWork, Encoded, Error, ImageQuality, Tune, encode,
};
use pollster::FutureExt as _;

/// Soft shapes, an edge and a little texture.
fn picture() -> Image {
    let pixel = |x: u32, y: u32| {
        let (x, y) = (x as f32, y as f32);
        let edge = if 0.6 * x + y > 70.0 { 0.3 } else { 0.0 };
        let texture = 0.06 * (0.9 * x).sin() * (0.7 * y).cos();
        let soft = (-((x - 30.0).powi(2) + (y - 24.0).powi(2)) / 300.0).exp();
        [0.2 + edge + 0.3 * soft, 0.3 + 0.7 * edge + texture, 0.5 - 0.4 * soft + texture]
    };
    Image::from_fn(96, 64, pixel).unwrap().rounded_to_8_bits()
}

fn encoded<'a>(image: impl Into<EncodeImage<'a>>, target: EncodeTarget) -> Result<Encoded, Error> {
    encoded_in(image, target, EncodeLayers::One)
}

fn encoded_in<'a>(
    image: impl Into<EncodeImage<'a>>,
    target: EncodeTarget,
    layers: EncodeLayers,
) -> Result<Encoded, Error> {
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    encode(&cpu, image, &EncodeSettings::default().with(|s| (s.target, s.layers) = (target, layers)), &|_| ())
        .block_on()
}

#[test]
fn an_encoder_reports_its_stages_from_beginning_to_end() {
    let (image, cpu) = (picture(), CpuRasterizer::new(CpuSettings::default()).unwrap());
    let reports = std::cell::RefCell::new(Vec::new());
    let settings = EncodeSettings::default().with(|s| s.target = EncodeTarget::Bytes(500));
    let observer = |progress| reports.borrow_mut().push(progress);
    let watched = encode(&cpu, &image, &settings, &observer).block_on().unwrap();
    assert_eq!(watched.bytes, encode(&cpu, &image, &settings, &|_| ()).block_on().unwrap().bytes);
    let reports = reports.into_inner();
    let stages: Vec<_> = reports.chunk_by(|a, b| a.stage == b.stage).collect();
    let works: Vec<EncodeWork> = stages.iter().map(|stage| stage[0].work).collect();
    assert!(works.starts_with(&[EncodeWork::Fit, EncodeWork::Fit, EncodeWork::Rounding]), "{works:?}");
    for (stage, number) in stages.iter().zip(1..) {
        assert!(stage.iter().all(|progress| progress.stage == number && progress.gaussians > 0), "{stage:?}");
        assert!(stage.is_sorted_by(|a, b| a.done <= b.done) && stage[0].done == 0.0, "{stage:?}");
        assert!(stage.last().is_some_and(|last| (0.9..=1.0).contains(&last.done)), "{stage:?}");
    }
}

#[test]
fn a_file_tuned_for_ssim_has_more_of_it() {
    let image = picture();
    // A quarter of the contrast on the left, all of it on the right.
    let faint = |x: u32, y: u32| image.pixel(x, y).map(|v| if x < 48 { 0.4 + 0.25 * (v - 0.4) } else { v });
    let image = Image::from_fn(96, 64, faint).unwrap().rounded_to_8_bits();
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let quality = |tune| {
        let settings = EncodeSettings::default().with(|s| (s.target, s.tune) = (EncodeTarget::Bytes(500), tune));
        let bytes = encode(&cpu, &image, &settings, &|_| ()).block_on().unwrap().bytes;
        ImageQuality::as_written(&rendered(&decode_gsi(&bytes, Extent::Whole).unwrap().colors), &image).unwrap()
    };
    let [plain, tuned] = [Tune::Psnr, Tune::Ssim].map(quality);
    assert!(tuned.ssim > plain.ssim && tuned != plain, "{plain:?} {tuned:?}");
}

/// PSNR of the picture that the bytes decode to.
fn psnr(bytes: &[u8], image: &Image) -> f64 {
    l1_and_psnr(&rendered(&decode_gsi(bytes, Extent::Whole).unwrap().colors), image).unwrap().1
}

fn rendered(file: &File2d) -> Image {
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    cpu.render(&file.scene, &Canvas::new(file.width, file.height), &file.settings).block_on().unwrap()
}

/// A picture in a disc with a soft edge, and its alpha.
fn disc() -> (Image, Vec<f32>) {
    let image = picture();
    let alpha = |k: u32| (1.0 - ((k % 96) as f32 - 48.0).hypot((k / 96) as f32 - 32.0) / 28.0) * 5.0;
    (image, (0..96 * 64).map(|k| alpha(k).clamp(0.0, 1.0)).collect())
}

#[test]
fn a_size_is_kept_and_used() {
    let image = picture();
    let mut before = 0.0;
    for bytes in [300, 1200] {
        let found = encoded(&image, EncodeTarget::Bytes(bytes)).unwrap();
        assert!(
            (found.bytes.len() as u64) <= bytes && found.bytes.len() as u64 * 10 > bytes * 9,
            "{}",
            found.bytes.len()
        );
        assert!((psnr(&found.bytes, &image) - found.psnr).abs() < 1e-9);
        assert_eq!(decode(&found.bytes, Extent::Whole).unwrap().scene.means.len(), found.gaussians);
        assert!(found.psnr > before + 4.0, "{} after {before} dB", found.psnr);
        before = found.psnr;
    }
    assert!(before > 34.0, "{before} dB");
}

/// The mean squared error of each row, and its mean over all rows.
fn errors_of_rows(bytes: &[u8], image: &Image) -> (Vec<f64>, f64) {
    let drawn = rendered(&decode_gsi(bytes, Extent::Whole).unwrap().colors);
    let width = image.width() as usize;
    let squared = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
    let rows = drawn.pixels().chunks(width).zip(image.pixels().chunks(width));
    let errors: Vec<f64> = rows.map(|(a, b)| a.iter().zip(b).map(squared).sum::<f64>() / width as f64).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (errors, mean)
}

#[test]
fn an_image_encoded_in_bands_has_no_seams() {
    // Soft shapes with the detail of a photograph: squares of 3 px.
    let small = picture();
    let pixel = |x: u32, y: u32| {
        let detail = ((x / 3 * 97 + y / 3 * 331).wrapping_mul(2_654_435_761) >> 24) as f32 / 255.0;
        small.pixels()[(y % 64 * 96 + x + y / 64) as usize].map(|value| 0.8 * value + 0.2 * detail)
    };
    let image = Image::from_fn(48, 640, pixel).unwrap();
    let settings = EncodeSettings::default().with(|s| s.target = EncodeTarget::Bytes(6000));
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let whole = encode(&cpu, &image, &settings, &|_| ()).block_on().unwrap();
    // The least memory, so the least height: bands of 214 rows.
    let bands = encode(&cpu, &image, &settings.with(|s| s.memory = 0), &|_| ()).block_on().unwrap();
    assert_ne!(bands.bytes, whole.bytes);
    assert!(bands.bytes.len() <= 6000 && (psnr(&bands.bytes, &image) - bands.psnr).abs() < 1e-3);
    // Each band learns its probabilities anew, which costs a tenth of so small a file.
    assert!(bands.psnr > whole.psnr - 2.5, "{} dB in bands, {} dB at once", bands.psnr, whole.psnr);
    let (errors, mean) = errors_of_rows(&bands.bytes, &image);
    for border in [213, 426] {
        let near = errors[border - 4..border + 4].iter().sum::<f64>() / 8.0;
        assert!(near < 2.0 * mean, "{near} near row {border}, {mean} in all");
    }
}

#[test]
fn a_third_of_a_progressive_file_is_a_file_of_that_size() {
    let (image, bytes) = (picture(), 1500);
    let plain = encoded(&image, EncodeTarget::Bytes(bytes * 32 / 100)).unwrap();
    let found = encoded_in(&image, EncodeTarget::Bytes(bytes), EncodeLayers::Progressive).unwrap();
    assert!(found.bytes.len() as u64 <= bytes && (psnr(&found.bytes, &image) - found.psnr).abs() < 1e-9);
    let third = &found.bytes[..found.bytes.len() / 3];
    let decoded = decode(third, Extent::Prefix).unwrap();
    assert_eq!(decoded.layers, (1, 2));
    assert_eq!(decoded.scene.means[..plain.gaussians], decode(&plain.bytes, Extent::Whole).unwrap().scene.means);
    assert!(found.psnr > plain.psnr + 3.0, "{} after {} dB", found.psnr, plain.psnr);
}

#[test]
fn a_quality_is_reached_with_few_bytes() {
    let image = picture();
    let [low, high] = [30.0, 36.0].map(|goal| {
        let found = encoded(&image, EncodeTarget::Psnr(goal)).unwrap();
        let psnr = psnr(&found.bytes, &image);
        assert!((goal..goal + 0.8).contains(&psnr), "{psnr} dB instead of {goal}");
        found.bytes.len()
    });
    assert!(low < high && high < 96 * 64 / 4, "{low} and {high} bytes");
    let [coarse, fine] = [20, 70].map(|q| encoded(&image, EncodeTarget::Quality(q)).unwrap());
    assert!(coarse.bytes.len() < fine.bytes.len() && coarse.psnr < fine.psnr);
}

#[test]
fn a_transparent_image_keeps_its_alpha_and_its_profile() {
    let (image, alpha) = disc();
    let (profile, bytes) = ([7; 100], 1600);
    let source = EncodeImage { image: &image, alpha: Some(&alpha), profile: &profile };
    let found = encoded(source, EncodeTarget::Bytes(bytes)).unwrap();
    assert!((1400..=bytes).contains(&(found.bytes.len() as u64)), "{}", found.bytes.len());
    let GsiFile { colors, alpha: shape, .. } = decode_gsi(&found.bytes, Extent::Whole).unwrap();
    let shape = shape.unwrap();
    assert_eq!(colors.profile.as_ref().unwrap().bytes(), profile);
    assert_eq!(colors.scene.means.len() + shape.scene.means.len(), found.gaussians);

    // The PSNR is that of four channels.
    let grey = Image::from_pixels(96, 64, alpha.iter().map(|&alpha| [alpha; 3]).collect()).unwrap();
    let (drawn, drawn_alpha) = (rendered(&colors), rendered(&shape));
    let error = |drawn: &Image, image: &Image| mse_of_psnr(l1_and_psnr(drawn, image).unwrap().1);
    let both = 0.75 * error(&drawn, &premultiplied(&image, &alpha).unwrap()) + 0.25 * error(&drawn_alpha, &grey);
    assert!((found.psnr - psnr_of_mse(both)).abs() < 1e-9 && found.psnr > 30.0, "{} dB", found.psnr);
    let (colors, alpha) = straight(drawn, &drawn_alpha).unwrap();
    let off = colors.pixel(48, 20).iter().zip(image.pixel(48, 20)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off < 0.1 && alpha[0] == 0.0 && alpha[32 * 96 + 48] > 0.97, "{off} {:?}", alpha[32 * 96 + 48]);

    let opaque = EncodeImage { image: &image, alpha: Some(&vec![1.0; 96 * 64]), profile: &[] };
    let [opaque, plain] = [opaque, (&image).into()].map(|image| encoded(image, EncodeTarget::Bytes(300)).unwrap());
    assert!(opaque.bytes == plain.bytes);
}

#[test]
fn a_transparent_image_is_not_encoded_in_bands() {
    let (image, alpha) = disc();
    let source = EncodeImage { image: &image, alpha: Some(&alpha), profile: &[] };
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let settings = EncodeSettings::default().with(|s| (s.target, s.memory) = (EncodeTarget::Bytes(900), 60_500_000));
    let refused = encode(&cpu, source, &settings, &|_| ()).block_on().unwrap_err().to_string();
    assert!(refused.contains("transparent image is 60500000 of the 60") && refused.contains("bands"), "{refused}");
    // An opaque one is.
    encode(&cpu, &image, &settings, &|_| ()).block_on().unwrap();
}

#[test]
fn qualities_hold_for_alpha_and_a_beginning_shows_both() {
    let (image, alpha) = disc();
    let source = EncodeImage { image: &image, alpha: Some(&alpha), profile: &[] };
    let psnr = 36.0;
    let found = encoded_in(source, EncodeTarget::Psnr(psnr), EncodeLayers::Preview).unwrap();
    let GsiFile { colors, alpha: shape, .. } = decode_gsi(&found.bytes, Extent::Whole).unwrap();
    let grey = Image::from_pixels(96, 64, alpha.iter().map(|&alpha| [alpha; 3]).collect()).unwrap();
    for (drawn, image) in [(&colors, &premultiplied(&image, &alpha).unwrap()), (&shape.unwrap(), &grey)] {
        let (_, found) = l1_and_psnr(&rendered(drawn), image).unwrap();
        assert!((psnr..psnr + 2.0).contains(&found), "{found} dB");
    }
    let preview = decode_gsi(&found.bytes[..300], Extent::Prefix).unwrap();
    assert_eq!(preview.layers, (2, 4));
    let (_, found) = l1_and_psnr(&rendered(&preview.alpha.unwrap()), &grey).unwrap();
    assert!(found > 15.0, "{found} dB");
}

#[test]
fn flat_and_tiny_images_are_encoded() {
    let flat = Image::filled(200, 150, [100.0 / 255.0; 3]).unwrap();
    let found = encoded(&flat, EncodeTarget::Bytes(200)).unwrap();
    assert!(found.bytes.len() <= 200 && found.psnr > 70.0, "{} dB", found.psnr);
    let tiny = Image::from_fn(3, 2, |x, y| [x as f32 / 2.0, y as f32, 0.5]).unwrap();
    let found = encoded(&tiny, EncodeTarget::Bytes(150)).unwrap();
    assert!(found.bytes.len() <= 150 && found.psnr > 15.0, "{} dB", found.psnr);
}

#[test]
fn impossible_targets_are_refused() {
    let image = Image::filled(8, 8, [0.5; 3]).unwrap();
    for target in [EncodeTarget::Bytes(10), EncodeTarget::Psnr(f64::NAN), EncodeTarget::Quality(0)] {
        assert!(matches!(encoded(&image, target), Err(Error::Core(gs_core::Error::Setting { .. }))), "{target:?}");
    }
    let source = |alpha| EncodeImage { image: &image, alpha: Some(alpha), profile: &[] };
    let wrong = encoded(source(&[2.0; 64]), EncodeTarget::Quality(9));
    assert!(matches!(wrong, Err(Error::Core(gs_core::Error::Setting { .. }))), "{wrong:?}");
    let short = encoded(source(&[0.5]), EncodeTarget::Quality(9));
    assert!(matches!(short, Err(Error::Core(gs_core::Error::Length { .. }))), "{short:?}");
    let mut state = 1u32;
    let noise: Vec<u8> = std::iter::repeat_with(|| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    })
    .take(900)
    .collect();
    let full = EncodeImage { profile: &noise, ..(&image).into() };
    let message = encoded(full, EncodeTarget::Bytes(900)).unwrap_err().to_string();
    assert!(message.starts_with("a size of 900 bytes"), "{message}");
}
