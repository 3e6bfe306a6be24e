//! 2D scenes and canvases that are refused, and the errors.

use glam::Vec2;
use gs_core::{Canvas, Error, Gaussian2d, Scene2d, effects::Blend};

use super::common::{PLAIN, VIEW, case};
use crate::corpus::case::{Case, Source};

/// The error names the second Gaussian.
const NOT_FINITE: fn(&Error) -> bool = |error| matches!(error, Error::NotFinite { index: 1, .. });
const LENGTH: fn(&Error) -> bool = |error| matches!(error, Error::Length { .. });
const SIZE: fn(&Error) -> bool = |error| matches!(error, Error::Size { .. });
const SETTING: fn(&Error) -> bool = |error| matches!(error, Error::Setting { .. });

pub(super) fn cases() -> Vec<Case<Scene2d>> {
    let met = Source::Report("https://github.com/playcanvas/supersplat/issues/360");
    let why = "files with NaN, and what engines draw of them: nothing at all, or everywhere";
    let with = |name: &str, broken: Gaussian2d| case(name, why, met, Blend::Over, [PLAIN, broken]).refused(NOT_FINITE);
    let mut cases = vec![
        with("NaN in a mean", Gaussian2d { mean: Vec2::new(3.0, f32::NAN), ..PLAIN }),
        with("∞ in a scale", Gaussian2d { log_scale: Vec2::new(f32::INFINITY, 0.0), ..PLAIN }),
        with("−∞ in a scale", Gaussian2d { log_scale: Vec2::new(f32::NEG_INFINITY, 0.0), ..PLAIN }),
        with("NaN in an opacity", Gaussian2d { opacity_logit: f32::NAN, ..PLAIN }),
    ];
    let mut short = case("arrays of different lengths", why, met, Blend::Over, [PLAIN, PLAIN]).refused(LENGTH);
    short.scene.rotations.pop();
    cases.push(short);
    for (name, view, right) in [
        ("an image of no columns", Canvas::new(0, 19), SIZE),
        ("an image of 2³² − 1 rows", Canvas::new(24, u32::MAX), SIZE),
        ("a canvas of no extent", Canvas::new(VIEW.0, VIEW.1).showing(Vec2::ZERO, Vec2::new(0.0, 19.0)), SETTING),
    ] {
        let source = Source::Report("https://github.com/graphdeco-inria/gaussian-splatting/issues/28");
        let why = "sizes that overflow when they are multiplied";
        cases.push(Case { view, ..case(name, why, source, Blend::Over, [PLAIN]).refused(right) });
    }
    cases
}
