//! Depths of a scene as a backend renders them.

use gs_core::{
    Output, RenderSettings,
    effects::{Background, Statistics},
};

/// Least opacity of a rendered pixel whose depth counts.
const LEAST_OPACITY: f32 = 0.9;

/// Settings for rendering inverse depths in the first channel, and these plus the transmittance in the second.
pub(super) fn depths_and_gaps(render: &RenderSettings) -> RenderSettings {
    let inverse_depths: RenderSettings = render.with(|s| {
        s.output = Output::InverseDepth;
        s.effects.background = Background::None;
        s.effects.statistics = Statistics::None;
    });
    inverse_depths.on([0.0, 1.0, 0.0])
}

/// The depth at a pixel of a rendering with [`depths_and_gaps`]; `None` where it is not clear.
pub(super) fn clear_depth([inverse, with_gaps, _]: [f32; 3]) -> Option<f32> {
    let opacity = 1.0 - (with_gaps - inverse);
    let depth = opacity / inverse;
    (opacity >= LEAST_OPACITY && depth > 0.0 && depth.is_finite()).then_some(depth)
}
