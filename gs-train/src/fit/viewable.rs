//! Conversion of 2D scenes for viewers of 3D splats.
//!
//! Viewers blend Gaussians front to back, widen each by 0.3 px², clamp negative colours to 0, and
//! have no background. Most 2D scenes are sums ([`Blend::Sum`]), with negative colours, before a
//! background. So [`viewable`] trains a scene for viewers, starting from the Gaussians of the given
//! scene, with its rendering as target.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Canvas, EditPlan, Gaussian2d, Image, Optimizer, Rasterizer, RenderSettings, Scene2d, Scene3d,
    edit::{Change, Moments},
    effects::{Antialias, Order},
    examination, logit, metrics,
};
use gs_density::{DensityPolicy, Observation, Rng};
use gs_io::{File2d, flat_scene};

use super::{plane_scene::Flat, settings::FitSettings};
use crate::{
    error::Error,
    run::{Rounds, Trainer},
};

/// Number of steps. Photographs end at 33 to 47 dB; twice as many steps gained 0.6 dB on the one
/// that was tried.
const STEPS: u32 = 200;

/// Steps from one correction of colours to the next.
const STEPS_A_ROUND: u32 = 8;

/// Learning rate of opacity logits.
const OPACITY_RATE: f32 = 0.05;

/// Initial opacity of the Gaussians of a sum.
const OPACITY: f32 = 0.7;

/// Share of its own colour in the initial colour of a Gaussian of a sum, added to the image's
/// colour at its mean.
const COLOR_SHARE: f32 = 0.5;

/// Largest magnitude of initial opacity logits, so that they have a gradient.
const MAX_LOGIT: f32 = 5.0;

/// Number of background Gaussians along the image's longer side.
const BACKGROUND_SIDE: u32 = 16;

/// The nearest colour that viewers can show.
fn nearest(color: Vec3) -> Vec3 {
    color.max(Vec3::ZERO)
}

/// Result of [`viewable`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Viewable {
    /// The scene: blended front to back, widened by 0.3 px², without background, with colours of 0 and
    /// more.
    pub file: File2d,
    /// PSNR against the rendering of the given scene, both in 8 bits, dB; ∞ where they are equal.
    ///
    /// The scene is rendered as a 3D scene ([`flat_scene`]) from the front at the image's size.
    pub psnr: f64,
}

/// Makes a scene for viewers from a 2D scene. The same scene gives the same result, bit for bit, on
/// the same backend.
///
/// # Errors
/// [`gs_core::Error::State`] for a scene without Gaussians; [`gs_core::Error::Unsupported`] where
/// the backend has no antialiasing of 2D scenes; those of [`Trainer`].
pub async fn viewable<R>(on: &R, file: &File2d) -> Result<Viewable, Error>
where
    R: Optimizer<Scene2d> + Optimizer<Scene3d>,
{
    file.validate()?;
    let canvas = Canvas::new(file.width, file.height);
    let target = file.in_srgb(Rasterizer::<Scene2d>::render(on, &file.scene, &canvas, &file.settings).await?).clamped();
    let start = start(file, &target);
    if start.means.is_empty() {
        return Err(
            gs_core::Error::State("a scene without Gaussians has nothing to show in a viewer".to_owned()).into()
        );
    }
    let settings = settings(start.means.len() as u32, target.size());
    let mut trainer = Trainer::from_scene(on, &target, &start, settings).await?.controlled_by(Arc::new(KeepColors));
    trainer.run(&mut ()).await?;
    let mut scene = trainer.scene().await?;
    examination::repair(&mut scene)?;
    scene.colors.iter_mut().for_each(|color| *color = nearest(*color));
    let (width, height) = (file.width, file.height);
    let made = File2d { scene, width, height, settings: trainer.shown(), profile: None };
    let psnr = psnr_of(on, &made, &target).await?;
    Ok(Viewable { file: made, psnr })
}

/// PSNR of a scene as a viewer shows it, dB.
async fn psnr_of<R: Optimizer<Scene3d>>(on: &R, file: &File2d, target: &Image) -> Result<f64, Error> {
    let size = (file.width, file.height);
    let camera = Flat::picture(size).camera(size);
    let image = on.render(&flat_scene(file)?, &camera, &as_viewers_do()).await?;
    Ok(metrics::psnr(&image.rounded_to_8_bits(), &target.rounded_to_8_bits())?)
}

/// Render settings of viewers of 3D scenes.
fn as_viewers_do() -> RenderSettings {
    let mut render = RenderSettings::blended(Blend::Over);
    (render.effects.order, render.effects.antialias) = (Order::Global, Antialias::Dilate);
    render
}

/// The first Gaussians, the background's last.
fn start(file: &File2d, target: &Image) -> Scene2d {
    let mut gaussians: Vec<Gaussian2d> = file.scene.iter().collect();
    match file.settings.effects.blend {
        Blend::Over => {
            for g in &mut gaussians {
                g.opacity_logit = g.opacity_logit.clamp(-MAX_LOGIT, MAX_LOGIT);
                g.color = nearest(g.color);
            }
        }
        Blend::Sum => {
            for g in &mut gaussians {
                g.opacity_logit = logit(OPACITY);
                g.color = nearest(color_at(target, g.mean) + COLOR_SHARE * g.color);
            }
            // The small ones in front, where the large ones do not hide them. Stable: ties by
            // index.
            gaussians.sort_by(|a, b| a.log_scale.element_sum().total_cmp(&b.log_scale.element_sum()));
        }
    }
    let behind = Vec3::from(file.settings.background_color());
    if behind != Vec3::ZERO {
        gaussians.extend(background(target.size(), nearest(behind)));
    }
    gaussians.into_iter().collect()
}

/// A grid of nearly opaque Gaussians over the whole image, as viewers have no background.
fn background((width, height): (u32, u32), color: Vec3) -> Vec<Gaussian2d> {
    let size = Vec2::new(width as f32, height as f32);
    let counts = (size / size.max_element() * BACKGROUND_SIDE as f32).ceil().as_uvec2();
    let cell = size / counts.as_vec2();
    let place = |column: u32, row: u32| Vec2::new(column as f32, row as f32) * cell;
    let gaussian = |mean: Vec2| Gaussian2d {
        mean,
        log_scale: (0.7 * cell).map(f32::ln),
        rotation: 0.0,
        opacity_logit: MAX_LOGIT,
        color,
    };
    (0..=counts.y).flat_map(|row| (0..=counts.x).map(move |column| gaussian(place(column, row)))).collect()
}

/// The image's colour at a place; outside, that of the nearest pixel.
fn color_at(target: &Image, place: Vec2) -> Vec3 {
    // Saturating casts.
    let (x, y) = (place.x as u32, place.y as u32);
    target.pixel(x.min(target.width() - 1), y.min(target.height() - 1)).into()
}

fn settings(gaussians: u32, size: (u32, u32)) -> FitSettings {
    let mut settings = FitSettings::for_image(gaussians, size, STEPS);
    settings.render = RenderSettings::blended(Blend::Over);
    settings.render.effects.antialias = Antialias::Dilate;
    settings.adam.opacity.learning_rate = OPACITY_RATE;
    settings.rounds = Rounds::until(STEPS_A_ROUND, STEPS);
    settings
}

/// Policy that keeps colours in range while a scene is trained, so that it need not be changed
/// afterwards.
#[derive(Debug)]
struct KeepColors;

impl DensityPolicy for KeepColors {
    fn plan(&self, observation: &Observation<'_>, _: &mut Rng) -> Result<EditPlan<Gaussian2d>, gs_core::Error> {
        let changed = observation.scene.iter().enumerate().filter_map(|(index, g)| {
            let color = nearest(g.color);
            let gaussian = Gaussian2d { color, ..g };
            (color != g.color).then_some(Change { index: index as u32, gaussian, moments: Moments::Inherit })
        });
        Ok(EditPlan { changed: changed.collect(), ..EditPlan::default() })
    }
}
