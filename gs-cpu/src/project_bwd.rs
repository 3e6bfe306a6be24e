//! Stage `project_bwd`: what the entries of a Gaussian received becomes the gradient of its parameters.
//!
//! Everything goes through the whitened frame: with z = L′⁻¹ d, a step μ += L ξ, L ← L exp(η) changes σ by −zᵀξ − zᵀηz, so that
//! v_ξ = Σ t z and v_η = Σ t z zᵀ; no covariance is inverted. The kernels' sums over (dx, u) are whitened by the lower-triangular
//! root of Σ′ (a scaling per axis), and a rotation leads from there to the frame of L′.

use glam::{Mat2, Vec2};
use gs_core::{
    Blend, Error, PlanarScene,
    effects::Statistics,
    whitened::{WhitenedGradient, solve_transposed},
};

use crate::{
    cloud::{PlanarCloud, Shapes},
    project::on_canvas,
    workspace::Workspace,
};

/// ∂L/∂(one Gaussian's parameters), in its whitened frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Gradient {
    pub(crate) color: [f32; 3],
    /// v_ξ.
    pub(crate) xi: Vec2,
    /// v_η: (η₀₀, η₀₁ = η₁₀ each, η₁₁).
    pub(crate) eta: [f32; 3],
    /// ∂L/∂(opacity logit).
    pub(crate) opacity_logit: f32,
    /// This step's share of the statistic that is asked for; 0 where none is.
    pub(crate) statistic: f32,
    /// Whether any tile listed it.
    pub(crate) visible: bool,
}

impl Gradient {
    pub(crate) fn whitened(&self) -> WhitenedGradient {
        WhitenedGradient { xi: self.xi, eta: self.eta }
    }
}

/// The gradients of one backward pass on the CPU, `[N]`.
#[derive(Debug, Default)]
pub struct PlanarGradients {
    pub(crate) gradients: Vec<Gradient>,
    /// What the frame's effects ask to be collected.
    pub(crate) statistics: Statistics,
}

impl PlanarGradients {
    /// Fails unless the gradients are of as many Gaussians as the cloud has.
    pub(crate) fn check_len(&self, cloud: &PlanarCloud) -> Result<(), Error> {
        if self.gradients.len() == cloud.len() {
            return Ok(());
        }
        let (found, expected) = (self.gradients.len(), cloud.len());
        Err(Error::State(format!("gradients of {found} Gaussians do not fit a cloud of {expected}")))
    }
}

/// Sums what the entries of the Gaussian at `place` received, in the order of its tiles; `scale` multiplies everything.
#[inline(always)]
pub(crate) fn gradient(workspace: &Workspace, cloud: &PlanarCloud, place: usize, scale: f32) -> Gradient {
    let index = workspace.order[place] as usize;
    let slots = workspace.bins.slots_of(place);
    let splat = &workspace.splats[place];
    if slots.is_empty() || splat.is_culled() {
        return Gradient::default();
    }
    let (stride, gradient_stride) = (workspace.stride, workspace.gradient_stride());
    let (mut sum, mut collected) = ([0.0f32; 9], [0.0f32; 2]);
    for &slot in slots {
        let slot = &workspace.slots[slot as usize * stride..][..stride];
        for (total, value) in sum.iter_mut().zip(&slot[..gradient_stride]) {
            *total += value;
        }
        for (total, value) in collected.iter_mut().zip(&slot[gradient_stride..]) {
            *total += value;
        }
    }
    let [r, g, b, x, u, xx, xu, uu, t] = sum.map(|v| v * scale);
    let (_, l) = on_canvas(&workspace.canvas, cloud.means[index], cloud.frame(index));
    let (root_x, root_u) = (splat.inverse_xx.sqrt(), splat.c.sqrt());
    let e = Vec2::new(x * root_x, u * root_u);
    let (e_00, e_01, e_11) = (xx * splat.inverse_xx, xu * root_x * root_u, uu * splat.c);
    let q = rotation_from_triangular(l);
    let xi = q * e;
    let moment = q * Mat2::from_cols_array(&[e_00, e_01, e_01, e_11]) * q.transpose();
    let half_size = || Vec2::new(workspace.canvas.width as f32, workspace.canvas.height as f32) * 0.5;
    let statistic = match workspace.settings.effects.statistics {
        Statistics::None => 0.0,
        Statistics::MeanGradient => (solve_transposed(l, xi) * half_size()).length(),
        Statistics::AbsoluteGradient => (Vec2::from_array(collected) * scale * half_size()).length(),
        // The error is none of the loss's.
        Statistics::PixelError => collected[0],
    };
    let opacity_logit = match workspace.settings.effects.blend {
        Blend::Sum => 0.0,
        Blend::Over => t * (1.0 - splat.opacity),
    };
    Gradient {
        color: [r, g, b],
        xi,
        eta: [moment.x_axis.x, moment.x_axis.y, moment.y_axis.y],
        opacity_logit,
        statistic,
        visible: true,
    }
}

/// Q with L⁻¹ = Q K⁻¹, where K is the lower-triangular root of L Lᵀ: orthogonal.
fn rotation_from_triangular(l: Mat2) -> Mat2 {
    // The first row of L is √Σxx times the first row of Qᵀ.
    let first = Vec2::new(l.x_axis.x, l.y_axis.x).normalize_or(Vec2::X);
    let second = if l.determinant() >= 0.0 { first.perp() } else { -first.perp() };
    Mat2::from_cols(first, second)
}

/// The gradients as a scene of derivatives: with respect to mean (px⁻¹), log-scale, rotation (rad⁻¹), opacity logit and colour.
pub(crate) fn as_scene(cloud: &PlanarCloud, gradients: &PlanarGradients) -> PlanarScene {
    let mut scene = PlanarScene::default();
    for (index, gradient) in gradients.gradients.iter().enumerate() {
        let (l, log_ratio, whitened) = match &cloud.shapes {
            Shapes::ScaleRotation(shapes) => {
                let [x, y, _] = shapes[index];
                (cloud.frame(index), x - y, gradient.whitened())
            }
            Shapes::LocalFrame(frames) => gradient.whitened().in_axes(frames[index]),
        };
        let (mean, [x, y, angle]) =
            if gradient.visible { whitened.by_scale_rotation(l, log_ratio) } else { (Vec2::ZERO, [0.0; 3]) };
        scene.means.push(mean);
        scene.log_scales.push(Vec2::new(x, y));
        scene.rotations.push(angle);
        scene.colors.push(gradient.color.into());
        if !cloud.opacity_logits.is_empty() {
            scene.opacity_logits.push(gradient.opacity_logit);
        }
    }
    scene
}
