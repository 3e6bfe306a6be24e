//! Looks at photographs that have no pose: whether they are dark, blurred or all alike.

use std::collections::BTreeSet;

use gs_core::Image;

use crate::input::photographs::{Photograph, Photographs};

/// Photographs with a pose that those without are compared with.
const COMPARED: usize = 12;

/// The most photographs without a pose that are looked at.
const LOOKED_AT: usize = 40;

/// Columns of the small copies that are looked at.
const WIDTH: u32 = 480;

/// Share of the usual sharpness below which a photograph is blurred.
const BLURRED: f64 = 0.3;

/// Mean brightness below which a photograph is dark, and difference of two that are alike; of 1.
const DARK: f64 = 0.03;
const ALIKE: f64 = 0.004;

const FAULT_DARK: &str = "it is dark";
const FAULT_BLURRED: &str = "it is blurred";

/// What was found.
#[derive(Debug, Default)]
pub(crate) struct Inspection {
    faults: Vec<(String, &'static str)>,
}

impl Inspection {
    /// Looks at the `missing` photographs, and compares them with some of those that have poses.
    pub(crate) fn of(photographs: &Photographs, registered: &BTreeSet<String>, missing: &[&Photograph]) -> Self {
        if missing.is_empty() {
            return Self::default();
        }
        let good: Vec<&Photograph> =
            photographs.files.iter().filter(|photograph| registered.contains(&photograph.name)).collect();
        let step = good.len().div_ceil(COMPARED).max(1);
        let mut usual: Vec<f64> =
            good.iter().step_by(step).filter_map(|photograph| Some(Grey::read(photograph)?.sharpness())).collect();
        usual.sort_by(f64::total_cmp);
        let usual = usual.get(usual.len() / 2).copied().unwrap_or(0.0);
        let fault = |photograph: &Photograph| {
            let grey = Grey::read(photograph)?;
            match () {
                () if grey.mean() < DARK => Some(FAULT_DARK),
                () if grey.sharpness() < BLURRED * usual => Some(FAULT_BLURRED),
                () => None,
            }
        };
        let looked_at = missing.iter().take(LOOKED_AT);
        Self {
            faults: looked_at.filter_map(|photograph| Some((photograph.name.clone(), fault(photograph)?))).collect(),
        }
    }

    /// What is wrong with a photograph.
    pub(crate) fn fault(&self, name: &str) -> Option<&'static str> {
        self.faults.iter().find(|(of, _)| of == name).map(|(_, fault)| *fault)
    }

    pub(crate) fn dark(&self) -> usize {
        self.faults.iter().filter(|(_, fault)| *fault == FAULT_DARK).count()
    }

    pub(crate) fn blurred(&self) -> usize {
        self.faults.iter().filter(|(_, fault)| *fault == FAULT_BLURRED).count()
    }
}

/// Why no pose at all was found for the photographs, and what to do.
pub(crate) fn why_none(photographs: &Photographs, mean_features: f64) -> String {
    let step = photographs.files.len().div_ceil(COMPARED).max(1);
    let looked_at: Vec<Grey> = photographs.files.iter().step_by(step).filter_map(Grey::read).collect();
    if !looked_at.is_empty() && looked_at.iter().all(|grey| grey.mean() < DARK) {
        return "the photographs are dark: take them with more light".to_owned();
    }
    if looked_at.len() > 1 && looked_at.windows(2).all(|pair| pair[0].difference(&pair[1]) < ALIKE) {
        return "the photographs all show the same view: move the camera between them, by a step or an arm's length"
            .to_owned();
    }
    if mean_features < 300.0 {
        return format!(
            "the photographs have only {mean_features:.0} features on average: they are blurred, or show little texture"
        );
    }
    "too few of the photographs match: they must show one place, and each must overlap the next by two thirds from another \
     standpoint"
        .to_owned()
}

/// A small grey copy of a photograph.
#[derive(Debug)]
pub(crate) struct Grey {
    width: usize,
    values: Vec<f32>,
}

impl Grey {
    /// The copy; `None` for a photograph that cannot be read.
    fn read(photograph: &Photograph) -> Option<Self> {
        let image = gs_io::read_image(&photograph.path).ok()?.image;
        Some(Self::of(&image))
    }

    /// A copy by the brightness of its pixels, 0 to 255.
    pub(crate) fn from_bytes(width: usize, pixels: &[u8]) -> Self {
        Self { width, values: pixels.iter().map(|value| f32::from(*value) / 255.0).collect() }
    }

    /// The means of squares of pixels.
    pub(crate) fn of(image: &Image) -> Self {
        let side = image.width().div_ceil(WIDTH).max(1);
        let (columns, rows) = ((image.width() / side).max(1), (image.height() / side).max(1));
        let side_of = |side: u32, limit: u32| side.min(limit);
        let cell = |column: u32, row: u32| {
            let (w, h) = (side_of(side, image.width()), side_of(side, image.height()));
            let sum: f32 = (0..h)
                .map(|y| {
                    let from = (column * side) as usize;
                    let pixels = &image.row(row * side + y)[from..from + w as usize];
                    pixels.iter().map(|[r, g, b]| 0.3 * r + 0.59 * g + 0.11 * b).sum::<f32>()
                })
                .sum();
            sum / (w * h) as f32
        };
        let values = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))).map(|(c, r)| cell(c, r));
        Self { width: columns as usize, values: values.collect() }
    }

    pub(crate) fn mean(&self) -> f64 {
        self.values.iter().map(|value| f64::from(*value)).sum::<f64>() / self.values.len().max(1) as f64
    }

    /// Variance of the Laplacian over that of the brightness: high for sharp images, whatever their
    /// contrast.
    pub(crate) fn sharpness(&self) -> f64 {
        let (width, mean) = (self.width, self.mean());
        let variance = self.values.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>();
        let height = self.values.len() / width.max(1);
        let at = |x: usize, y: usize| f64::from(self.values[y * width + x]);
        let mut sum = 0.0;
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let laplacian = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) - 4.0 * at(x, y);
                sum += laplacian * laplacian;
            }
        }
        sum / variance.max(1e-9)
    }

    /// Mean difference of two copies; infinite for different sizes.
    pub(crate) fn difference(&self, other: &Self) -> f64 {
        if self.values.len() != other.values.len() {
            return f64::INFINITY;
        }
        let sum: f64 = self.values.iter().zip(&other.values).map(|(a, b)| f64::from((a - b).abs())).sum();
        sum / self.values.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stripes(period: f32, contrast: f32) -> Grey {
        let value = |x: u32| 0.5 + contrast * (x as f32 * std::f32::consts::TAU / period).sin();
        Grey::of(&Image::from_fn(200, 50, |x, _| [value(x); 3]).unwrap())
    }

    #[test]
    fn sharpness_does_not_depend_on_contrast() {
        let (sharp, soft) = (stripes(6.0, 0.4).sharpness(), stripes(24.0, 0.4).sharpness());
        assert!(sharp > 10.0 * soft && soft > 0.0);
        assert!((stripes(6.0, 0.1).sharpness() / sharp - 1.0).abs() < 0.01);
        assert!(stripes(6.0, 0.4).difference(&stripes(6.0, 0.4)) < 1e-9);
        assert!(stripes(6.0, 0.4).difference(&stripes(24.0, 0.4)) > ALIKE);
    }

    #[test]
    fn copies_are_small_and_keep_the_mean() {
        let image = Image::from_fn(2000, 1000, |x, _| [if x < 1000 { 0.0 } else { 1.0 }; 3]).unwrap();
        let grey = Grey::of(&image);
        assert!((grey.width, grey.values.len()) == (400, 400 * 200) && (grey.mean() - 0.5).abs() < 1e-3);
        assert_eq!(Grey::of(&Image::filled(1, 1, [0.25; 3]).unwrap()).values.len(), 1);
    }
}
