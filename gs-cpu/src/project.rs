//! Stage `project`: every Gaussian's parameters become what the pixels need ([`Splat`]). Parallel over Gaussians.
//!
//! Σ′ is held so that the exponent is a sum of squares, without the cancellation that a·dx² + 2b·dx·dy + c·dy² suffers in needles:
//! σ = ½ dx²/Σxx + ½ c (dy − slope·dx)², with slope = Σxy/Σxx and c = Σxx/det Σ′. All of it comes from L′, whose determinant does
//! not cancel either.

use glam::{Mat2, Vec2};
use gs_core::{
    Accuracy, Blend, Canvas, RenderSettings, constants::MIN_DETERMINANT_PX4, scene::sigmoid, statistics::Culled,
};
use rayon::prelude::*;

use crate::cloud::PlanarCloud;

/// Gaussians a task of this and the following stages handles.
pub(crate) const CHUNK: usize = 1024;

/// Largest |exponent| that the kernels' recurrence may start from, well inside the range of `f32`'s exponent.
const SAFE_EXPONENT: f32 = 80.0;

/// Most rows that the recurrence runs before it starts afresh; its error grows with the square of the number of rows.
const MAX_RESTART_ROWS: f32 = 32.0;

/// Gaussians with a smaller c hold the ratio of successive rows' weights less 1: near 1, the ratio's own rounding would add up with the
/// square of the number of rows. With a larger one there are few rows, and the ratio comes near 0, where less 1 would lose its digits.
const WIDE: f32 = 0.5;

/// One Gaussian on the canvas. Units: px.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Splat {
    pub(crate) mean: [f32; 2],
    /// 1/Σxx, px⁻².
    pub(crate) inverse_xx: f32,
    /// Σxy/Σxx: how far the ridge moves down per column.
    pub(crate) slope: f32,
    /// Σxx/det Σ′, px⁻².
    pub(crate) c: f32,
    /// exp(−c): by how much the ratio of successive rows' weights changes per row.
    pub(crate) ratio: f32,
    /// 1 − exp(−c), to its own precision, where the ratio is held less 1; else 0.
    pub(crate) fall: f32,
    pub(crate) color: [f32; 3],
    pub(crate) opacity: f32,
    /// A weight (times opacity, under `Over`) below this adds nothing; ∞ for a culled Gaussian.
    pub(crate) cut: f32,
    /// 2 ln(opacity/cut): dᵀ Σ′⁻¹ d on the ellipse outside which nothing is added.
    pub(crate) reach: f32,
    /// Half the ellipse's extent along x; negative for a culled Gaussian.
    pub(crate) half_x: f32,
    /// dx of the ellipse's lowest point (−dx of its highest).
    pub(crate) lowest_dx: f32,
    /// Rows after which the kernels' recurrence starts afresh, 1 to 32.
    pub(crate) restart_rows: u32,
}

impl Splat {
    /// A Gaussian that adds nothing, with numbers that no kernel can turn into NaN.
    const CULLED: Self = Self {
        mean: [0.0; 2],
        inverse_xx: 1.0,
        slope: 0.0,
        c: 1.0,
        ratio: 0.5,
        fall: 0.0,
        color: [0.0; 3],
        opacity: 0.0,
        cut: f32::INFINITY,
        reach: 0.0,
        half_x: -1.0,
        lowest_dx: 0.0,
        restart_rows: 1,
    };

    pub(crate) fn is_culled(&self) -> bool {
        self.half_x < 0.0
    }
}

/// L′ and the mean on the canvas: plane coordinates scaled to pixels.
pub(crate) fn on_canvas(canvas: &Canvas, mean: Vec2, frame: Mat2) -> (Vec2, Mat2) {
    let scale = canvas.scale();
    ((mean - canvas.origin) * scale, Mat2::from_cols(frame.x_axis * scale, frame.y_axis * scale))
}

/// One Gaussian's splat, or why it has none.
fn project(mean: Vec2, l: Mat2, color: [f32; 3], opacity: f32, accuracy: &Accuracy, culled: &mut Culled) -> Splat {
    let xx = l.x_axis.x * l.x_axis.x + l.y_axis.x * l.y_axis.x;
    let yy = l.x_axis.y * l.x_axis.y + l.y_axis.y * l.y_axis.y;
    let xy = l.x_axis.x * l.x_axis.y + l.y_axis.x * l.y_axis.y;
    let det = l.determinant().powi(2);
    let finite = mean.is_finite() && det.is_finite() && (xx * yy).is_finite() && !opacity.is_nan();
    if !finite || !color.iter().all(|c| c.is_finite()) {
        culled.not_finite += 1;
        return Splat::CULLED;
    }
    if !(det >= MIN_DETERMINANT_PX4) {
        culled.degenerate += 1;
        return Splat::CULLED;
    }
    if !(opacity >= accuracy.alpha_cut) {
        culled.transparent += 1;
        return Splat::CULLED;
    }
    let reach = 2.0 * (opacity / accuracy.alpha_cut).ln();
    let c = xx / det;
    // A row whose weight is above the cut has σ ≤ reach/2; going back n rows adds at most n √(c/2) to √σ.
    let restart = ((SAFE_EXPONENT.sqrt() - (0.5 * reach).sqrt()) / (0.5 * c).sqrt()).clamp(1.0, MAX_RESTART_ROWS);
    let half_y = (reach * yy).sqrt();
    Splat {
        mean: mean.to_array(),
        inverse_xx: 1.0 / xx,
        slope: xy / xx,
        c,
        ratio: (-c).exp(),
        fall: if c < WIDE { -(-c).exp_m1() } else { 0.0 },
        color,
        opacity,
        cut: accuracy.alpha_cut,
        reach,
        half_x: (reach * xx).sqrt(),
        lowest_dx: xy / yy * half_y,
        restart_rows: restart as u32,
    }
}

/// Projects all Gaussians of `cloud`, in the order `order` (place → index), into `splats`.
pub(crate) fn project_all(
    cloud: &PlanarCloud,
    canvas: &Canvas,
    settings: &RenderSettings,
    order: &[u32],
    splats: &mut Vec<Splat>,
) -> Culled {
    splats.resize(order.len(), Splat::CULLED);
    let opaque = settings.effects.blend == Blend::Sum || cloud.opacity_logits.is_empty();
    let chunk = |(out, order): (&mut [Splat], &[u32])| {
        let mut culled = Culled::default();
        for (splat, &index) in out.iter_mut().zip(order) {
            let index = index as usize;
            let (mean, l) = on_canvas(canvas, cloud.means[index], cloud.frame(index));
            let opacity = if opaque { 1.0 } else { sigmoid(cloud.opacity_logits[index]) };
            *splat = project(mean, l, cloud.colors[index], opacity, &settings.accuracy, &mut culled);
        }
        culled
    };
    splats.par_chunks_mut(CHUNK).zip(order.par_chunks(CHUNK)).map(chunk).reduce(Culled::default, Culled::plus)
}
