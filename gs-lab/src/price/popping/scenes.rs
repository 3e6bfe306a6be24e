//! Synthetic scenes in which sort orders differ: two intersecting discs, and a ball in a sea.

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec3};
use gs_core::{Camera, Gaussian3d, Scene as _, Scene3d, constants::SH_C0, logit};
use gs_density::Rng;
use rand::{RngExt as _, SeedableRng as _};

use super::comparison::SlowOrbit;
use gs_core::view::Orbit;

/// Horizontal field of view, rad.
const FIELD_OF_VIEW: f32 = 0.7;

/// Distance of the cameras from the origin, world units.
const DISTANCE: f32 = 4.0;

/// Two intersecting flat Gaussians, a warm and a cold one, each with one half in front. Their means
/// swap the order of their depths in the middle of a flight around them.
pub(crate) fn discs() -> Scene3d {
    let turned = |degrees: f32| Quat::from_rotation_y(degrees.to_radians());
    let disc = |side: f32, color: Vec3| {
        // The normal of a flat Gaussian is its z axis.
        flat(Vec3::new(0.05 * side, 0.0, 0.0), turned(35.0 * side), 0.4, color)
    };
    let mut scene = Scene3d::default();
    scene.push(disc(-1.0, Vec3::new(0.9, 0.45, 0.1)));
    scene.push(disc(1.0, Vec3::new(0.1, 0.4, 0.9)));
    scene
}

/// A flight of one stretch around [`discs`] with its first camera, of a square of `side` px. The
/// means have equal depths in its middle, between two frames if `frames` is even.
pub(crate) fn discs_flight(side: u32, frames: u32, step_degrees: f32) -> (SlowOrbit, Camera) {
    let orbit = Orbit { center: Vec3::ZERO, axis: Vec3::NEG_Y, frames: 1 };
    let ahead = camera(side, Vec3::NEG_Z);
    let back = -0.5 * (frames as f32 - 1.0) * step_degrees;
    (SlowOrbit { orbit, frames, step_degrees }, orbit.turned(&ahead, back.to_radians()))
}

/// A striped ball, half sunk in a sea of waves. Both are covered with flat Gaussians of σ = `size`
/// world units that lie in the surface up to a few degrees, with a density in proportion. The
/// picture does not depend on the size, except for smaller details.
pub(crate) fn ball_in_sea(size: f32) -> Scene3d {
    let mut random = Rng::seed_from_u64(0);
    let mut scene = Scene3d::default();
    let area = (SPACING * size).powi(2);
    let mut cover = |count: f32, surface: &dyn Fn(f32, f32) -> (Vec3, Vec3, Vec3)| {
        let count = count.ceil().max(1.0) as u32;
        for index in 0..count {
            // Points as on a sunflower (Vogel 1979): equal areas, no rows. The angle is in f64
            // because it grows to many turns.
            let (share, turn) = ((index as f32 + 0.5) / count as f32, f64::from(index) * GOLDEN_TURN);
            let (mean, normal, color) = surface(share, TAU * turn.fract() as f32);
            let mut tilt = || (random.random::<f32>() - 0.5) * 2.0 * TILT;
            let tilted = normal + Vec3::new(tilt(), tilt(), tilt());
            let turned = Quat::from_rotation_arc(Vec3::Z, tilted.normalize_or(Vec3::Z));
            scene.push(flat(mean, turned, size, color));
        }
    };
    cover(4.0 * PI * BALL * BALL / area, &|share, angle| {
        let height = 1.0 - 2.0 * share;
        let normal = Vec3::new(
            (1.0 - height * height).sqrt() * angle.cos(),
            height,
            (1.0 - height * height).sqrt() * angle.sin(),
        );
        let stripe = 0.5 + 0.5 * (5.0 * angle + 3.0 * height).sin();
        (BALL * normal, normal, Vec3::new(0.9, 0.15 + 0.7 * stripe, 0.1))
    });
    cover(PI * SEA * SEA / area, &|share, angle| {
        let (radius, wave) = (SEA * share.sqrt(), 6.0);
        let (x, z) = (radius * angle.cos(), radius * angle.sin());
        let (along, across) = ((wave * x).sin(), (wave * z + 1.0).sin());
        let slope =
            Vec3::new(0.05 * wave * (wave * x).cos() * across, -1.0, 0.05 * wave * along * (wave * z + 1.0).cos());
        let crest = 0.5 + 0.5 * along * across;
        let color = Vec3::new(0.05 + 0.5 * crest, 0.25 + 0.5 * crest, 0.5 + 0.4 * crest);
        (Vec3::new(x, 0.05 * along * across, z), slope.normalize(), color)
    });
    scene
}

/// The whole orbit around [`ball_in_sea`] with its first camera, of a square of `side` px.
pub(crate) fn ball_flight(side: u32, places: u32, frames: u32, step_degrees: f32) -> (SlowOrbit, Camera) {
    let orbit = Orbit { center: Vec3::ZERO, axis: Vec3::NEG_Y, frames: places };
    // Slightly from above; y points down.
    (SlowOrbit { orbit, frames, step_degrees }, camera(side, Vec3::new(0.0, -0.5, -0.866)))
}

/// Pixels per world unit at the scene's centre, in a picture of `side` px.
pub(crate) fn px_per_unit(side: u32) -> f32 {
    Camera::looking_forward(side, side, FIELD_OF_VIEW).focal.x / DISTANCE
}

/// Radius of the ball, world units.
const BALL: f32 = 0.6;

/// Radius of the sea, world units.
const SEA: f32 = 1.15;

/// Distance of neighbours, σ.
const SPACING: f32 = 1.25;

/// Largest deviation of normals from the surface's, as a slope. Without it, neighbours would lie in
/// one plane, and rounding would decide which is in front, unlike in trained scenes.
const TILT: f32 = 0.1;

/// 1 − 1/φ of a turn.
const GOLDEN_TURN: f64 = 0.381_966_011_250_105_1;

/// A flat Gaussian, a tenth as thick as wide, with an opacity of 0.9.
fn flat(mean: Vec3, turned: Quat, size: f32, color: Vec3) -> Gaussian3d {
    Gaussian3d {
        mean,
        log_scale: Vec3::new(size, size, 0.1 * size).map(f32::ln),
        rotation: [turned.w, turned.x, turned.y, turned.z],
        opacity_logit: logit(0.9),
        sh: vec![(color - 0.5) / SH_C0],
    }
}

fn camera(side: u32, towards: Vec3) -> Camera {
    let lens = Camera::looking_forward(side, side, FIELD_OF_VIEW);
    lens.looking_at(DISTANCE * towards, Vec3::ZERO, Vec3::NEG_Y).unwrap_or(lens)
}
