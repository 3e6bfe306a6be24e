//! Export of 2D scenes to the PLY of 3DGS: a flat 3D scene that splat viewers show as the picture.
//!
//! The picture lies in the plane z = 0, centred at the origin; its longer side is [`PICTURE_WORLD`]
//! long. x points right, **y down and z away from the viewer**, as in scenes trained on COLMAP
//! cameras. A viewer with y up shows the picture upside down unless configured otherwise. Look at
//! it along +z from (0, 0, −[`PICTURE_DISTANCE_WORLD`]). A comment in the header, `gs picture WxH`,
//! gives its size in pixels.
//!
//! Only scenes blended [`Blend::Over`] can be written, because no viewer sums Gaussians as
//! [`Blend::Sum`] does. Viewers differ from the renderer of 2D scenes in three more ways: they
//! dilate each Gaussian by 0.3 px², clamp negative colours to 0, and do not know the background.
//! `gs_train::viewable` turns any 2D scene into one for which none of this matters.
//!
//! The order of blending becomes depth: each Gaussian lies slightly behind the one before. It is
//! enlarged in proportion to its distance, so that the depth is invisible from the intended place.

use std::path::Path;

use glam::Vec3;
use gs_core::{
    Blend, Gaussian2d, Gaussian3d, Scene, Scene3d,
    constants::SH_C0,
    effects::{Antialias, Order},
};

use super::File2d;
use crate::{
    atomic::write_durably,
    error::Error,
    scene3d::{TrainedWith, ply},
};

/// Length of the longer side of an exported picture, world units.
pub const PICTURE_WORLD: f32 = 2.0;

/// Distance from which an exported picture is meant to be seen, world units.
pub const PICTURE_DISTANCE_WORLD: f32 = 3.0;

/// Standard deviation across the plane, world units: flat, but not degenerate.
const THICKNESS_WORLD: f32 = 1e-4 * PICTURE_WORLD;

/// Depth between successive Gaussians, world units: two steps of `f32` at a distance of 2 to 4,
/// where the picture fills a view.
const DEPTH_STEP_WORLD: f32 = 5e-7;

/// Largest depth of all Gaussians together, world units. More would be visible as parallax from
/// other places.
const MAX_DEPTH_WORLD: f32 = 0.02;

/// Largest magnitude of opacity logits that are written: not all viewers read ±∞, and 1/(1 + e⁻¹⁶)
/// is 1 to seven digits.
const MAX_LOGIT: f32 = 16.0;

/// Writes the scene as a binary little-endian 3DGS PLY, atomically. Vertices are in the scene's
/// order.
///
/// # Errors
/// Those of [`flat_scene`], as [`Error::Content`], and of [`write_durably`](crate::write_durably).
pub fn write_ply(path: impl AsRef<Path>, file: &File2d) -> Result<(), Error> {
    let path = path.as_ref();
    let scene = flat_scene(file).map_err(Error::content(path))?;
    let axes = "x right, y down, z away from the viewer".to_owned();
    let shown =
        TrainedWith { antialias: Some(Antialias::Dilate), order: Some(Order::Global), ..TrainedWith::default() };
    let comments = [vec![axes, ply::picture_comment(file.width, file.height)], shown.comments()].concat();
    write_durably(path, |out| ply::write(&scene, &comments, None, out))
}

/// The 3D scene that [`write_ply`] writes.
///
/// # Errors
/// Those of [`File2d::validate`]; [`gs_core::Error::State`] for a scene that is empty or blended by
/// [`Blend::Sum`].
pub fn flat_scene(file: &File2d) -> Result<Scene3d, gs_core::Error> {
    file.validate()?;
    if file.scene.is_empty() {
        return Err(gs_core::Error::State("a scene without Gaussians has nothing to show in a viewer".to_owned()));
    }
    if file.settings.effects.blend == Blend::Sum {
        let message = "its Gaussians are added up (blend sum), which no viewer does; convert it to blend over first";
        return Err(gs_core::Error::State(message.to_owned()));
    }
    let mut flat = Scene3d::default();
    let step = DEPTH_STEP_WORLD.min(MAX_DEPTH_WORLD / file.scene.len() as f32);
    file.scene.iter().enumerate().for_each(|(rank, g)| flat.push(flat_gaussian(&g, file, rank as f32 * step)));
    Ok(flat)
}

fn flat_gaussian(g: &Gaussian2d, file: &File2d, depth: f32) -> Gaussian3d {
    let size = glam::Vec2::new(file.width as f32, file.height as f32);
    let world_per_px = PICTURE_WORLD / size.max_element() * (1.0 + depth / PICTURE_DISTANCE_WORLD);
    let (sin, cos) = (0.5 * g.rotation).sin_cos(); // a turn by θ about +z: (cos θ/2, 0, 0, sin θ/2)
    Gaussian3d {
        mean: ((g.mean - 0.5 * size) * world_per_px).extend(depth),
        log_scale: (g.log_scale + world_per_px.ln()).extend(THICKNESS_WORLD.ln()),
        rotation: [cos, 0.0, 0.0, sin],
        opacity_logit: g.opacity_logit.clamp(-MAX_LOGIT, MAX_LOGIT),
        sh: vec![(g.color - Vec3::splat(0.5)) / SH_C0],
    }
}
