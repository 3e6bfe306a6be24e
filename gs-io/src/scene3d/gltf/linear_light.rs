//! Converts colours from linear light to sRGB.
//!
//! The extension's `lin_rec709_display` requires blending in linear light and converting the
//! picture. Scenes here have sRGB colours, so each Gaussian's are converted: c′(d) ≈ f(c₀) + f′(c₀)
//! (c(d) − c₀) with sRGB's f and the constant part c₀.

use glam::Vec3;

use gs_core::constants::SH_C0;

/// Converts the coefficients of one Gaussian.
pub(super) fn to_srgb(coefficients: &mut [Vec3]) {
    let Some((dc, rest)) = coefficients.split_first_mut() else { return };
    let linear = 0.5 + SH_C0 * *dc;
    let slope = linear.map(encoding_slope);
    *dc = (linear.map(encoded) - 0.5) / SH_C0;
    rest.iter_mut().for_each(|c| *c *= slope);
}

/// sRGB's transfer function (IEC 61966-2-1), linear below 0.
fn encoded(linear: f32) -> f32 {
    if linear > 0.003_130_8 { 1.055 * linear.powf(1.0 / 2.4) - 0.055 } else { 12.92 * linear }
}

fn encoding_slope(linear: f32) -> f32 {
    if linear > 0.003_130_8 { 1.055 / 2.4 * linear.powf(1.0 / 2.4 - 1.0) } else { 12.92 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_constant_part_is_exact_and_the_rest_follows_the_slope() {
        assert!((encoded(0.214_041) - 0.5).abs() < 1e-5);
        for c in [-0.1, 0.001, 0.2, 0.9] {
            let difference = (encoded(c + 1e-3) - encoded(c - 1e-3)) / 2e-3;
            assert!((difference - encoding_slope(c)).abs() < 1e-2 * encoding_slope(c), "{c}");
        }
        let mut coefficients = [Vec3::splat((0.214_041 - 0.5) / SH_C0), Vec3::ONE];
        to_srgb(&mut coefficients);
        assert!(
            coefficients[0].abs().max_element() < 1e-4 && (coefficients[1].x - encoding_slope(0.214_041)).abs() < 1e-5
        );
    }
}
