//! Popping (§5.4, §2.3.1): whether sorting by one depth a Gaussian makes colours jump while the camera moves, whether sorting by the depth at each pixel
//! cures it, and whether it goes away as Gaussians get small.
//!
//! [`compare`] looks at any scene; [`measure`] at two that are made by formulas, in which it is known what there is to see.

mod comparison;
mod findings;
mod flicker;
mod pictures;
mod scenes;

use gs_core::{
    Blend, Camera, Optimizer, RenderSettings, Scene3d,
    effects::{Antialias, Order},
};
use pollster::FutureExt as _;

pub use self::{
    comparison::{AtStep, Comparison, Moment, ORDERS, Popping, STRIDES, SlowOrbit, VISIBLE_LEVELS, compare},
    flicker::{Flicker, flicker},
    scenes::{ball_flight, ball_in_sea, discs, discs_flight},
};
use super::{Cell, Circumstance, Claim, Extent, Findings, Laboratory, Number, Picture, Table};
use crate::figure::{Axis, Figure, Marks, Series};
use gs_train::Error;

/// Side of the pictures of the scenes made by formulas, px.
const SIDE_PX: u32 = 240;

/// The finest step there, degrees: what is farthest from the middle moves by 0.1 px.
const STEP_DEGREES: f32 = 0.062_5;

/// By how much the grid of tiles is moved, columns and rows, px: no multiple of any tile's side.
const GRID_PX: (u32, u32) = (5, 11);

/// One size of the Gaussians of the ball in the sea.
#[derive(Debug, Clone, PartialEq)]
pub struct OfSize {
    /// σ in the middle of the picture, px.
    pub sigma_px: f32,
    /// How many there are.
    pub gaussians: usize,
    /// What jumps.
    pub comparison: Comparison,
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct PoppingMeasured {
    /// Of two discs through each other, whose means' depths change their order once.
    pub discs: Comparison,
    /// Of the ball in the sea, by falling size.
    pub ball: Vec<OfSize>,
    /// The largest difference of any pixel between pictures whose tiles are at other places, 8-bit levels, by one depth a Gaussian.
    pub grid_trace: f64,
    extent: Extent,
    pictures: Vec<Picture>,
}

/// Flies around both scenes.
///
/// # Errors
/// Those of the backend.
pub fn measure<R: Optimizer<Scene3d>>(laboratory: &mut Laboratory<'_, R>) -> Result<PoppingMeasured, Error> {
    let (extent, rasterizer) = (laboratory.extent(), laboratory.rasterizer());
    let render = usual_settings();
    let mut pictures = Vec::new();

    laboratory.watch().on_fit("two discs through each other");
    let (scene, (flight, first)) = (discs(), discs_flight(SIDE_PX, 24, STEP_DEGREES));
    let of_discs = compare(rasterizer, &scene, &flight, &first, &render)?;
    let caption = findings::caption("Two discs through each other", of_discs.finest().step_degrees);
    pictures.push(pictures::picture(rasterizer, &scene, &of_discs.moment, &render, ("discs", caption))?);

    let sizes: &[f32] = extent.choose(&[16.0, 8.0, 4.0, 2.0, 1.0], &[16.0, 8.0, 4.0, 2.0]);
    let (flight, first) = ball_flight(SIDE_PX, extent.choose(8, 4), extent.choose(25, 13), STEP_DEGREES);
    let mut ball = Vec::new();
    for &sigma_px in sizes {
        laboratory.watch().on_fit(&format!("ball in a sea, Gaussians of {sigma_px} px"));
        let scene = ball_in_sea(sigma_px / scenes::px_per_unit(SIDE_PX));
        let comparison = compare(rasterizer, &scene, &flight, &first, &render)?;
        if sigma_px == sizes[0] {
            let what = format!("A ball in a sea, of Gaussians of {sigma_px} px");
            let caption = findings::caption(&what, comparison.finest().step_degrees);
            pictures.push(pictures::picture(rasterizer, &scene, &comparison.moment, &render, ("ball", caption))?);
        }
        ball.push(OfSize { sigma_px, gaussians: scene.means.len(), comparison });
    }
    let scene = ball_in_sea(sizes[0] / scenes::px_per_unit(SIDE_PX));
    let grid_trace = grid_trace(rasterizer, &scene, &first, &render)?;
    Ok(PoppingMeasured { discs: of_discs, ball, grid_trace, extent, pictures })
}

/// As 3DGS shows its scenes.
fn usual_settings() -> RenderSettings {
    let mut render = RenderSettings::blended(Blend::Over);
    render.effects.antialias = Antialias::Dilate;
    render
}

/// How much a picture depends on where tiles meet: the same through a camera whose picture begins elsewhere, so that other pixels share a
/// tile. By one depth a Gaussian; the largest difference of any pixel, 8-bit levels.
fn grid_trace<R: Optimizer<Scene3d>>(
    rasterizer: &R,
    scene: &Scene3d,
    camera: &Camera,
    render: &RenderSettings,
) -> Result<f64, Error> {
    let (right, down) = GRID_PX;
    let moved = Camera {
        center: camera.center + glam::Vec2::new(right as f32, down as f32),
        width: camera.width + right,
        height: camera.height + down,
        ..*camera
    };
    let picture = |camera| rasterizer.render(scene, camera, &comparison::ordered(render, Order::Global)).block_on();
    let (there, moved) = (picture(camera)?, picture(&moved)?);
    let difference = |(x, y): (u32, u32)| {
        let (a, b) = (there.pixel(x, y), moved.pixel(x + right, y + down));
        (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
    };
    let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    Ok(255.0 * f64::from(pixels.map(difference).fold(0.0, f32::max)))
}
