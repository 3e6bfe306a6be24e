//! Converts logits and logarithms of scenes to opacities and scales of formats and back, in `f64`,
//! so that only the result is rounded.
//!
//! Logits are always finite. An opacity of 0 or 1 stands for all values that round to it, so it is
//! read as the logit of the middle of that half step, which rounds to it again: files come back
//! with the same bytes.

use gs_core::examination::OUT_OF_RANGE_LOGIT;

/// The logit of the opacity 1 − 2⁻²⁶, which `f32` and every backend's sigmoid round to 1.
pub(crate) const OPAQUE_LOGIT: f32 = 18.021_827;

/// A logit whose opacity is below the normal numbers and written as 0.
pub(crate) const TRANSPARENT_LOGIT: f32 = -OUT_OF_RANGE_LOGIT;

/// ln of a scale: −∞ for 0, ln of the smallest normal number for smaller scales, NaN for negative
/// ones.
pub(crate) fn log_of_scale(scale: f32) -> f32 {
    match scale {
        0.0 => f32::NEG_INFINITY,
        _ if scale > 0.0 => f64::from(scale.max(f32::MIN_POSITIVE)).ln() as f32,
        _ => f32::NAN,
    }
}

/// The scale of a logarithm, clamped to normal numbers.
pub(crate) fn scale_of_log(log: f32) -> f32 {
    (f64::from(log).exp() as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}

/// The logit of an opacity; [`TRANSPARENT_LOGIT`] and [`OPAQUE_LOGIT`] at the ends, NaN outside.
pub(crate) fn logit_of_opacity(opacity: f32) -> f32 {
    match opacity {
        1.0 => OPAQUE_LOGIT,
        _ if (0.0..f32::MIN_POSITIVE).contains(&opacity) => TRANSPARENT_LOGIT,
        _ => logit(f64::from(opacity)),
    }
}

/// The opacity of a logit; 0 below the normal numbers.
pub(crate) fn opacity_of_logit(logit: f32) -> f32 {
    let opacity = opacity(logit) as f32;
    if opacity < f32::MIN_POSITIVE { 0.0 } else { opacity }
}

/// The logit of an opacity that is stored as `step` ≤ `steps` of equal steps from 0 to 1.
pub(crate) fn logit_of_step(step: u16, steps: u16) -> f32 {
    let place = match step {
        0 => 0.25,
        _ if step == steps => f64::from(steps) - 0.25,
        _ => f64::from(step),
    };
    logit(place / f64::from(steps))
}

/// The opacity of a logit, rounded to 255 steps.
pub(crate) fn byte_of_logit(logit: f32) -> u8 {
    (opacity(logit) * 255.0).round() as u8
}

/// Makes an infinite logit finite.
pub(crate) fn finite_logit(logit: f32) -> f32 {
    match logit {
        f32::INFINITY => OPAQUE_LOGIT,
        f32::NEG_INFINITY => TRANSPARENT_LOGIT,
        _ => logit,
    }
}

fn logit(opacity: f64) -> f32 {
    (opacity / (1.0 - opacity)).ln() as f32
}

fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_give_the_same() {
        for log in [-80.0, -7.3, 0.0, 2.5, 88.0] {
            assert!((log_of_scale(scale_of_log(log)) - log).abs() <= 1e-6 * log.abs().max(1.0));
        }
        for logit in [-90.0, -86.0, -3.25, 0.0, 4.5] {
            let back = logit_of_opacity(opacity_of_logit(logit));
            let expected = if logit < -87.4 { TRANSPARENT_LOGIT } else { logit };
            assert!((back - expected).abs() < 1e-5 * logit.abs().max(1.0), "{logit} {back}");
        }
    }

    #[test]
    fn opacities_at_the_ends_have_finite_logits_that_round_to_them_again() {
        for end in [0.0, 1.0, 1.0_f32.next_down()] {
            let logit = logit_of_opacity(end);
            assert!(logit.is_finite());
            assert_eq!(opacity_of_logit(logit), end);
        }
        assert_eq!(gs_core::sigmoid(OPAQUE_LOGIT), 1.0);
        assert_eq!([f32::INFINITY, f32::NEG_INFINITY].map(|end| opacity_of_logit(finite_logit(end))), [1.0, 0.0]);
        for step in 0..=255 {
            let logit = logit_of_step(step, 255);
            assert!(logit.is_finite());
            assert_eq!(u16::from(byte_of_logit(logit)), step);
        }
        assert!(logit_of_step(65_535, 65_535) > 12.0 && logit_of_step(65_535, 65_535).is_finite());
    }

    #[test]
    fn tiny_scales_have_logarithms_and_impossible_values_give_nan() {
        assert_eq!((log_of_scale(0.0), log_of_scale(-0.0)), (f32::NEG_INFINITY, f32::NEG_INFINITY));
        assert_eq!(log_of_scale(1e-42), gs_core::examination::SMALLEST_LOG_SCALE);
        assert!(log_of_scale(-1.0).is_nan() && log_of_scale(f32::NAN).is_nan());
        assert!(logit_of_opacity(1.5).is_nan() && logit_of_opacity(-0.5).is_nan());
        assert!(logit_of_opacity(-1e-42).is_nan() && finite_logit(f32::NAN).is_nan());
        assert_eq!((scale_of_log(200.0), scale_of_log(-200.0)), (f32::MAX, f32::MIN_POSITIVE));
    }
}
