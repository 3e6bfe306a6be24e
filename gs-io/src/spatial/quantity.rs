//! Conversions between what scenes hold (logits, logarithms) and what some formats do (opacities, scales), in `f64`, so that they
//! add no error beyond the rounding of the result.

/// ln of a scale: −∞ of 0; of what is too small for a normal number, ln of the smallest normal number. A negative scale gives NaN.
pub(crate) fn log_of_scale(scale: f32) -> f32 {
    match scale {
        0.0 => f32::NEG_INFINITY,
        _ if scale > 0.0 => f64::from(scale.max(f32::MIN_POSITIVE)).ln() as f32,
        _ => f32::NAN,
    }
}

/// The scale of a logarithm, kept among the normal numbers.
pub(crate) fn scale_of_log(log: f32) -> f32 {
    (f64::from(log).exp() as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}

/// The logit of an opacity, ±∞ at 1 and 0, NaN outside.
pub(crate) fn logit_of_opacity(opacity: f32) -> f32 {
    let p = f64::from(opacity);
    (p / (1.0 - p)).ln() as f32
}

/// The opacity of a logit.
pub(crate) fn opacity_of_logit(logit: f32) -> f32 {
    (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_give_the_same() {
        for log in [-80.0, -7.3, 0.0, 2.5, 88.0] {
            assert!((log_of_scale(scale_of_log(log)) - log).abs() <= 1e-6 * log.abs().max(1.0));
        }
        for logit in [f32::NEG_INFINITY, -90.0, -3.25, 0.0, 4.5, f32::INFINITY] {
            let back = logit_of_opacity(opacity_of_logit(logit));
            assert!(back == logit || (back - logit).abs() < 1e-5 * logit.abs().max(1.0), "{logit} {back}");
        }
    }

    #[test]
    fn what_is_almost_nothing_has_a_logarithm_and_what_cannot_be_is_seen() {
        assert_eq!((log_of_scale(0.0), log_of_scale(-0.0)), (f32::NEG_INFINITY, f32::NEG_INFINITY));
        assert_eq!(log_of_scale(1e-42), gs_core::examination::SMALLEST_LOG_SCALE);
        assert!(log_of_scale(-1.0).is_nan() && log_of_scale(f32::NAN).is_nan());
        assert!(logit_of_opacity(1.5).is_nan() && logit_of_opacity(-0.5).is_nan());
        assert_eq!((scale_of_log(200.0), scale_of_log(-200.0)), (f32::MAX, f32::MIN_POSITIVE));
    }
}
