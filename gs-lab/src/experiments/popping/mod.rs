//! Popping (paper §5.4, §2.3.1): whether the global depth sort makes colours jump while the camera
//! moves, whether the per-pixel sort cures it, and whether it vanishes for small Gaussians.
//!
//! [`compare`] measures any scene; the experiment measures two synthetic scenes whose popping is
//! known.

mod findings;

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{
    Blend, Camera, Rasterizer as _, RenderSettings, Scene3d,
    effects::{Antialias, Order},
};
use gs_train::Error;

use crate::{
    price::popping::{
        ORDERS, PoppingComparison, STEP_COLUMNS, VISIBLE_LEVELS, ball_flight, ball_in_sea, compare, discs,
        discs_flight, ordered, picture, px_per_unit, rows, trajectory_chart,
    },
    report::{
        Cell, Findings, Picture, Table,
        figure::{Axis, Figure, Marks, Series},
    },
    result::{Circumstance, Claim, Number},
};

/// Side of the pictures of the synthetic scenes, px.
const SIDE_PX: u32 = 240;

/// The finest step, degrees: the outermost pixels move by 0.1 px.
const STEP_DEGREES: f32 = 0.062_5;

/// Shift of the tile grid, columns and rows, px: no multiple of any tile's side.
const GRID_PX: (u32, u32) = (5, 11);

/// The ball in the sea with Gaussians of one size.
#[derive(Debug, Clone, PartialEq)]
struct OfSize {
    /// σ in the middle of the picture, px.
    sigma_px: f32,
    gaussians: usize,
    comparison: PoppingComparison,
}

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
struct PoppingMeasured {
    /// Two intersecting discs, whose means change their depth order once.
    discs: PoppingComparison,
    /// The ball in the sea, by falling size.
    ball: Vec<OfSize>,
    /// Largest difference between pictures with shifted tile grids, 8-bit levels, with the global
    /// sort.
    grid_trace: f64,
    is_quick: bool,
    pictures: Vec<Picture>,
}

/// Flies around both synthetic scenes.
pub(super) fn measure(on: &AnyRasterizer, is_quick: bool, note: &dyn Fn(&str)) -> Result<Findings, Error> {
    let render = usual_settings();
    let mut pictures = Vec::new();

    note("two discs through each other");
    let (scene, (flight, first)) = (discs(), discs_flight(SIDE_PX, 24, STEP_DEGREES));
    let of_discs = compare(on, &scene, &flight, &first, &render)?;
    pictures.push(picture(on, &scene, &of_discs, &render, ("discs", "Two discs through each other"))?);

    let (places, frames, smallest) = if is_quick { (4, 13, 2.0) } else { (8, 25, 1.0) };
    let sizes = [16.0, 8.0, 4.0, 2.0, 1.0].into_iter().filter(|&size| size >= smallest);
    let (flight, first) = ball_flight(SIDE_PX, places, frames, STEP_DEGREES);
    let mut ball = Vec::new();
    let mut grid_trace = 0.0;
    for sigma_px in sizes {
        note(&format!("ball in a sea, Gaussians of {sigma_px} px"));
        let scene = ball_in_sea(sigma_px / px_per_unit(SIDE_PX));
        let comparison = compare(on, &scene, &flight, &first, &render)?;
        if ball.is_empty() {
            let what = format!("A ball in a sea, of Gaussians of {sigma_px} px");
            pictures.push(picture(on, &scene, &comparison, &render, ("ball", &what))?);
            grid_trace = trace_of_grid(on, &scene, &first, &render)?;
        }
        ball.push(OfSize { sigma_px, gaussians: scene.means.len(), comparison });
    }
    Ok(PoppingMeasured { discs: of_discs, ball, grid_trace, is_quick, pictures }.findings())
}

/// The settings with which 3DGS shows scenes.
fn usual_settings() -> RenderSettings {
    let mut render = RenderSettings::blended(Blend::Over);
    render.effects.antialias = Antialias::Dilate;
    render
}

/// How much a picture depends on the tile grid: the largest difference, in 8-bit levels, to a
/// picture with a shifted grid, with the global sort.
fn trace_of_grid(on: &AnyRasterizer, scene: &Scene3d, camera: &Camera, render: &RenderSettings) -> Result<f64, Error> {
    let (right, down) = GRID_PX;
    let moved = Camera {
        center: camera.center + glam::Vec2::new(right as f32, down as f32),
        width: camera.width + right,
        height: camera.height + down,
        ..*camera
    };
    let picture = |camera| on.for_3d().render(scene, camera, &ordered(render, Order::Global)).block_on();
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
