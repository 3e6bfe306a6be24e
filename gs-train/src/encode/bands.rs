//! Bands of rows, so that an image of any size is encoded in a bounded amount of memory.
//!
//! Bands are fitted from the top to the bottom, each to what those above leave of the image. A band is
//! fitted with some rows of its neighbours, and keeps the Gaussians whose means lie above its end. What
//! the others would have drawn is left to the next band, so no seam is seen.

use std::ops::Range;

use glam::Vec2;
use gs_core::{Canvas, Image, Scene2d};
use gs_density::seed::gradient_magnitude;

use crate::{error::Error, memory::encoding_at_once};

/// Rows of its neighbours with which a band is fitted, on each side.
const OVERLAP: u32 = 64;

/// Least height of a band, rows.
const LEAST_ROWS: u32 = 256;

/// Rows that a band is fitted to at least, where the image has so many.
pub(crate) const LEAST_FITTED_ROWS: u32 = LEAST_ROWS + 2 * OVERLAP;

/// Share of the Gaussians that is spread evenly over the image; the others follow its gradient.
const EVEN_SHARE: f64 = 0.1;

/// A band of an image.
#[derive(Debug, Clone)]
pub(super) struct Band {
    /// Rows of the band.
    rows: Range<u32>,
    /// Rows that it is fitted to: those of the band and of the overlap.
    around: Range<u32>,
    width: u32,
    /// Share of the image's Gaussians.
    share: f64,
    is_last: bool,
}

/// The bands of an image that is encoded in about `memory` bytes.
pub(super) fn bands(image: &Image, memory: u64) -> Result<Vec<Band>, Error> {
    let (width, height) = image.size();
    let fitting = encoding_at_once((width, height), memory) / u64::from(width);
    let most = fitting.saturating_sub(2 * u64::from(OVERLAP)).max(u64::from(LEAST_ROWS));
    let count = if fitting >= u64::from(height) { 1 } else { u64::from(height).div_ceil(most) as u32 };
    let border = |k: u32| (u64::from(height) * u64::from(k) / u64::from(count)) as u32;
    let mut bands: Vec<Band> = (0..count)
        .map(|k| {
            let rows = border(k)..border(k + 1);
            let around = rows.start.saturating_sub(OVERLAP)..(rows.end + OVERLAP).min(height);
            Band { rows, around, width, share: 1.0, is_last: k + 1 == count }
        })
        .collect();
    if count > 1 {
        let edges =
            bands.iter().map(|band| Ok(gradient(&band.part_of(image)?))).collect::<Result<Vec<f64>, Error>>()?;
        let all: f64 = edges.iter().sum();
        for (band, edges) in bands.iter_mut().zip(edges) {
            let even = f64::from(band.rows.end - band.rows.start) / f64::from(height);
            let following = if all > 0.0 { edges / all } else { even };
            band.share = EVEN_SHARE * even + (1.0 - EVEN_SHARE) * following;
        }
    }
    Ok(bands)
}

/// Sum of the magnitudes of luminance's gradient.
fn gradient(image: &Image) -> f64 {
    gradient_magnitude(image).values().iter().map(|&value| f64::from(value)).sum()
}

impl Band {
    /// What shows the rows that the band is fitted to.
    pub(super) fn canvas(&self) -> Canvas {
        let height = self.around.end - self.around.start;
        let extent = Vec2::new(self.width as f32, height as f32);
        Canvas::new(self.width, height).showing(self.origin(), extent)
    }

    /// The number of Gaussians to fit the band with, of `all` of the image: its share, and what it
    /// leaves to the next band.
    pub(super) fn count(&self, all: u32) -> u32 {
        let [rows, with_next] = [self.rows.end, self.around.end].map(|end| f64::from(end - self.rows.start));
        (f64::from(all) * self.share * with_next / rows).round().max(1.0) as u32
    }

    /// Number of pixels without the overlap.
    pub(super) fn pixels(&self) -> f64 {
        f64::from(self.rows.end - self.rows.start) * f64::from(self.width)
    }

    /// These rows of the whole image, with the overlap.
    pub(super) fn with_overlap(&self, image: &Image) -> Result<Image, Error> {
        rows(image, &self.around)
    }

    /// The numbers of these rows of the whole image, with the overlap.
    pub(super) fn numbers_of<'a>(&self, numbers: &'a [f32]) -> &'a [f32] {
        let [start, end] = [self.around.start, self.around.end].map(|row| row as usize * self.width as usize);
        &numbers[start..end]
    }

    /// These rows of the whole image.
    pub(super) fn part_of(&self, image: &Image) -> Result<Image, Error> {
        rows(image, &self.rows)
    }

    /// An image without the overlap that it has.
    pub(super) fn without_overlap(&self, image: &Image) -> Result<Image, Error> {
        let [start, end] = [self.rows.start, self.rows.end].map(|row| row - self.around.start);
        rows(image, &(start..end))
    }

    /// Splits the scene of a fit to these rows into what the band keeps and what it leaves to the next
    /// band, both in coordinates of the whole image.
    pub(super) fn split(&self, scene: &Scene2d) -> (Scene2d, Scene2d) {
        let end = if self.is_last { f32::INFINITY } else { self.rows.end as f32 };
        let moved = scene.iter().map(|mut gaussian| {
            gaussian.mean += self.origin();
            gaussian
        });
        let (kept, left): (Vec<_>, Vec<_>) = moved.partition(|gaussian| gaussian.mean.y < end);
        (kept.into_iter().collect(), left.into_iter().collect())
    }

    fn origin(&self) -> Vec2 {
        Vec2::new(0.0, self.around.start as f32)
    }
}

/// Some rows of an image.
fn rows(image: &Image, rows: &Range<u32>) -> Result<Image, Error> {
    let width = image.width() as usize;
    let [start, end] = [rows.start, rows.end].map(|row| row as usize * width);
    Ok(Image::from_pixels(image.width(), rows.end - rows.start, image.pixels()[start..end].to_vec())?)
}
