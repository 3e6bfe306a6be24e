//! How much rounding in a file format changed the numbers of the Gaussians.

use std::fmt;

use gs_core::{Scene3d, constants::SH_C0, sigmoid};
use serde::Serialize;

/// The change of one quantity of the Gaussians, such as by writing a scene and reading it again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Rounding {
    /// The quantity in words: "rotations".
    pub quantity: &'static str,
    /// The unit, as it follows a number: "°", " %".
    pub unit: &'static str,
    /// Mean change over the Gaussians.
    pub mean: f64,
    /// Largest change of a Gaussian.
    pub largest: f64,
}

impl Rounding {
    /// All quantities that differ between two scenes of the same Gaussians in the same order. SH
    /// are compared up to the lower degree.
    pub fn between(before: &Scene3d, after: &Scene3d) -> Vec<Self> {
        let all = [
            of("means", " units", before, |i| f64::from(before.means[i].distance(after.means[i]))),
            of("scales", " %", before, |i| {
                let change = (after.log_scales[i] - before.log_scales[i]).as_dvec3().map(f64::exp_m1);
                100.0 * change.abs().max_element()
            }),
            of("rotations", "°", before, |i| angle(before.rotations[i], after.rotations[i])),
            of("opacities", " of 1", before, |i| {
                f64::from((sigmoid(before.opacity_logits[i]) - sigmoid(after.opacity_logits[i])).abs())
            }),
            of("colours", " of 1", before, |i| f64::from(SH_C0) * coefficients(before, after, i, 0..1)),
            of("higher SH coefficients", "", before, |i| {
                coefficients(before, after, i, 1..before.sh_len().min(after.sh_len()))
            }),
        ];
        all.into_iter().filter(|rounding| rounding.largest > 0.0).collect()
    }
}

fn of(quantity: &'static str, unit: &'static str, scene: &Scene3d, distance: impl Fn(usize) -> f64) -> Rounding {
    let count = scene.means.len();
    let (sum, largest) =
        (0..count).map(distance).fold((0.0, 0.0), |(sum, largest), distance| (sum + distance, distance.max(largest)));
    Rounding { quantity, unit, mean: sum / count as f64, largest }
}

/// The largest change of these coefficients of Gaussian `i` in a channel.
fn coefficients(before: &Scene3d, after: &Scene3d, i: usize, which: std::ops::Range<usize>) -> f64 {
    let change = |k: usize| before.sh[i * before.sh_len() + k] - after.sh[i * after.sh_len() + k];
    which.map(|k| f64::from(change(k).abs().max_element())).fold(0.0, f64::max)
}

/// The angle between two rotations, degrees. Quaternions may have any length but 0.
fn angle(a: [f32; 4], b: [f32; 4]) -> f64 {
    let unit = |q: [f32; 4]| {
        let q = q.map(f64::from);
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        q.map(|v| v / length)
    };
    let (a, b) = if a == b { return 0.0 } else { (unit(a), unit(b)) };
    let length = |sign: f64| a.iter().zip(b).map(|(a, b)| (a + sign * b).powi(2)).sum::<f64>().sqrt();
    let (apart, together) = (length(-1.0), length(1.0));
    // q and −q are the same rotation. Half the angle of the rotation is that between the
    // quaternions.
    4.0 * apart.min(together).atan2(apart.max(together)).to_degrees()
}

impl fmt::Display for Rounding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { quantity, unit, mean, largest } = self;
        write!(f, "{quantity} by {}{unit} on average, {}{unit} at most", Short(*mean), Short(*largest))
    }
}

/// A number that is not negative, to two significant digits.
struct Short(f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value) = *self;
        let digits = if value > 0.0 { 1.0 - value.log10().floor() } else { 0.0 };
        if !(-4.0..=6.0).contains(&digits) {
            write!(f, "{value:.1e}")
        } else {
            write!(f, "{value:.*}", digits.max(0.0) as usize)
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use gs_core::{Gaussian3d, Scene};

    use super::*;

    fn scene() -> Scene3d {
        let gaussian = Gaussian3d {
            mean: Vec3::ONE,
            log_scale: Vec3::ZERO,
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 0.0,
            sh: vec![Vec3::ZERO; 4],
        };
        let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
        (0..2).for_each(|_| scene.push(gaussian.clone()));
        scene
    }

    #[test]
    fn changed_quantities_are_measured_and_others_left_out() {
        let before = scene();
        let mut after = scene();
        assert_eq!(Rounding::between(&before, &after), []);
        after.means[1].x += 0.5;
        after.log_scales[0].y = 1.3_f32.ln();
        after.rotations[0] = [0.0, 0.0, -3.0, 0.0];
        after.opacity_logits[0] = f32::INFINITY;
        after.sh[5].z = -0.5;
        let lines: Vec<String> = Rounding::between(&before, &after).iter().map(Rounding::to_string).collect();
        let expected = [
            "means by 0.25 units on average, 0.50 units at most",
            "scales by 15 % on average, 30 % at most",
            "rotations by 90° on average, 180° at most",
            "opacities by 0.25 of 1 on average, 0.50 of 1 at most",
            "higher SH coefficients by 0.25 on average, 0.50 at most",
        ];
        assert_eq!(lines, expected);
        assert_eq!(
            [0.0, 0.000_012, 1.3e-8, 1234.0, 5.7e18].map(|value| Short(value).to_string()),
            ["0", "0.000012", "1.3e-8", "1234", "5.7e18"]
        );
    }
}
