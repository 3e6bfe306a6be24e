//! What an examination needs of the two kinds of scenes.

use glam::Vec3;

use super::finding::{EXTREME_COLOR, Finding, NEEDLE_ASPECT, OUT_OF_RANGE_LOGIT, SMALLEST_LOG_SCALE};
use crate::{
    constants::{ALPHA_CUT, MIN_DETERMINANT_PX4, MIN_QUATERNION_NORM2},
    scene::{Scene, Scene2d, Scene3d, sigmoid},
};

/// A scene that can be examined and repaired: [`Scene2d`] and [`Scene3d`]. Its methods are those that
/// [`examine`](super::examine) and [`repair`](super::repair) need.
pub trait Examinable: Scene {
    /// Reports the findings about Gaussian `index` that do not depend on the others.
    fn examine_one(&self, index: usize, found: &mut dyn FnMut(Finding));

    /// Mean of Gaussian `index`; the third coordinate of a 2D mean is 0.
    fn place(&self, index: usize) -> Vec3;

    /// Mean, ln-scales and rotation as bits that are equal where the values are; padded with 0.
    fn shape_bits(&self, index: usize) -> [u32; 10];

    /// The ln-scales and the opacity logit of Gaussian `index` of a 3D scene; `None` in 2D, whose files
    /// are written by this project alone.
    fn stored(&self, index: usize) -> Option<([f32; 3], f32)>;

    /// Raises the scales of Gaussian `index` that are 0.
    fn widen(&mut self, index: usize);

    /// Removes the Gaussians whose entry in `keep`, `[N]`, is false.
    fn retain(&mut self, keep: &[bool]);
}

impl Examinable for Scene2d {
    fn examine_one(&self, index: usize, found: &mut dyn FnMut(Finding)) {
        let g = self.gaussian(index);
        let finite = g.mean.is_finite();
        found_if(!finite, Finding::MeanNotFinite, found);
        found_if(!g.rotation.is_finite(), Finding::RotationNotFinite, found);
        let mean = g.mean.abs().max_element();
        let (long, short) = (g.log_scale.max_element(), g.log_scale.min_element());
        if scales_are_sound(&g.log_scale.to_array(), found) && finite {
            let det = (2.0 * (long + short)).exp();
            found_if(long.exp() < spacing(mean) || det < MIN_DETERMINANT_PX4, Finding::Vanishing, found);
            found_if(long - short > NEEDLE_ASPECT.ln(), Finding::Needle, found);
        }
        examine_opacity(g.opacity_logit, found);
        examine_color(&[g.color], found);
    }

    fn place(&self, index: usize) -> Vec3 {
        self.means[index].extend(0.0)
    }

    fn shape_bits(&self, index: usize) -> [u32; 10] {
        let ([x, y], [long, short]) = (self.means[index].to_array(), self.log_scales[index].to_array());
        bits([x, y, long, short, self.rotations[index], 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    fn stored(&self, _: usize) -> Option<([f32; 3], f32)> {
        None
    }

    fn widen(&mut self, index: usize) {
        self.log_scales[index] = self.log_scales[index].map(widened);
    }

    fn retain(&mut self, keep: &[bool]) {
        let Self { means, log_scales, rotations, opacity_logits, colors } = self;
        retain(means, 1, keep);
        retain(log_scales, 1, keep);
        retain(rotations, 1, keep);
        retain(opacity_logits, 1, keep);
        retain(colors, 1, keep);
    }
}

impl Examinable for Scene3d {
    fn examine_one(&self, index: usize, found: &mut dyn FnMut(Finding)) {
        let (mean, rotation) = (self.means[index], self.rotations[index]);
        let finite = mean.is_finite();
        found_if(!finite, Finding::MeanNotFinite, found);
        if rotation.iter().all(|v| v.is_finite()) {
            // A sum that overflows belongs to a quaternion with a direction.
            let norm2: f32 = rotation.iter().map(|v| v * v).sum();
            found_if(norm2 < MIN_QUATERNION_NORM2, Finding::NoRotation, found);
        } else {
            found(Finding::RotationNotFinite);
        }
        let mut scales = self.log_scales[index].to_array();
        if scales_are_sound(&scales, found) && finite {
            scales.sort_unstable_by(|a, b| b.total_cmp(a));
            found_if(scales[0].exp() < spacing(mean.abs().max_element()), Finding::Vanishing, found);
            found_if(scales[0] - scales[1] > NEEDLE_ASPECT.ln(), Finding::Needle, found);
        }
        examine_opacity(self.opacity_logits[index], found);
        examine_color(&self.sh[index * self.sh_len()..][..self.sh_len()], found);
    }

    fn place(&self, index: usize) -> Vec3 {
        self.means[index]
    }

    fn shape_bits(&self, index: usize) -> [u32; 10] {
        let (m, s, q) = (self.means[index], self.log_scales[index], self.rotations[index]);
        bits([m.x, m.y, m.z, s.x, s.y, s.z, q[0], q[1], q[2], q[3]])
    }

    fn stored(&self, index: usize) -> Option<([f32; 3], f32)> {
        Some((self.log_scales[index].to_array(), self.opacity_logits[index]))
    }

    fn widen(&mut self, index: usize) {
        self.log_scales[index] = self.log_scales[index].map(widened);
    }

    fn retain(&mut self, keep: &[bool]) {
        let coefficients = self.sh_len();
        let Self { means, log_scales, rotations, opacity_logits, sh_degree: _, sh } = self;
        retain(means, 1, keep);
        retain(log_scales, 1, keep);
        retain(rotations, 1, keep);
        retain(opacity_logits, 1, keep);
        retain(sh, coefficients, keep);
    }
}

fn found_if(it_is: bool, finding: Finding, found: &mut dyn FnMut(Finding)) {
    if it_is {
        found(finding);
    }
}

/// Whether all scales and their ln are finite; otherwise reports why not.
fn scales_are_sound(log_scales: &[f32], found: &mut dyn FnMut(Finding)) -> bool {
    // −∞ is a scale of 0, and NaN none.
    let not_finite = log_scales.iter().any(|log| !log.exp().is_finite());
    let zero = log_scales.contains(&f32::NEG_INFINITY);
    found_if(not_finite, Finding::ScaleNotFinite, found);
    found_if(zero && !not_finite, Finding::ZeroScale, found);
    let enormous = log_scales.iter().any(|log| !(2.0 * log).exp().is_finite());
    found_if(enormous && !not_finite && !zero, Finding::Enormous, found);
    !not_finite && !zero
}

fn examine_opacity(logit: f32, found: &mut dyn FnMut(Finding)) {
    found_if(logit.is_nan(), Finding::OpacityNotANumber, found);
    found_if(sigmoid(logit) < ALPHA_CUT, Finding::Transparent, found);
    found_if(logit.is_finite() && logit.abs() > OUT_OF_RANGE_LOGIT, Finding::OpacityOutOfRange, found);
}

fn examine_color(values: &[Vec3], found: &mut dyn FnMut(Finding)) {
    let finite = values.iter().all(|value| value.is_finite());
    found_if(!finite, Finding::ColorNotFinite, found);
    let extreme = values.iter().any(|value| value.abs().max_element() > EXTREME_COLOR);
    found_if(finite && extreme, Finding::ExtremeColor, found);
}

/// Distance from a value that is not negative to the next `f32`; infinite for the largest.
fn spacing(value: f32) -> f32 {
    value.next_up() - value
}

/// Bits that are equal where the values are: −0 becomes 0.
fn bits(values: [f32; 10]) -> [u32; 10] {
    values.map(|value| (value + 0.0).to_bits())
}

fn widened(log_scale: f32) -> f32 {
    if log_scale == f32::NEG_INFINITY { SMALLEST_LOG_SCALE } else { log_scale }
}

/// Keeps the values of the Gaussians in `keep`, `of_each` per Gaussian.
fn retain<T>(values: &mut Vec<T>, of_each: usize, keep: &[bool]) {
    let mut index = 0;
    values.retain(|_| {
        index += 1;
        keep[(index - 1) / of_each]
    });
}
