//! The tables of the report.

use std::error::Error;

use gs_codec::Extent;
use gs_core::metrics::{l1_and_psnr, mean};
use gs_cpu::CpuRasterizer;
use gs_train::{EncodeLayers, EncodeSettings, EncodeTarget, Encoded, encode};
use pollster::FutureExt as _;

use crate::{
    Set,
    codec::CODECS,
    images::BenchImage,
    measure::{print_columns, print_row, print_section},
    points::{Measure, OURS, Point, Points, TUNED, rendered},
};

/// Sizes that count for Bjøntegaard rates, bits per pixel.
const RANGE: std::ops::RangeInclusive<f64> = 0.1..=2.0;

/// Published results on all 24 Kodak images: method, bits per pixel, PSNR in dB.
const PUBLISHED: [(&str, f64, f64); 2] = [("GaussianImage", 1.00, 29.7), ("GaussianImage++", 1.08, 31.1)];

/// Means over the images of a set, for each size of our files.
pub(crate) fn files_by_size(points: &Points, set: &Set, format: &str, sizes: &[f64]) {
    print_section(&format!("Files of these sizes, {format}"));
    print_columns(&[
        "bits per pixel",
        "PSNR, dB",
        "MS-SSIM",
        "SSIMULACRA2",
        "encoding, s",
        "decoding, ms",
        "decoding to pixels, ms",
    ]);
    for (place, _) in sizes.iter().enumerate() {
        let of: Vec<&Point> =
            set.images.iter().filter_map(|image| points.of(&image.name, format).get(place).copied()).collect();
        let time = |k: usize| mean(of.iter().filter_map(|p| p.own.as_ref()).map(|own| own.seconds[k]));
        print_row(&[
            format!("{:.3}", mean(of.iter().map(|p| p.bpp))),
            format!("{:.2}", mean(of.iter().map(|p| p.quality.psnr))),
            format!("{:.4}", mean(of.iter().filter_map(|p| p.quality.ms_ssim))),
            format!("{:.1}", mean(of.iter().map(|p| p.ssimulacra2))),
            format!("{:.1}", time(0)),
            format!("{:.1}", time(1) * 1e3),
            format!("{:.1}", time(2) * 1e3),
        ]);
    }
}

/// Sizes at equal quality: for each image and their mean.
pub(crate) fn rates(points: &Points, set: &Set) {
    for measure in Measure::ALL {
        print_section(&format!("Size at equal {}", measure.name()));
        println!("Bjøntegaard rate (PCHIP) over the sizes from 0.1 to 2 bits per pixel.\n");
        table(set, |image, ours, theirs| {
            let [ours, theirs] = [ours, theirs].map(|format| points.curve(&image.name, format, measure));
            ours?.bd_rate(&theirs?, RANGE)
        });
    }
    print_section("Size at equal PSNR, over all sizes");
    println!("Sizes interpolated linearly over the whole common range of PSNR, as in earlier records.\n");
    table(set, |image, ours, theirs| {
        let [ours, theirs] = [ours, theirs].map(|format| by_psnr(&points.of(&image.name, format)));
        linear_rate(&ours, &theirs)
    });
}

/// The rates of an image from the names of our format and of another: of each image for [`OURS`], and
/// the means for both.
fn table(set: &Set, rate: impl Fn(&BenchImage, &str, &str) -> Option<f64>) {
    let names = CODECS.each_ref().map(|codec| codec.name);
    print_columns(&[&["image"][..], &names.map(|name| if name == "JPEG" { "against JPEG" } else { name })].concat());
    for image in &set.images {
        let rates = names.map(|name| per_cent(rate(image, OURS, name)));
        print_row(&[&[image.name.clone()][..], &rates].concat());
    }
    for (ours, label) in [(OURS, "mean"), (TUNED, "mean, --tune ssim")] {
        let means = names.map(|name| {
            let rates: Vec<f64> = set.images.iter().filter_map(|image| rate(image, ours, name)).collect();
            per_cent((!rates.is_empty()).then(|| mean(rates.iter().map(|rate| rate.ln_1p())).exp_m1()))
        });
        print_row(&[&[label.to_owned()][..], &means].concat());
    }
}

/// (PSNR, ln of the size), by PSNR.
fn by_psnr(points: &[&Point]) -> Vec<(f64, f64)> {
    let mut curve: Vec<(f64, f64)> = points.iter().map(|p| (p.quality.psnr, p.bpp.ln())).collect();
    curve.sort_by(|a, b| a.0.total_cmp(&b.0));
    curve
}

/// The mean ratio of sizes less 1, by linear interpolation over the common range.
fn linear_rate(a: &[(f64, f64)], b: &[(f64, f64)]) -> Option<f64> {
    let low = a.first()?.0.max(b.first()?.0);
    let high = a.last()?.0.min(b.last()?.0);
    let at = |curve: &[(f64, f64)], psnr: f64| {
        let after = curve.partition_point(|&(known, _)| known < psnr).clamp(1, curve.len() - 1);
        let [(from, start), (to, end)] = [curve[after - 1], curve[after]];
        start + (end - start) * (psnr - from) / (to - from)
    };
    let steps = 200;
    let psnr = |k: u32| low + (high - low) * (f64::from(k) + 0.5) / f64::from(steps);
    (high > low).then(|| mean((0..steps).map(|k| at(a, psnr(k)) - at(b, psnr(k)))).exp_m1())
}

fn per_cent(rate: Option<f64>) -> String {
    rate.map_or("–".to_owned(), |rate| format!("{:+.1} %", 100.0 * rate))
}

/// Our PSNR at the sizes of published results.
pub(crate) fn published(points: &Points, kodak: &Set) {
    print_section("Published Gaussian codecs");
    println!("Theirs are means over all 24 Kodak images; ours are interpolated between files.\n");
    print_columns(&["method", "bits per pixel", "PSNR, dB", "gsi, dB", "difference, dB"]);
    for (name, bpp, psnr) in PUBLISHED {
        let curves = kodak.images.iter().filter_map(|image| points.curve(&image.name, OURS, Measure::Psnr));
        let ours: Vec<f64> = curves.filter_map(|curve| curve.quality_at(bpp)).collect();
        let of_ours = |what: &dyn Fn(f64) -> String| {
            if ours.is_empty() { "–".to_owned() } else { what(mean(ours.iter().copied())) }
        };
        let (found, difference) =
            (of_ours(&|ours| format!("{ours:.2}")), of_ours(&|ours| format!("{:+.2}", ours - psnr)));
        print_row(&[name.to_owned(), format!("{bpp:.2}"), format!("{psnr:.1}"), found, difference]);
    }
}

/// Size of the progressive files, bits per pixel.
const PROGRESSIVE: f64 = 1.2;

/// What a progressive file is worth, whole and cut to a third of its bytes, against files of the same
/// sizes that are not progressive.
pub(crate) fn prefixes(points: &Points, rasterizer: &CpuRasterizer, sets: &[Set]) -> Result<(), Box<dyn Error>> {
    print_section("Progressive files, and the first third of their bytes");
    println!("The PSNR of a plain file of each size is interpolated between files.\n");
    print_columns(&["image", "bits per pixel", "PSNR, dB", "less than plain, dB", "encoding, s"]);
    let mut less: [Vec<f64>; 2] = Default::default();
    for image in sets.iter().flat_map(|set| &set.images) {
        let pixels = image.image.pixels().len() as f64;
        let settings = EncodeSettings::default().with(|s| {
            s.target = EncodeTarget::Bytes((PROGRESSIVE * pixels / 8.0) as u64);
            s.layers = EncodeLayers::Progressive;
        });
        let Encoded { bytes, seconds, .. } = encode(rasterizer, &image.image, &settings, &|_| ()).block_on()?;
        let curve = points.curve(&image.name, OURS, Measure::Psnr);
        for (part, less) in [&bytes[..], &bytes[..bytes.len() / 3]].into_iter().zip(&mut less) {
            let picture = rendered(rasterizer, part, Extent::Prefix)?;
            let (bpp, psnr) = (part.len() as f64 * 8.0 / pixels, l1_and_psnr(&picture, &image.image)?.1);
            let loss = curve.as_ref().and_then(|curve| curve.quality_at(bpp)).map(|plain| plain - psnr);
            less.extend(loss);
            let loss = loss.map_or("–".to_owned(), |loss| format!("{loss:.2}"));
            print_row(&[image.name.clone(), format!("{bpp:.3}"), format!("{psnr:.2}"), loss, format!("{seconds:.1}")]);
        }
    }
    let [whole, third] = less.map(|less| if less.is_empty() { f64::NAN } else { mean(less) });
    println!("\nMean loss: {whole:.2} dB of the whole files, {third:.2} dB of the thirds.");
    Ok(())
}
