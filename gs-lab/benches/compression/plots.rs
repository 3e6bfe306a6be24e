//! The curves of quality over size, as SVG.

use std::{error::Error, fs, path::Path};

use gs_core::{counted, metrics::mean};
use gs_lab::report::line_chart;

use crate::{
    Set,
    codec::CODECS,
    curve::RateCurve,
    points::{Measure, OURS, Points, TUNED},
};

/// Points of the curve of a mean.
const PLACES: u32 = 24;

/// Writes a figure for each measure: of the mean of each set, and of each image.
pub(crate) fn write(points: &Points, sets: &[Set], folder: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(folder)?;
    for measure in Measure::ALL {
        for set in sets {
            let names: Vec<&str> = set.images.iter().map(|image| image.name.as_str()).collect();
            let title = format!("{}: mean of {}", set.name, counted(names.len(), "image"));
            let name = format!("mean-of-{}", set.name.to_lowercase().replace(' ', "-"));
            save(folder, &name, &title, measure, |format| mean_curve(points, &names, format, measure))?;
            for image in names {
                let curve =
                    |format: &str| points.curve(image, format, measure).map_or_else(Vec::new, |curve| line(&curve));
                save(folder, image, image, measure, curve)?;
            }
        }
    }
    Ok(())
}

fn save(
    folder: &Path,
    name: &str,
    title: &str,
    measure: Measure,
    curve: impl Fn(&str) -> Vec<(f64, f64)>,
) -> Result<(), Box<dyn Error>> {
    let formats = [OURS, TUNED].into_iter().chain(CODECS.iter().map(|codec| codec.name));
    let lines = formats.map(|format| (format, curve(format))).filter(|(_, points)| !points.is_empty());
    let unit = match measure {
        Measure::Psnr => "PSNR, dB",
        Measure::MsSsim => "MS-SSIM, −10·log₁₀(1 − MS-SSIM), dB",
        Measure::Ssimulacra2 => "SSIMULACRA2",
    };
    let file = folder.join(format!("{name}-{}.svg", measure.name().to_lowercase()));
    Ok(fs::write(file, line_chart(title, ["bits per pixel", unit], lines))?)
}

/// Places from 0.1 to 2 bits per pixel at which every image has a file.
fn mean_curve(points: &Points, images: &[&str], format: &str, measure: Measure) -> Vec<(f64, f64)> {
    let curves: Vec<RateCurve> = images.iter().filter_map(|image| points.curve(image, format, measure)).collect();
    if curves.is_empty() {
        return Vec::new();
    }
    let places = (0..=PLACES).map(|k| 0.1 * 20f64.powf(f64::from(k) / f64::from(PLACES)));
    let at = |bpp: f64| {
        let qualities: Option<Vec<f64>> = curves.iter().map(|curve| curve.quality_at(bpp)).collect();
        qualities.map(|qualities| (bpp, mean(qualities)))
    };
    places.filter_map(at).collect()
}

fn line(curve: &RateCurve) -> Vec<(f64, f64)> {
    let (low, high) = curve.range();
    let qualities = (0..=2 * PLACES).map(|k| low + (high - low) * f64::from(k) / f64::from(2 * PLACES));
    qualities.filter_map(|quality| Some((curve.bpp_at(quality)?, quality))).filter(|(bpp, _)| *bpp < 4.0).collect()
}
