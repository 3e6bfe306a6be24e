//! The image that a loss compares with.

use std::{ops::Range, sync::OnceLock};

use gs_core::{Error, Loss, TargetImage, check_same_size, math, memory, to_8_bits};
use rayon::prelude::*;

use crate::{
    lanes::LANES,
    layout::{Grid, Row, ScalarRow},
    unsupported::BACKEND,
};

/// [`Row`] in 8 bits.
type Levels = [[u8; LANES]; 3];

/// An image that a loss compares with, in strips.
#[derive(Debug, Default)]
pub struct Target {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// The colours; empty where they are in `levels`.
    pub(crate) rows: Vec<Row>,
    /// The colours of a compact target in 8 bits.
    levels: Vec<Levels>,
    /// [`TargetImage::coverage`] of each pixel, 1 in lanes beyond the image; empty without alpha
    /// and mask.
    coverage: Vec<ScalarRow>,
    /// How much each pixel counts, 1 in lanes beyond the image; empty where all count the same.
    pub(crate) weights: Vec<ScalarRow>,
    /// Whether `blurred` is kept, rather than computed in each pass.
    pub(crate) keeps_blurred: bool,
    /// The terms of D-SSIM that depend on the target alone, computed when first needed.
    pub(crate) blurred: OnceLock<BlurredTarget>,
}

impl Target {
    pub(crate) fn new(target: &TargetImage<'_>) -> Result<Self, Error> {
        target.validate()?;
        let (width, height) = target.image.size();
        let grid = Grid::new((width, height), 1);
        let coverage = scalars(&grid, target.coverage().as_deref(), "a target's alpha and mask")?;
        let weights = scalars(&grid, target.weights, "a target's weights")?;
        let (mut rows, mut levels) = (grid.strips_of(target.image)?, Vec::new());
        if target.compact && target.is_8_bit() {
            levels = memory::reserved(rows.len(), "a target")?;
            levels.extend(rows.iter().map(|Row(channels)| channels.map(|values| values.map(to_8_bits))));
            rows = Vec::new();
        }
        let (keeps_blurred, blurred) = (!target.compact, OnceLock::new());
        Ok(Self { width, height, rows, levels, coverage, weights, keeps_blurred, blurred })
    }

    /// Whether `rows` are what the rendering is compared with: the target has no alpha, no mask and
    /// no colours in 8 bits.
    pub(crate) fn is_complete(&self) -> bool {
        self.coverage.is_empty() && self.levels.is_empty()
    }

    /// Writes the target that the rendering is compared with into `completed`: in floats, blended
    /// with the background, and equal to the rendering where the mask excludes a pixel.
    pub(crate) fn complete(&self, background: [f32; 3], rendered: &[Row], completed: &mut Self) -> Result<(), Error> {
        (completed.width, completed.height) = (self.width, self.height);
        memory::resize(&mut completed.rows, rendered.len(), Row::ZERO, "a target")?;
        completed.rows.par_iter_mut().zip(rendered).enumerate().for_each(|(index, (Row(out), Row(c)))| {
            *out = match self.levels.get(index) {
                Some(levels) => levels.map(|levels| levels.map(|level| f32::from(level) / 255.0)),
                None => self.rows[index].0,
            };
            let Some(ScalarRow(coverage)) = self.coverage.get(index) else { return };
            for k in 0..3 {
                out[k] = std::array::from_fn(|i| math::completed(out[k][i], coverage[i], background[k], c[k][i]));
            }
        });
        Ok(())
    }

    /// The weights of these rows; empty where all pixels count the same.
    pub(crate) fn weights_of(&self, rows: Range<usize>) -> &[ScalarRow] {
        if self.weights.is_empty() { &[] } else { &self.weights[rows] }
    }

    /// Fails where the loss cannot be computed, or where the target's weights cannot be factors of
    /// it.
    pub(crate) fn check_loss(&self, loss: Loss) -> Result<(), Error> {
        loss.check_weights(BACKEND, !self.weights.is_empty())
    }

    /// Fails unless the target has this size.
    pub(crate) fn check_size(&self, size: (u32, u32)) -> Result<(), Error> {
        check_same_size(size, (self.width, self.height))
    }
}

/// One number per pixel, in strips; lanes beyond the image are 1. Empty for `None`.
fn scalars(grid: &Grid, of_pixels: Option<&[f32]>, what: &'static str) -> Result<Vec<ScalarRow>, Error> {
    let mut rows = Vec::new();
    let Some(of_pixels) = of_pixels else { return Ok(rows) };
    memory::resize(&mut rows, grid.rows(), ScalarRow([1.0; LANES]), what)?;
    for (line, of_line) in of_pixels.chunks_exact(grid.width).enumerate() {
        for (strip, values) in of_line.chunks(LANES).enumerate() {
            rows[strip * grid.height + line].0[..values.len()].copy_from_slice(values);
        }
    }
    Ok(rows)
}

/// What D-SSIM needs of a target y: y, b(y) and b(y²), where b is the blur.
///
/// Each holds one channel after the other, row by row: the order in which a band reads them.
#[derive(Debug, Default)]
pub(crate) struct BlurredTarget {
    pub(crate) y: Vec<ScalarRow>,
    pub(crate) mean: Vec<ScalarRow>,
    pub(crate) square: Vec<ScalarRow>,
}
