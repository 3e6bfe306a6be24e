//! A scale that is set to ever smaller values: where loss and gradients stop being finite, for each
//! guard.

use glam::{Vec2, Vec3};
use gs_backend::FutureExt as _;
use gs_core::{Canvas, Gaussian2d, Image, Optimizer, Scene as _, Scene2d, logit};

use super::textbook::Textbook;
use super::{
    guard::{Guard, NEEDLE_PX},
    small_fits::small_settings,
};
use gs_train::Error;

/// The results for a needle, turned by many angles, one of whose scales goes down to 1e-12 px.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Drive {
    pub(super) guard: Guard,
    /// Number of angles.
    pub(super) angles: usize,
    /// Number of angles at which the loss or a gradient stops being finite.
    pub(super) not_finite: usize,
    /// The largest scale at which it does, px.
    pub(super) from_px: Option<f64>,
    /// The largest scale at which the Gaussian is left out, px, as this project's guards do.
    pub(super) left_out_px: Option<f64>,
}

impl Drive {
    /// Lets a scale of the needle go to zero, in 8 steps per decade.
    pub(super) fn measure<R: Optimizer<Scene2d>>(
        rasterizer: &R,
        guard: Guard,
        target: &Image,
        angles: u32,
    ) -> Result<Self, Error> {
        let (mut not_finite, mut from_px, mut left_out_px) = (0, 0.0f64, 0.0f64);
        let uploaded = rasterizer.upload_target(target)?;
        let settings = small_settings(0);
        for angle in 0..angles {
            let mut is_finite = true;
            for eighth in 0..=96 {
                let short = 10f32.powf(-(eighth as f32) / 8.0);
                let scene: Scene2d = [needle(short, angle as f32 / angles as f32 * 3.0 + 0.05)].into_iter().collect();
                let finite = match guard.of_textbook() {
                    Some(guards) => {
                        let found =
                            Textbook::new(&scene, settings.render.background, guards, 0.0).clamped().step(target);
                        found.loss.is_finite() && found.has_finite_gradients
                    }
                    None => {
                        let splats = rasterizer.upload(&scene, settings.parameterization)?;
                        let canvas = Canvas::new(target.width(), target.height());
                        let frame = rasterizer.forward(&splats, &canvas, &settings.render).block_on()?;
                        if rasterizer.culled(&frame).degenerate > 0 {
                            left_out_px = left_out_px.max(short.into());
                        }
                        let (loss, gradients) =
                            rasterizer.backward(&splats, frame, &uploaded, &settings.loss).block_on()?;
                        loss.is_finite() && rasterizer.gradients(&splats, &gradients).block_on()?.validate().is_ok()
                    }
                };
                if !finite {
                    is_finite = false;
                    from_px = from_px.max(short.into());
                }
            }
            not_finite += usize::from(!is_finite);
        }
        let met = |scale: f64| (scale > 0.0).then_some(scale);
        Ok(Self { guard, angles: angles as usize, not_finite, from_px: met(from_px), left_out_px: met(left_out_px) })
    }
}

/// A needle away from pixel centres.
fn needle(short_px: f32, angle: f32) -> Gaussian2d {
    Gaussian2d {
        mean: Vec2::new(12.3, 11.6),
        log_scale: Vec2::new(NEEDLE_PX.ln(), short_px.ln()),
        rotation: angle,
        opacity_logit: logit(0.7),
        color: Vec3::splat(0.2),
    }
}
