//! Flicker: how unevenly a pixel's colour changes over three successive frames, which distinguishes
//! a jump from motion.
//!
//! For frames with step h, the second difference f₋ − 2 f + f₊ of a smooth function is h² f″: half
//! the step leaves a quarter. A jump between two frames keeps its height, whatever the step. A
//! moving sharp edge makes each pixel that it crosses jump, so frames are averaged with SSIM's
//! window first: an edge that moves by a small part of the window changes the average evenly, while
//! an area that changes its colour at once does not. Averaging and differencing commute, so the
//! difference is averaged, once.
//!
//! Optical flow and reprojection, with which others remove motion (*compare* StopThePop, Radl et
//! al. 2024), are not needed.

use gs_core::{
    Error, Image,
    constants::{SSIM_SIGMA, SSIM_WINDOW},
};

/// Second differences of three frames, one for each position at which the window lies inside the
/// frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Flicker {
    width: u32,
    margin: u32,
    values: Vec<f32>,
}

/// The second difference of three successive frames, clamped to 0..=1, averaged with the window of
/// [`ssim`](gs_core::metrics::ssim()): at each pixel the mean magnitude over the channels. A jump
/// by J of a whole window gives J in the two triples that contain it.
pub(crate) fn flicker(frames: [&Image; 3]) -> Result<Flicker, Error> {
    let [before, now, after] = frames;
    now.same_size(before)?;
    now.same_size(after)?;
    let (width, height) = (now.width() as usize, now.height() as usize);
    let window = window(width.min(height));
    let side = window.len();
    let differences = second_differences([before, now, after].map(|image| image.pixels().as_flattened()));
    let columns = width + 1 - side;
    let (mut vertical, mut averaged) = (vec![0.0; 3 * width], vec![0.0; 3 * columns]);
    let mut values = Vec::with_capacity(columns * (height + 1 - side));
    for y in 0..height + 1 - side {
        average(&mut vertical, &window, |k| &differences[3 * width * (y + k)..]);
        average(&mut averaged, &window, |k| &vertical[3 * k..]);
        values.extend(averaged.as_chunks::<3>().0.iter().map(|[r, g, b]| (r.abs() + g.abs() + b.abs()) / 3.0));
    }
    Ok(Flicker { width: columns as u32, margin: side as u32 / 2, values })
}

/// f₋ − 2 f + f₊ of each number, clamped to 0..=1 first.
fn second_differences(frames: [&[f32]; 3]) -> Vec<f32> {
    let [before, now, after] = frames.map(|values| values.iter().map(|v| v.clamp(0.0, 1.0)));
    before.zip(now).zip(after).map(|((before, now), after)| before - 2.0 * now + after).collect()
}

/// SSIM's normalised window of [`SSIM_WINDOW`] weights; if that does not fit, of the largest odd
/// number ≤ `fit`.
fn window(fit: usize) -> Vec<f32> {
    let side = SSIM_WINDOW.min(fit - (fit + 1) % 2);
    let weight = |k: usize| (-0.5 * ((k as f32 - (side / 2) as f32) / SSIM_SIGMA).powi(2)).exp();
    let sum: f32 = (0..side).map(weight).sum();
    (0..side).map(|k| weight(k) / sum).collect()
}

/// Computes `out` = Σ weights[k] · rows(k), as far as `out` is long.
fn average<'a>(out: &mut [f32], weights: &[f32], rows: impl Fn(usize) -> &'a [f32]) {
    out.fill(0.0);
    for (k, weight) in weights.iter().enumerate() {
        out.iter_mut().zip(rows(k)).for_each(|(sum, value)| *sum += weight * value);
    }
}

impl Flicker {
    /// All values, row-major, NaN where a pixel is NaN. The window's margin is left out on each
    /// side.
    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    /// The mean of the squared values.
    pub(crate) fn mean_square(&self) -> f64 {
        self.values.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>() / self.values.len() as f64
    }

    /// The share of values above `level`, 0 to 1.
    pub(crate) fn share_above(&self, level: f32) -> f64 {
        self.values.iter().filter(|&&value| value > level).count() as f64 / self.values.len() as f64
    }

    /// Column and row of a value in the frame.
    pub(crate) fn position(&self, index: usize) -> (u32, u32) {
        let index = index as u32;
        (index % self.width + self.margin, index / self.width + self.margin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame with waves and a sharp edge that move by `speed` px per unit of time, and from time
    /// 0 on a square of 20 px that is lighter by `jump`.
    fn frame(time: f32, speed: f32, jump: f32) -> Image {
        Image::from_fn(64, 48, |x, y| {
            let along = x as f32 + 0.5 - speed * time;
            // Share of a pixel beyond the edge, as in an antialiased picture.
            let beyond = (along - 40.25).clamp(0.0, 1.0);
            let wave = 0.5 + 0.2 * (0.3 * along + 0.2 * y as f32).sin();
            let lighter = if time > 0.0 && (10..30).contains(&x) && (10..30).contains(&y) { jump } else { 0.0 };
            [wave * (1.0 - 0.4 * beyond) + lighter; 3]
        })
        .unwrap()
    }

    fn highest(step: f32, speed: f32, jump: f32) -> f32 {
        // The jump lies between the second frame and the third, whatever the step.
        let frames = [-1.5, -0.5, 0.5].map(|k| frame(k * step, speed, jump));
        flicker(frames.each_ref()).unwrap().values().iter().copied().fold(0.0, f32::max)
    }

    #[test]
    fn half_the_step_leaves_a_quarter_of_motion_and_all_of_a_jump() {
        let motion = [0.5, 0.25, 0.125].map(|step| highest(step, 0.8, 0.0));
        assert!(motion.is_sorted_by(|a, b| (3.0..5.0).contains(&(a / b))), "{motion:?}");
        let jump = [0.5, 0.25, 0.125].map(|step| highest(step, 0.8, 0.1));
        assert!(jump.iter().all(|height| (0.09..0.125).contains(height)), "{jump:?}");
        assert!((highest(1.0, 0.0, 0.1) - 0.1).abs() < 1e-5, "a jump alone is as high as it is");
        assert!(highest(1.0, 0.0, 0.0) == 0.0 && motion[2] < 0.002, "{motion:?}");
    }

    #[test]
    fn a_jump_is_found_where_it_is() {
        let frames = [-1.5, -0.5, 0.5].map(|time| frame(time, 0.0, 0.1));
        let found = flicker(frames.each_ref()).unwrap();
        assert_eq!(found.values().len(), 54 * 38);
        let jumped: Vec<(u32, u32)> =
            (0..found.values().len()).filter(|&i| found.values()[i] > 0.05).map(|i| found.position(i)).collect();
        assert_eq!((jumped[0], jumped[jumped.len() - 1]), ((11, 10), (28, 29)), "the corners are rounded off");
        assert!((found.share_above(0.05) - jumped.len() as f64 / (54.0 * 38.0)).abs() < 1e-9);
        // Only the border of a square this large is softened.
        let whole = 0.01 * 400.0 / (54.0 * 38.0);
        assert!((0.8 * whole..whole).contains(&found.mean_square()), "{} of {whole}", found.mean_square());
    }

    #[test]
    fn values_above_white_do_not_flicker_and_sizes_must_match() {
        let white = |level: f32| Image::filled(16, 12, [level; 3]).unwrap();
        let above = [white(1.0), white(1.7), white(1.2)];
        assert_eq!(flicker(above.each_ref()).unwrap().mean_square(), 0.0);
        let other = Image::filled(12, 16, [0.0; 3]).unwrap();
        assert!(matches!(flicker([&above[0], &above[1], &other]), Err(Error::SizesDiffer { .. })));
        let small = [0.0, 0.5, 0.0].map(|level| Image::filled(1, 2, [level; 3]).unwrap());
        assert_eq!(flicker(small.each_ref()).unwrap().values(), [1.0, 1.0], "a window of one pixel");
    }
}
