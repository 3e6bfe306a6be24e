//! Gaussians at, behind and beside the camera, at the edge of the field of view, and far from the
//! origin.

use glam::{Mat3, Vec2, Vec3};
use gs_core::{Camera, Culled, Gaussian3d, Loss, Scene3d};

use super::common::{camera, case, plain, seen};
use crate::corpus::case::{Case, Goal, Slopes, Source, Training};

pub(super) fn cases() -> Vec<Case<Scene3d>> {
    [depths(), edges(), places(), directions(), images()].into_iter().flatten().collect()
}

fn at_depth(z: f32) -> Gaussian3d {
    Gaussian3d { mean: Vec3::new(0.02 * z, 0.01 * z, z), log_scale: Vec3::splat(-2.5), ..plain() }
}

fn depths() -> Vec<Case<Scene3d>> {
    let near = camera().near;
    vec![
        case(
            "on the camera, behind it",
            "divisions by z = 0 and by z < 0, and depths whose bits sort backwards",
            Source::Report("https://github.com/graphdeco-inria/diff-gaussian-rasterization/pull/88"),
            [0.0, -0.0, 1e-45, 1e-20, -1e-20, -0.5, -3.0, -1e30, 2.0].map(at_depth),
        )
        .leaving_out(Culled { near: 8, ..Culled::default() }),
        case(
            "on the near plane, an ulp either side",
            "z ≥ near is decided once, forward and backward",
            Source::Report("https://github.com/graphdeco-inria/diff-gaussian-rasterization/pull/88"),
            [near, near.next_up(), near.next_down(), 0.5 * near]
                .map(|z| Gaussian3d { log_scale: Vec3::splat(-5.0), ..at_depth(z) }),
        )
        .leaving_out(Culled { near: 2, ..Culled::default() })
        .training(Training::Finite(
            "those on the plane are in front of it after one step, and behind it after another",
        )),
    ]
}

fn edges() -> Vec<Case<Scene3d>> {
    let around = |camera: Camera| {
        let beyond = [-1.6f32, -1.2, -0.9, -0.5, 0.5, 1.0, 1.3, 2.0];
        beyond.into_iter().enumerate().map(move |(i, share)| {
            let size = Vec2::new(24.0, 19.0);
            let pixel = if i % 2 == 0 { size * Vec2::new(share, 0.4) } else { size * Vec2::new(0.6, share) };
            let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
            Gaussian3d { mean: ray * 3.0, log_scale: Vec3::new(0.9, 1.2, 0.7), ..plain() }
        })
    };
    let clamped = "beyond the edge of the field of view the affine approximation is clamped, and gradients with it";
    let turned = "clamps that assume a principal point in the middle are wrong on either side of it";
    let mut cases = Vec::new();
    for (name, why, report, center) in [
        (
            "at the edge of the field of view",
            clamped,
            "https://github.com/graphdeco-inria/diff-gaussian-rasterization/issues/75",
            Vec2::new(12.0, 9.5),
        ),
        (
            "with an off-centre principal point",
            turned,
            "https://github.com/nerfstudio-project/gsplat/pull/305",
            Vec2::new(2.5, 15.0),
        ),
        (
            "with a principal point outside the image",
            turned,
            "https://github.com/nerfstudio-project/gsplat/pull/305",
            Vec2::new(-40.0, 31.0),
        ),
    ] {
        let view = Camera { center, ..camera() };
        cases.push(Case { view, ..case(name, why, Source::Report(report), around(view)) });
    }
    let view = Camera { focal: Vec2::new(20.0, 31.0), ..camera() };
    let why = "with one focal length for both axes, places are right along one of them";
    let source = Source::Report("https://github.com/BabylonJS/Babylon.js/pull/18921");
    cases.push(Case { view, ..case("pixels that are not square", why, source, around(view)) });
    cases
}

/// Cameras far from the origin, and exactly at a Gaussian.
fn places() -> Vec<Case<Scene3d>> {
    let mut cases = Vec::new();
    for (name, distance) in [("10⁴", 1e4f32), ("10⁷", 1e7)] {
        // Camera and scene moved by a whole number, so that the image is that at the origin except
        // for the rounding of means.
        let offset = Vec3::new(distance, -0.5 * distance, 2.0 * distance);
        let moved = (0..4).map(|i| {
            let g = seen(Vec2::new(4.0 + 4.0 * i as f32, 9.0), 32.0 + 8.0 * i as f32, Vec3::splat(3.0));
            Gaussian3d { mean: g.mean.round() + offset, ..g }
        });
        let view = Camera { translation: -offset, ..camera() };
        cases.push(
            Case {
                view,
                ..case(
                    format!("{name} world units from the origin"),
                    "coordinates of surveys: p = W μ + t is a small difference of large numbers",
                    Source::Report("https://github.com/sparkjsdev/spark/issues/287"),
                    moved,
                )
            }
            .sloping(Slopes::Finite("the analysis allows for means that are off by their own rounding"))
            .training(Training::Finite("a step of Adam is less than the distance between neighbouring numbers")),
        );
    }
    let turned = Mat3::from_rotation_z(0.5) * Mat3::from_rotation_x(std::f32::consts::PI);
    let view = Camera { rotation: turned, translation: Vec3::new(0.0, 0.0, 3.0), ..camera() };
    cases.push(Case {
        view,
        ..case(
            "camera upside down, Gaussian on the world's origin",
            "Gaussians exactly on coordinate axes of the camera",
            Source::Report("https://github.com/LioQing/wgpu-3dgs-viewer/pull/18"),
            [Gaussian3d { mean: Vec3::ZERO, ..plain() }, Gaussian3d { mean: Vec3::Z, ..plain() }],
        )
    });
    cases
}

/// Viewing directions of nearly zero length.
fn directions() -> Vec<Case<Scene3d>> {
    let mut cases = Vec::new();
    // A world of 10⁻²⁵ units: the same picture, were it not for numbers that underflow when
    // squared.
    let small = 1e-25f32;
    let world = (0..4).map(|i| {
        let g = seen(Vec2::new(4.0 + 4.0 * i as f32, 9.0), 2.0 + 0.5 * i as f32, Vec3::splat(3.0));
        let sh = (0..16).map(|k| Vec3::new(0.5, -0.3, 0.2) * (k as f32 + 1.0).recip()).collect();
        Gaussian3d { mean: g.mean * small, log_scale: g.log_scale + small.ln(), sh, ..g }
    });
    let view = Camera { near: 0.1 * small, ..camera() };
    cases.push(
        Case {
            view,
            ..case(
                "viewing direction whose length underflows",
                "|μ − o|² is 0 in f32 although |μ − o| is not: the direction is 0/0",
                Source::Report("https://github.com/graphdeco-inria/diff-gaussian-rasterization/pull/88"),
                world,
            )
        }
        .training(Training::Finite("steps of world units in a world of 10⁻²⁵")),
    );
    // W may be off a rotation by a thousandth. By half of that it is here, so that 1024 world units
    // from the origin the camera itself, −Wᵀ t, is 1 in front of the camera, to the bit.
    let stretched = 1.0 + 2f32.powi(-11);
    let view =
        Camera { rotation: Mat3::from_diagonal(Vec3::splat(stretched)), translation: Vec3::NEG_Z * 1024.0, ..camera() };
    let sh = (0..16).map(|k| Vec3::new(0.5, -0.3, 0.2) * (k as f32 + 1.0).recip()).collect();
    let at_camera = Gaussian3d { mean: view.position(), log_scale: Vec3::splat(-2.5), sh, ..plain() };
    cases.push(
        Case {
            view,
            ..case(
                "viewing direction of length zero",
                "from a point to itself there is no direction: 0/0, and a gradient that divides by it",
                Source::Definition("perspective::Perspective::direction"),
                [at_camera],
            )
        }
        .sloping(Slopes::Finite("a derivative by the mean would be one of a direction that is none"))
        .training(Training::Finite("the smallest step makes a direction of none")),
    );
    cases
}

fn images() -> Vec<Case<Scene3d>> {
    let sizes = [(1, 1), (1, 17), (17, 1), (15, 15), (16, 16), (17, 17), (257, 3)];
    let of_size = |(width, height): (u32, u32)| {
        let center = Vec2::new(width as f32, height as f32) * 0.5;
        let view = Camera { center, width, height, ..camera() };
        Case {
            view,
            ..case(
                format!("image of {width}×{height} px"),
                "tiles and vectors that are partly beyond the image; SSIM's window wider than it",
                Source::Report("https://github.com/graphdeco-inria/gaussian-splatting/issues/781"),
                (0..5).map(|i| Gaussian3d {
                    mean: Vec3::new(0.1 * i as f32 - 0.2, 0.05, 2.0 + 0.3 * i as f32),
                    ..plain()
                }),
            )
        }
        .after(Goal::Likeness(5), Loss::PAPER)
    };
    let none = case(
        "no Gaussian",
        "buffers of no length, launches of no threads",
        Source::Report("https://github.com/nerfstudio-project/gsplat/pull/100"),
        [],
    )
    .sloping(Slopes::Zero);
    let one = case(
        "one Gaussian",
        "the smallest scene that there is",
        Source::Report("https://github.com/nerfstudio-project/gsplat/issues/571"),
        [plain()],
    );
    [none, one].into_iter().chain(sizes.map(of_size)).collect()
}
