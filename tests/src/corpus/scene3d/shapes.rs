//! 3D Gaussians of extreme shapes.

use std::f32::consts::PI;

use glam::{Quat, Vec2, Vec3};
use gs_core::{Culled, Gaussian3d, Scene3d, effects::Antialias};

use super::common::{ANTIALIASES, antialiased, case, plain, seen, summed};
use crate::corpus::case::{Case, Slopes, Source, Training};

pub(super) fn cases() -> Vec<Case<Scene3d>> {
    [thin(), needles(), sizes(), quaternions()].into_iter().flatten().collect()
}

fn quaternion(q: Quat) -> [f32; 4] {
    [q.w, q.x, q.y, q.z]
}

fn thin() -> Vec<Case<Scene3d>> {
    // Discs of a scale along their axis that ends at 0 in f32, seen from the front, obliquely and,
    // at the height of the camera, edge-on.
    let discs = || {
        let thin = [1e-2, 1e-6, 1e-20, 0.0];
        let turns = [0.0, 0.8, 0.5 * PI];
        thin.into_iter().enumerate().flat_map(move |(i, thin)| {
            turns.into_iter().enumerate().map(move |(k, turn)| Gaussian3d {
                log_scale: Vec3::new(-0.8, -0.9, if thin > 0.0 { f32::ln(thin) } else { -120.0 }),
                rotation: quaternion(Quat::from_rotation_x(turn)),
                ..seen(Vec2::new(3.0 + 5.0 * i as f32, [4.0, 15.0, 9.5][k]), 4.0 + k as f32, Vec3::ONE)
            })
        })
    };
    let points = || {
        [0.3f32, 0.05, 1e-3, 1e-10, 1e-30]
            .into_iter()
            .enumerate()
            .map(|(i, scale)| seen(Vec2::new(3.5 + 4.0 * i as f32, 8.5), 2.0, Vec3::splat(scale)))
    };
    let mut cases = Vec::new();
    for antialias in ANTIALIASES {
        let singular = "Σ is singular: det Σ is 0 edge-on, and the compensation's derivative divides by it";
        // Edge-on, 1e-2 is the thinnest whose det Σ′ is not below 1e-6 px⁴.
        let (discs_left, points_left) = match antialias {
            Antialias::None => {
                (Culled { degenerate: 3, ..Culled::default() }, Culled { degenerate: 3, ..Culled::default() })
            }
            Antialias::Dilate => Default::default(),
            // Without area, ρ = 0 and with it the opacity.
            Antialias::Mip | Antialias::Compensated => {
                (Culled { transparent: 3, ..Culled::default() }, Culled { transparent: 3, ..Culled::default() })
            }
        };
        let of_paper = Source::Paper("§3.4.2");
        cases.push(
            antialiased(case("scale → 0 in one axis", singular, of_paper, discs()), antialias)
                .leaving_out(discs_left)
                .sloping(Slopes::Leading("what is 0 by symmetry is a rounding of the quaternion off it")),
        );
        cases.push(
            antialiased(
                case(
                    "scale → 0 in all axes",
                    "Σ is 0, and so is what its inverse is divided by",
                    Source::Report("https://github.com/graphdeco-inria/gaussian-splatting/issues/41"),
                    points(),
                ),
                antialias,
            )
            .leaving_out(points_left),
        );
    }
    cases
}

fn needles() -> Vec<Case<Scene3d>> {
    let why = "three axes of ten decades: what is seen of the short ones is a difference of the long one's terms";
    let source = Source::Report("https://github.com/nerfstudio-project/gsplat/issues/248");
    let needle = |i: u32, axis: Vec3| Gaussian3d {
        rotation: quaternion(Quat::from_axis_angle(axis, PI / 24.0 * i as f32)),
        ..seen(Vec2::new(1.5 + 0.9 * i as f32, 16.0 - 0.6 * i as f32), 3.0, Vec3::new(0.4e6, 0.4, 0.4))
    };
    let across = |i| needle(i, Vec3::Z);
    // A needle of 10⁵ world units that is turned towards the camera has left the affine
    // approximation, not the mathematics.
    let along = |i| needle(i, Vec3::new(0.2, 1.0, 0.3).normalize());
    let mut cases = Vec::new();
    for antialias in ANTIALIASES {
        let trained = Training::Finite("the needles meet at infinity, and every step of an angle sweeps the image");
        let across = case("needles of aspect 10⁶ across the view", why, source, (0..24).map(across));
        let infinite = "the needles meet at infinity, where the analysis is of perspective as much as of them";
        cases.push(antialiased(across, antialias).training(trained).sloping(Slopes::Finite(infinite)));
        let along = case("needles of aspect 10⁶ in all directions", why, source, (0..24).map(along));
        cases.push(
            antialiased(along, antialias).training(trained).sloping(Slopes::Finite(
                "rounding of the quaternion alone turns these needles by more than their width",
            )),
        );
    }
    cases
}

fn sizes() -> Vec<Case<Scene3d>> {
    let large =
        [1e2f32, 1e4, 1e6, 1e8].map(|scale| seen(Vec2::new(9.0, 12.0), 5.0, Vec3::new(scale, 0.5 * scale, scale)));
    let far = [1.0f32, 3e5, 1e6].iter().enumerate().map(|(i, &scale)| {
        seen(Vec2::new(12.0, 9.5) + Vec2::from_angle(2.0 * i as f32) * 1e6, 5.0, Vec3::splat(scale))
    });
    let tiny = |tiny: f32| Gaussian3d {
        mean: Vec3::new(tiny, -tiny, 3.0 + tiny),
        log_scale: Vec3::new(-1.0 + tiny, tiny - 1.3, tiny - 1.0),
        rotation: [1.0, tiny, -tiny, tiny],
        opacity_logit: tiny,
        sh: vec![Vec3::new(tiny, -tiny, 0.5)],
    };
    let over = case(
        "larger than the image",
        "every tile lists each of them, and the camera is inside",
        Source::Report("https://github.com/MrNeRF/LichtFeld-Studio/pull/2185"),
        large,
    )
    .training(Training::Finite("the affine approximation of what surrounds the camera has no optimum"));
    vec![
        summed(over.clone()),
        over,
        case(
            "10⁶ px away",
            "projections far beyond the image, where the Jacobian is clamped",
            Source::Report("https://github.com/graphdeco-inria/gaussian-splatting/issues/191"),
            far,
        )
        .leaving_out(Culled { outside: 1, ..Culled::default() })
        .training(Training::Finite("those that reach the image from 10⁶ px away leave it with a step")),
        case(
            "denormal parameters",
            "GPUs flush them to 0, and a quotient of two is anything",
            Source::Report("https://github.com/ArthurBrussee/brush/pull/522"),
            [1e-45, -1e-45, 1e-40, f32::MIN_POSITIVE].map(tiny),
        ),
    ]
}

fn quaternions() -> Vec<Case<Scene3d>> {
    let of_length = |length: f32| Gaussian3d { rotation: plain().rotation.map(|v| v * length), ..plain() };
    let source = Source::Report("https://github.com/facebookresearch/momentum/pull/589");
    vec![
        case(
            "a zero, a tiny quaternion",
            "q/|q| is 0/0",
            source,
            [0.0, 1e-45, 1e-30, 1e-10, 9e-4, 1.1e-3, 1e-2, 1.0].map(of_length),
        )
        .leaving_out(Culled { degenerate: 5, ..Culled::default() })
        .training(Training::Finite("a short quaternion turns by any angle in one step")),
        case(
            "a huge quaternion",
            "|q|² is ∞ from 2·10¹⁹ on",
            source,
            [1e5, 1e10, 1e15, 1e18, 1e19, 1e20, 1e30, 1e38].map(of_length),
        ),
    ]
}
