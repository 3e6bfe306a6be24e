//! Sums over pixels, with the blending weights of Gaussians: a Gaussian's weight in a pixel is the
//! derivative of the pixel with respect to its colour.

use glam::Vec3;
use gs_core::{
    Camera, Image, Rasterizer, RenderSettings, Scene3d,
    constants::SH_C0,
    effects::{Background, Statistics},
};

use crate::error::Error;

/// α in every pixel of a footprint. A thousand Gaussians in front hide a thousandth of a pixel.
pub(crate) const FOOTPRINT_ALPHA: f32 = 1e-6;

/// Settings under which colours are constants, and their gradients are sums of weights.
pub(crate) fn colorless(render: &RenderSettings) -> RenderSettings {
    render.with(|s| {
        s.effects.sh_degree = 0;
        s.effects.background = Background::None;
        s.effects.statistics = Statistics::None;
    })
}

/// The sums of maps over the pixels with the weights of a grey scene's Gaussians, `[N, 3]`, in units of the weight
/// `unit`: 1, or for footprints [`FOOTPRINT_ALPHA`]. `render` is [`colorless`].
pub(crate) async fn color_gradients<R: Rasterizer<Scene3d>>(
    (on, grey): (&R, &R::Splats),
    camera: &Camera,
    render: &RenderSettings,
    maps: &Image,
    unit: f32,
) -> Result<Vec<Vec3>, Error> {
    let pass = on.forward(grey, camera, render).await?;
    let gradients = on.image_vjp(grey, pass, maps).await?;
    Ok(on.gradients(grey, &gradients).await?.sh.into_iter().map(|sum| sum / (SH_C0 * unit)).collect())
}

/// The sum of each Gaussian's blending weights in a view, px, `[N]`; of a grey scene, by [`colorless`] settings.
pub(crate) async fn blending_weights<R: Rasterizer<Scene3d>>(
    grey: (&R, &R::Splats),
    camera: &Camera,
    render: &RenderSettings,
) -> Result<Vec<f32>, Error> {
    let ones = Image::filled(camera.width, camera.height, [1.0; 3])?;
    Ok(color_gradients(grey, camera, render, &ones, 1.0).await?.into_iter().map(|sum| sum.x).collect())
}
