//! Planes of one number per pixel, and how they are smoothed.

use rayon::prelude::*;

/// Least number of rows per parallel task.
const ROWS_PER_TASK: usize = 16;

/// One number per pixel, row-major, `[H, W]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl Plane {
    /// A plane whose row `y` is written by `row(y, values)`, in parallel.
    pub fn from_rows(width: u32, height: u32, row: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let (width, height) = (width as usize, height as usize);
        let mut values = vec![0.0; width * height];
        let rows = values.par_chunks_exact_mut(width.max(1)).with_min_len(ROWS_PER_TASK);
        rows.enumerate().for_each(|(y, values)| row(y, values));
        Self { width, height, values }
    }

    /// All values, row-major.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Size as (columns, rows).
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    /// Makes `fraction` (0..=1) of the sum uniform and scales the rest. A plane of zeros stays one.
    pub fn mix_uniform(&mut self, fraction: f32) {
        let sum: f64 = self.values.chunks(512).map(|block| f64::from(block.iter().sum::<f32>())).sum();
        let uniform = (sum / self.values.len().max(1) as f64) as f32 * fraction;
        self.values.iter_mut().for_each(|v| *v = *v * (1.0 - fraction) + uniform);
    }

    /// Smooths with the binomial kernel (1, 2, 1)/4 along both axes, `passes` times: close to a
    /// Gaussian of σ = √(passes/2) px. Border values are repeated outside the image, so that a
    /// constant stays constant.
    pub fn smooth(&mut self, passes: u32) {
        let width = self.width;
        if width == 0 {
            return;
        }
        // Three rows at work: a row is needed unsmoothed (vertically) after its place has been
        // overwritten.
        let mut above = vec![0.0; width];
        let mut here = vec![0.0; width];
        let mut below = vec![0.0; width];
        for _ in 0..passes {
            smooth_row(&self.values[..width], &mut here);
            above.copy_from_slice(&here);
            for y in 0..self.height {
                let next = (y + 1).min(self.height - 1);
                if next == y {
                    below.copy_from_slice(&here);
                } else {
                    smooth_row(&self.values[next * width..][..width], &mut below);
                }
                let out = &mut self.values[y * width..][..width];
                for (((out, &a), &h), &b) in out.iter_mut().zip(&above).zip(&here).zip(&below) {
                    *out = 0.25 * (a + b) + 0.5 * h;
                }
                (above, here, below) = (here, below, above);
            }
        }
    }
}

fn smooth_row(row: &[f32], out: &mut [f32]) {
    let last = row.len() - 1;
    if last == 0 {
        out[0] = row[0];
        return;
    }
    out[0] = 0.75 * row[0] + 0.25 * row[1];
    for (out, w) in out[1..last].iter_mut().zip(row.windows(3)) {
        *out = 0.25 * (w[0] + w[2]) + 0.5 * w[1];
    }
    out[last] = 0.25 * row[last - 1] + 0.75 * row[last];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_spreads_a_point_and_keeps_its_sum() {
        let mut plane = Plane::from_rows(9, 7, |y, row| row[4] = if y == 3 { 16.0 } else { 0.0 });
        plane.smooth(1);
        let at = |p: &Plane, x: usize, y: usize| p.values()[y * 9 + x];
        assert_eq!([at(&plane, 4, 3), at(&plane, 5, 3), at(&plane, 4, 2), at(&plane, 3, 4)], [4.0, 2.0, 2.0, 1.0]);
        plane.smooth(2);
        assert!((plane.values().iter().sum::<f32>() - 16.0).abs() < 1e-4);
    }

    #[test]
    fn mixing_keeps_the_sum() {
        let mut plane = Plane::from_rows(4, 2, |y, row| row[0] = y as f32 * 8.0);
        plane.mix_uniform(0.5);
        assert_eq!(plane.values(), [0.5, 0.5, 0.5, 0.5, 4.5, 0.5, 0.5, 0.5]);
    }

    #[test]
    fn a_constant_stays_constant_at_any_size() {
        for (w, h) in [(1, 1), (1, 5), (5, 1), (2, 2), (17, 3)] {
            let mut plane = Plane::from_rows(w, h, |_, row| row.fill(0.5));
            plane.smooth(3);
            assert_eq!(plane.values(), vec![0.5; (w * h) as usize]);
        }
    }
}
