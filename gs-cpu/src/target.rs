//! The image that a loss compares with.

use std::sync::OnceLock;

use gs_core::{Error, TargetImage, math, memory};
use rayon::prelude::*;

use crate::{
    lanes::LANES,
    layout::{Grid, Row, ScalarRow},
};

/// An image that a loss compares with, in strips.
#[derive(Debug, Default)]
pub struct Target {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) rows: Vec<Row>,
    /// [`TargetImage::coverage`] of each pixel, 1 in lanes beyond the image; empty without alpha
    /// and mask.
    coverage: Vec<ScalarRow>,
    /// The terms of D-SSIM that depend on the target alone, computed when first needed.
    pub(crate) blurred: OnceLock<BlurredTarget>,
}

impl Target {
    pub(crate) fn new(target: &TargetImage<'_>) -> Result<Self, Error> {
        target.validate()?;
        let (width, height) = target.image.size();
        let grid = Grid::new((width, height), 1);
        let mut coverage = Vec::new();
        if let Some(of_pixels) = target.coverage() {
            memory::resize(&mut coverage, grid.rows(), ScalarRow([1.0; LANES]), "a target's alpha and mask")?;
            for (line, of_line) in of_pixels.chunks_exact(width as usize).enumerate() {
                for (strip, values) in of_line.chunks(LANES).enumerate() {
                    coverage[strip * grid.height + line].0[..values.len()].copy_from_slice(values);
                }
            }
        }
        Ok(Self { width, height, rows: grid.strips_of(target.image)?, coverage, blurred: OnceLock::new() })
    }

    /// Whether the target has neither alpha nor mask.
    pub(crate) fn is_complete(&self) -> bool {
        self.coverage.is_empty()
    }

    /// Writes a target without alpha and mask into `completed`: blended with the background, and
    /// equal to the rendering where the mask excludes a pixel.
    pub(crate) fn complete(&self, background: [f32; 3], rendered: &[Row], completed: &mut Self) -> Result<(), Error> {
        (completed.width, completed.height) = (self.width, self.height);
        memory::resize(&mut completed.rows, self.rows.len(), Row::ZERO, "a target")?;
        let inputs = self.rows.par_iter().zip(&self.coverage).zip(rendered);
        (completed.rows.par_iter_mut().zip(inputs)).for_each(|(Row(out), ((Row(y), ScalarRow(coverage)), Row(c)))| {
            for k in 0..3 {
                out[k] = std::array::from_fn(|i| math::completed(y[k][i], coverage[i], background[k], c[k][i]));
            }
        });
        Ok(())
    }

    /// Fails unless the target has this size.
    pub(crate) fn check_size(&self, (width, height): (u32, u32)) -> Result<(), Error> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        Err(Error::SizesDiffer {
            left_width: width,
            left_height: height,
            right_width: self.width,
            right_height: self.height,
        })
    }
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
