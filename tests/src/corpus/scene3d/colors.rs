//! SH colours at their edge cases.

use glam::{Vec2, Vec3};
use gs_core::{Gaussian3d, Scene3d};

use super::common::{case, seen};
use crate::corpus::case::{Case, Source};

pub(super) fn cases() -> Vec<Case<Scene3d>> {
    // ½ + Y₀ sh is 0 at sh = −1.7725: well below, at, and above, with a tilt that takes some
    // directions across.
    let around_zero = [-10.0, -1.78, -1.772_453_9, -1.76, 0.0].iter().enumerate().map(|(i, &flat)| {
        let sh = (0..16).map(|k| if k == 0 { Vec3::splat(flat) } else { Vec3::new(0.02, -0.02, 0.0) }).collect();
        Gaussian3d { sh, ..seen(Vec2::new(4.0 + 4.0 * i as f32, 9.0), 3.0, Vec3::splat(3.0)) }
    });
    let bright = [1.0, 1e3, 1e6].iter().enumerate().map(|(i, &value)| {
        let sh = (0..16).map(|k| Vec3::new(value, -value, 0.5 * value) / (1.0 + k as f32)).collect();
        Gaussian3d { sh, ..seen(Vec2::new(6.0 + 6.0 * i as f32, 9.0), 3.0, Vec3::splat(3.0)) }
    });
    vec![
        case(
            "SH that drive the colour below 0",
            "clamped colours have no gradient, and those that are not clamped a cliff beside them",
            Source::Definition("sh::color"),
            around_zero,
        ),
        case(
            "colours of 10⁶",
            "HDR coefficients: what is behind is the small rest of what is in front",
            Source::Definition("sh::color"),
            bright,
        ),
    ]
}
