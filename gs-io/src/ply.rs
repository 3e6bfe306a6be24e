//! Export of planar scenes to the PLY of 3DGS, so that any splat viewer shows a fit as a flat scene.
//!
//! World: the canvas lies in the plane z = 0, centred at the origin, its longer side 2 units long. x points right, **y down and
//! z away from the viewer**, the axes of scenes trained on COLMAP cameras; a viewer that has y up shows the picture upside down
//! until told otherwise. To see it, look along +z from (0, 0, −2).
//!
//! What is lost: the order of blending is turned into depth, a tiny step behind each Gaussian, which viewers that sort coarsely
//! may confuse. Viewers blur each Gaussian by 0.3 px² of their own, have no negative colours, and no background of the scene's.
//! None of them adds Gaussians up as [`Blend::Sum`] does: see [`PlyColors`].

use std::path::Path;

use gs_core::{Blend, Image, PlanarGaussian, Scene};
use serde::Serialize;
use serde_ply::SerializeOptions;

use crate::{PlanarFile, atomic::write_atomically, error::Error, spatial::SH_0};

/// Length of the canvas's longer side, world units.
const EXTENT_WORLD: f32 = 2.0;

/// Standard deviation across the plane, world units: flat, yet not degenerate.
const THICKNESS_WORLD: f32 = 1e-4 * EXTENT_WORLD;

/// Depth from one Gaussian to the next, world units: two steps of `f32` at a distance of 2 to 4, where the canvas fills a view.
const DEPTH_STEP_WORLD: f32 = 5e-7;

/// Depth of the whole stack at most, world units: more would show as parallax at the picture's border (a hundredth of its
/// half width from a distance of 2).
const MAX_DEPTH_WORLD: f32 = 0.02;

/// Opacity logits are written between −this and this: not all viewers read ±∞, and 1/(1 + e⁻¹⁶) is 1 to a ten-millionth.
const MAX_LOGIT: f32 = 16.0;

/// Opacity given to the Gaussians of a [`Blend::Sum`] scene: nearly opaque, so that the canvas does not shine through.
const SUM_OPACITY: f32 = 0.9;

/// Where the colours of an exported scene come from.
#[derive(Debug, Clone, Copy)]
pub enum PlyColors<'a> {
    /// The scene's own: what [`Blend::Over`] means. Those of a [`Blend::Sum`] scene are shares of a sum that no viewer forms;
    /// it looks dim and torn.
    Stored,
    /// The picture's at each Gaussian's mean: the way to show a [`Blend::Sum`] scene. With an opacity of 0.9 and the smaller
    /// Gaussians in front it looks like the picture, somewhat coarser. The picture is that of the whole canvas, at any size.
    Sampled(&'a Image),
}

/// One row of the PLY's only element, in the order of 3DGS; degree 0, so no `f_rest`.
#[derive(Serialize)]
struct Vertex {
    x: f32,
    y: f32,
    z: f32,
    nx: f32,
    ny: f32,
    nz: f32,
    f_dc_0: f32,
    f_dc_1: f32,
    f_dc_2: f32,
    opacity: f32,
    scale_0: f32,
    scale_1: f32,
    scale_2: f32,
    rot_0: f32,
    rot_1: f32,
    rot_2: f32,
    rot_3: f32,
}

#[derive(Serialize)]
struct Splats {
    vertex: Vec<Vertex>,
}

/// Writes the scene as a binary little-endian 3DGS PLY, atomically. Vertices are in the scene's order, whatever their depth.
///
/// # Errors
/// [`Error::Content`] where [`PlanarFile::validate`] fails or the scene is empty; those of
/// [`write_atomically`](crate::write_atomically).
pub fn write_ply(path: impl AsRef<Path>, file: &PlanarFile, colors: PlyColors<'_>) -> Result<(), Error> {
    let path = path.as_ref();
    file.validate().map_err(Error::content(path))?;
    if file.scene.is_empty() {
        let source = gs_core::Error::State("a scene without Gaussians has nothing to show in a viewer".to_owned());
        return Err(Error::content(path)(source));
    }
    let ranks = depth_ranks(file);
    let step = DEPTH_STEP_WORLD.min(MAX_DEPTH_WORLD / ranks.len() as f32);
    let vertex = file.scene.iter().zip(ranks).map(|(g, rank)| vertex(&g, file, colors, rank as f32 * step)).collect();
    let options =
        SerializeOptions::binary_le().with_comments(vec!["x right, y down, z away from the viewer".to_owned()]);
    write_atomically(path, |file| serde_ply::to_writer(&Splats { vertex }, options, file).map_err(|e| e.0))
}

/// The place of each Gaussian in the stack, 0 in front: the scene's order, or the smallest first where order has no meaning.
fn depth_ranks(file: &PlanarFile) -> Vec<u32> {
    let mut order: Vec<u32> = (0..file.scene.len() as u32).collect();
    if file.settings.effects.blend == Blend::Sum {
        let log_area = |i: u32| file.scene.log_scales[i as usize].element_sum();
        order.sort_by(|&i, &j| log_area(i).total_cmp(&log_area(j))); // stable: ties by index
    }
    let mut ranks = vec![0; order.len()];
    order.iter().enumerate().for_each(|(rank, &i)| ranks[i as usize] = rank as u32);
    ranks
}

fn vertex(g: &PlanarGaussian, file: &PlanarFile, colors: PlyColors<'_>, depth: f32) -> Vertex {
    let size = glam::Vec2::new(file.width as f32, file.height as f32);
    let world_per_px = EXTENT_WORLD / size.max_element();
    let mean = (g.mean - 0.5 * size) * world_per_px;
    let color = match colors {
        PlyColors::Stored => g.color.to_array(),
        PlyColors::Sampled(picture) => {
            let (columns, rows) = picture.size();
            // A saturating cast: a mean outside the canvas takes the colour of the nearest border.
            let x = (g.mean.x / size.x * columns as f32) as u32;
            let y = (g.mean.y / size.y * rows as f32) as u32;
            picture.pixel(x.min(columns - 1), y.min(rows - 1))
        }
    };
    let [f_dc_0, f_dc_1, f_dc_2] = color.map(|c| (c - 0.5) / SH_0);
    let logit = match file.settings.effects.blend {
        Blend::Over => g.opacity_logit,
        Blend::Sum => gs_core::scene::logit(SUM_OPACITY),
    };
    let (sin, cos) = (0.5 * g.rotation).sin_cos(); // a turn by θ about +z: (cos θ/2, 0, 0, sin θ/2)
    Vertex {
        x: mean.x,
        y: mean.y,
        z: depth,
        nx: 0.0,
        ny: 0.0,
        nz: 0.0,
        f_dc_0,
        f_dc_1,
        f_dc_2,
        opacity: logit.clamp(-MAX_LOGIT, MAX_LOGIT),
        scale_0: g.log_scale.x + world_per_px.ln(),
        scale_1: g.log_scale.y + world_per_px.ln(),
        scale_2: THICKNESS_WORLD.ln(),
        rot_0: cos,
        rot_1: 0.0,
        rot_2: 0.0,
        rot_3: sin,
    }
}
