//! Popping of scenes whose popping is known.

use glam::Vec3;
use gs_core::{Gaussian3d, Scene as _};
use gs_cpu::{CpuRasterizer, CpuSettings};

use super::*;
use crate::price::popping::SlowOrbit;

fn flown(scene: &Scene3d, step_degrees: f32) -> PoppingComparison {
    let (flight, first) = discs_flight(96, 16, step_degrees);
    let mut render = RenderSettings::blended(Blend::Over);
    render.effects.antialias = Antialias::Dilate;
    // A high α cut would leave visible rims.
    render.accuracy.alpha_cut = 1e-6;
    compare(CpuRasterizer::new(CpuSettings::default()).unwrap().for_3d(), scene, &flight, &first, &render).unwrap()
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
    let [tile, pixel] = moved.finest().orders.each_ref().map(|popping| popping.highest);
    assert!(tile > 0.05 && (tile - pixel).abs() < 1e-3 * tile, "{tile} {pixel}");
    for steps in moved.steps.windows(2) {
        let left = steps[0].tile().highest / steps[1].tile().highest;
        assert!((0.2..0.3).contains(&left), "{left}");
        // Squares per degree fall to an eighth.
        let left = steps[0].tile().squares() / steps[1].tile().squares();
        assert!((0.08..0.17).contains(&left), "{left}");
    }
    let jumped = flown(&discs(), 0.05);
    for steps in jumped.steps.windows(2) {
        let left = steps[0].tile().highest / steps[1].tile().highest;
        assert!((0.98..1.02).contains(&left), "{left}");
    }
    // The camera turns by 15 steps, during which each pixel jumps once.
    let turned = 15.0 * 0.05;
    let share = jumped.finest().tile().times() * turned;
    assert!((0.1..0.5).contains(&share), "{share}");
    assert_eq!(jumped.finest().pixel().times(), 0.0);
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
        SlowOrbit { orbit: gs_core::view::Orbit { frames: 0, ..flight.orbit }, ..flight },
    ] {
        assert!(bad.stretches(&first).is_err(), "{bad:?}");
    }
}

#[test]
fn the_claims_are_judged_by_what_jumps() {
    let of_size = |sigma_px: f32, scene: &Scene3d| OfSize { sigma_px, gaussians: 2, comparison: flown(scene, 0.05) };
    let verdicts = |discs: &Scene3d, ball: [OfSize; 2]| {
        let (is_quick, pictures) = (true, Vec::new());
        let measured =
            PoppingMeasured { discs: flown(discs, 0.05), ball: ball.into(), grid_trace: 0.0, is_quick, pictures };
        let claims = measured.findings().claims;
        let held = |claim: &Claim| claim.circumstances.iter().map(|c| (c.held, c.of)).collect::<Vec<_>>();
        (held(&claims[0]), held(&claims[1]))
    };
    let (large, small) = (|| of_size(16.0, &discs()), || of_size(8.0, &one_disc()));
    let (pop, negligible) = verdicts(&discs(), [large(), small()]);
    assert_eq!((&pop[..2], pop[3], &negligible[..]), (&[(1, 1); 2][..], (0, 1), &[(1, 1), (1, 1)][..]), "{pop:?}");
    // Where nothing jumps, or the smaller Gaussians do, the claims do not hold.
    let (pop, negligible) = verdicts(&one_disc(), [small(), large()]);
    assert_eq!((pop[0], &negligible[..]), ((0, 1), &[(0, 1), (0, 1)][..]), "{pop:?}");
}
