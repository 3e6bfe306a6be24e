//! Cases of wrong arguments with 3D scenes and cameras, which must be typed errors.

use glam::{Mat3, Vec2, Vec3};
use gs_core::{Camera, Error, Optimizer, Parameterization, Scene3d, effects::Blend};

use super::errors::{SETTING, SIZE, bad_are_errors, refused};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind3d},
};

fn draw() -> Draw<Scene3d> {
    Draw::for_3d(Kind3d::Typical, Blend::Over, 6, (10, 10), 2403)
}

/// Scenes with values that are not finite, arrays of different lengths or an invalid degree are
/// refused.
pub(crate) fn scenes_3d_that_are_not_finite_are_refused<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let mut wrong = vec![draw().scene; 7];
    wrong[0].means[3].z = f32::NAN;
    wrong[1].log_scales[5].y = f32::INFINITY;
    wrong[2].rotations[0][3] = f32::NEG_INFINITY;
    wrong[3].opacity_logits[2] = f32::NAN;
    wrong[4].sh[20].z = f32::NAN;
    wrong[5].sh.pop();
    wrong[6].sh_degree = 4;
    for (i, scene) in wrong.iter().enumerate() {
        refused(&format!("broken scene {i}"), rasterizer.upload(scene, Parameterization::ScaleRotation), |error| {
            match error {
                Error::NotFinite { .. } => i < 5,
                Error::Length { .. } => i == 5,
                Error::Setting { .. } => i == 6,
                _ => false,
            }
        })?;
    }
    Ok(())
}

/// Invalid cameras, settings and losses are errors, in a forward pass and in a training step, which
/// then changes nothing. Effects and parameterizations without support are [`Error::Unsupported`].
pub(crate) fn bad_cameras_and_settings_are_errors<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let draw = draw();
    let view = draw.view;
    let views = [
        ("a camera of no columns", Camera { width: 0, ..view }, SIZE),
        ("a camera of 20000 rows", Camera { height: 20_000, ..view }, SIZE),
        ("a camera that stretches", Camera { rotation: view.rotation * 1.1, ..view }, SETTING),
        ("a mirrored camera", Camera { rotation: -view.rotation, ..view }, SETTING),
        ("a camera of NaN rotation", Camera { rotation: Mat3::NAN, ..view }, SETTING),
        ("a camera at infinity", Camera { translation: Vec3::INFINITY, ..view }, SETTING),
        ("a camera of no focal length", Camera { focal: Vec2::new(0.0, 9.0), ..view }, SETTING),
        ("a camera of NaN focal length", Camera { focal: Vec2::NAN, ..view }, SETTING),
        ("a principal point at infinity", Camera { center: Vec2::INFINITY, ..view }, SETTING),
        ("a near plane behind", Camera { near: -1.0, ..view }, SETTING),
        ("a NaN near plane", Camera { near: f32::NAN, ..view }, SETTING),
    ];
    bad_are_errors(rasterizer, &draw, &views)
}
