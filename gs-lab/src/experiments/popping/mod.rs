//! Popping (paper §5.4, §2.3.1): whether the global depth sort makes colours jump while the camera
//! moves, whether the per-pixel sort cures it, and whether it vanishes for small Gaussians.
//!
//! [`compare`] measures any scene; the experiment measures two synthetic scenes whose popping is
//! known.

mod findings;
mod pictures;

use gs_backend::FutureExt as _;
use gs_core::{
    Blend, Camera, Optimizer, RenderSettings, Scene3d,
    effects::{Antialias, Order},
};

use super::{Cell, ExperimentSize, Findings, Picture, Table};
use crate::price::popping::{
    AtStep, ORDERS, Popping, PoppingComparison, VISIBLE_LEVELS, ball_flight, ball_in_sea, compare, discs, discs_flight,
    ordered, px_per_unit,
};
use crate::report::figure::{Axis, Figure, Marks, Series};
use crate::result::{Circumstance, Claim, Number};
use gs_train::Error;

/// Side of the pictures of the synthetic scenes, px.
const SIDE_PX: u32 = 240;

/// The finest step, degrees: the outermost pixels move by 0.1 px.
const STEP_DEGREES: f32 = 0.062_5;

/// Shift of the tile grid, columns and rows, px: no multiple of any tile's side.
const GRID_PX: (u32, u32) = (5, 11);

/// The ball in the sea with Gaussians of one size.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct OfSize {
    /// σ in the middle of the picture, px.
    pub(crate) sigma_px: f32,
    pub(crate) gaussians: usize,
    pub(crate) comparison: PoppingComparison,
}

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoppingMeasured {
    /// Two intersecting discs, whose means change their depth order once.
    pub(crate) discs: PoppingComparison,
    /// The ball in the sea, by falling size.
    pub(crate) ball: Vec<OfSize>,
    /// Largest difference between pictures with shifted tile grids, 8-bit levels, with the global
    /// sort.
    pub(crate) grid_trace: f64,
    extent: ExperimentSize,
    pictures: Vec<Picture>,
}

/// Flies around both synthetic scenes.
pub(crate) fn measure<R: Optimizer<Scene3d>>(
    rasterizer: &R,
    extent: ExperimentSize,
    note: &dyn Fn(&str),
) -> Result<PoppingMeasured, Error> {
    let render = usual_settings();
    let mut pictures = Vec::new();

    note("two discs through each other");
    let (scene, (flight, first)) = (discs(), discs_flight(SIDE_PX, 24, STEP_DEGREES));
    let of_discs = compare(rasterizer, &scene, &flight, &first, &render)?;
    let caption = findings::caption("Two discs through each other", of_discs.finest().step_degrees);
    pictures.push(pictures::picture(rasterizer, &scene, &of_discs.moment, &render, ("discs", caption))?);

    let sizes: &[f32] = extent.choose(&[16.0, 8.0, 4.0, 2.0, 1.0], &[16.0, 8.0, 4.0, 2.0]);
    let (flight, first) = ball_flight(SIDE_PX, extent.choose(8, 4), extent.choose(25, 13), STEP_DEGREES);
    let mut ball = Vec::new();
    for &sigma_px in sizes {
        note(&format!("ball in a sea, Gaussians of {sigma_px} px"));
        let scene = ball_in_sea(sigma_px / px_per_unit(SIDE_PX));
        let comparison = compare(rasterizer, &scene, &flight, &first, &render)?;
        if sigma_px == sizes[0] {
            let what = format!("A ball in a sea, of Gaussians of {sigma_px} px");
            let caption = findings::caption(&what, comparison.finest().step_degrees);
            pictures.push(pictures::picture(rasterizer, &scene, &comparison.moment, &render, ("ball", caption))?);
        }
        ball.push(OfSize { sigma_px, gaussians: scene.means.len(), comparison });
    }
    let scene = ball_in_sea(sizes[0] / px_per_unit(SIDE_PX));
    let grid_trace = grid_trace(rasterizer, &scene, &first, &render)?;
    Ok(PoppingMeasured { discs: of_discs, ball, grid_trace, extent, pictures })
}

/// The settings with which 3DGS shows scenes.
fn usual_settings() -> RenderSettings {
    let mut render = RenderSettings::blended(Blend::Over);
    render.effects.antialias = Antialias::Dilate;
    render
}

/// How much a picture depends on the tile grid: the largest difference, in 8-bit levels, to a
/// picture with a shifted grid, with the global sort.
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
    let picture = |camera| rasterizer.render(scene, camera, &ordered(render, Order::Global)).block_on();
    let (there, moved) = (picture(camera)?, picture(&moved)?);
    let difference = |(x, y): (u32, u32)| {
        let (a, b) = (there.pixel(x, y), moved.pixel(x + right, y + down));
        (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
    };
    let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    Ok(255.0 * f64::from(pixels.map(difference).fold(0.0, f32::max)))
}

#[cfg(test)]
mod tests;
