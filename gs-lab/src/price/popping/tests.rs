//! Popping of scenes whose popping is known.

use glam::{Quat, Vec3};
use gs_core::{
    Blend, Camera, Gaussian3d, RenderSettings, Scene as _, Scene3d, constants::SH_C0, effects::Antialias, logit,
    view::Orbit,
};
use gs_cpu::{CpuRasterizer, CpuSettings};

use super::{
    comparison::{PoppingComparison, SlowOrbit, compare},
    ways::Orders,
};
use crate::price::Loaded;

/// Two intersecting flat Gaussians, a warm and a cold one, each with one half in front. Their means
/// swap the order of their depths in the middle of a flight around them.
fn discs() -> Scene3d {
    let disc = |side: f32, color: Vec3| {
        // The normal of a flat Gaussian is its z axis.
        let turned = Quat::from_rotation_y((35.0 * side).to_radians());
        Gaussian3d {
            mean: Vec3::new(0.05 * side, 0.0, 0.0),
            log_scale: Vec3::new(0.4, 0.4, 0.04).map(f32::ln),
            rotation: [turned.w, turned.x, turned.y, turned.z],
            opacity_logit: logit(0.9),
            sh: vec![(color - 0.5) / SH_C0],
        }
    };
    [disc(-1.0, Vec3::new(0.9, 0.45, 0.1)), disc(1.0, Vec3::new(0.1, 0.4, 0.9))].into_iter().collect()
}

/// A flight of one stretch around [`discs`] with its first camera, of a square of `side` px. The
/// means have equal depths in its middle, between two frames if `frames` is even.
fn discs_flight(side: u32, frames: u32, step_degrees: f32) -> (SlowOrbit, Camera) {
    let orbit = Orbit { center: Vec3::ZERO, axis: Vec3::NEG_Y, frames: 1 };
    let lens = Camera::looking_forward(side, side, 0.7);
    let ahead = lens.looking_at(4.0 * Vec3::NEG_Z, Vec3::ZERO, Vec3::NEG_Y).unwrap();
    let back = -0.5 * (frames as f32 - 1.0) * step_degrees;
    (SlowOrbit { orbit, frames, step_degrees }, orbit.turned(&ahead, back.to_radians()))
}

fn flown(scene: &Scene3d, step_degrees: f32) -> PoppingComparison {
    let (flight, first) = discs_flight(96, 16, step_degrees);
    let mut render = RenderSettings::blended(Blend::Over);
    render.effects.antialias = Antialias::Dilate;
    // A high α cut would leave visible rims.
    render.accuracy.alpha_cut = 1e-6;
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let on = Loaded::new(cpu.for_3d(), scene).unwrap();
    compare(&mut Orders { on, render }, &flight, &first).unwrap()
}

/// A single disc off the axis, so that it moves across the picture.
fn one_disc() -> Scene3d {
    let mut scene = Scene3d::default();
    scene.push(Gaussian3d { mean: Vec3::new(0.3, 0.0, -1.0), ..discs().gaussian(0) });
    scene
}

/// A single disc has no order: half the step leaves a quarter of the motion, with either order.
/// With two discs, a jump remains.
#[test]
fn motion_goes_with_the_step_and_a_jump_stays() {
    let moved = flown(&one_disc(), 0.5);
    let [tile, pixel] = moved.finest().ways.each_ref().map(|popping| popping.highest);
    assert!(tile > 0.05 && (tile - pixel).abs() < 1e-3 * tile, "{tile} {pixel}");
    for steps in moved.steps.windows(2) {
        let left = steps[0].ways[0].highest / steps[1].ways[0].highest;
        assert!((0.2..0.3).contains(&left), "{left}");
        // Squares per degree fall to an eighth.
        let left = steps[0].ways[0].squares() / steps[1].ways[0].squares();
        assert!((0.08..0.17).contains(&left), "{left}");
    }
    let jumped = flown(&discs(), 0.05);
    for steps in jumped.steps.windows(2) {
        let left = steps[0].ways[0].highest / steps[1].ways[0].highest;
        assert!((0.98..1.02).contains(&left), "{left}");
    }
    // The camera turns by 15 steps, during which each pixel jumps once.
    let turned = 15.0 * 0.05;
    let share = jumped.finest().ways[0].times() * turned;
    assert!((0.1..0.5).contains(&share), "{share}");
    assert_eq!(jumped.finest().ways[1].times(), 0.0);
    let middle = jumped.moment.pixel;
    assert!(middle.0.abs_diff(48) < 16 && middle.1.abs_diff(48) < 16, "{middle:?}");
}

#[test]
fn a_flight_that_is_not_possible_is_refused() {
    let (flight, first) = discs_flight(16, 9, 1.0);
    assert_eq!(flight.stretches(&first).unwrap()[0].len(), 9);
    for bad in [
        SlowOrbit { frames: 8, ..flight },
        SlowOrbit { frames: 1_000_000, ..flight },
        SlowOrbit { step_degrees: 0.0, ..flight },
        SlowOrbit { step_degrees: f32::NAN, ..flight },
        SlowOrbit { orbit: Orbit { frames: 0, ..flight.orbit }, ..flight },
    ] {
        assert!(bad.stretches(&first).is_err(), "{bad:?}");
    }
}
