//! What 3D hard cases have in common.

use glam::{Vec2, Vec3};
use gs_core::{
    Camera, Gaussian3d, RenderSettings, Scene, Scene3d,
    effects::{Antialias, Blend, Order},
};

use crate::corpus::case::{Case, Source};

/// All kinds of antialiasing.
pub(super) const ANTIALIASES: [Antialias; 4] = Antialias::ALL;

/// A camera at the origin without rotation, so that camera and world coordinates are equal. 24×19
/// px, which are neither whole tiles nor whole vectors, and a focal length of 20 px.
pub(super) fn camera() -> Camera {
    let center = Vec2::new(12.0, 9.5);
    Camera { focal: Vec2::splat(20.0), center, near: 0.2, ..Camera::looking_forward(24, 19, 1.0) }
}

/// A Gaussian at a pixel of [`camera`], with this depth and these scales in px.
pub(super) fn seen(pixel: Vec2, depth: f32, scales_px: Vec3) -> Gaussian3d {
    let camera = camera();
    Gaussian3d {
        mean: ((pixel - camera.center) / camera.focal * depth).extend(depth),
        log_scale: (scales_px * (depth / camera.focal.x)).map(f32::ln),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 0.3,
        sh: vec![Vec3::new(0.7, -0.4, 1.1)],
    }
}

/// A half-opaque Gaussian of about 3 px in the middle of the image.
pub(super) fn plain() -> Gaussian3d {
    Gaussian3d { rotation: [0.9, 0.2, -0.3, 0.1], ..seen(Vec2::new(11.3, 9.6), 3.0, Vec3::new(3.0, 2.0, 4.0)) }
}

/// A case with [`camera`], the global depth sort, and a background that is not black.
pub(super) fn case(
    name: impl Into<String>,
    why: &'static str,
    source: Source,
    gaussians: impl IntoIterator<Item = Gaussian3d>,
) -> Case<Scene3d> {
    let mut settings = RenderSettings::blended(Blend::Over).on([0.2, 0.3, 0.1]);
    settings.effects.order = Order::Global;
    settings.effects.sh_degree = 3;
    let gaussians: Vec<_> = gaussians.into_iter().collect();
    let coefficients = gaussians.first().map_or(1, |g| g.sh.len());
    let mut scene = Scene3d { sh_degree: coefficients.isqrt() as u8 - 1, ..Scene3d::default() };
    gaussians.into_iter().for_each(|g| scene.push(g));
    Case::new(name, why, source, scene, camera(), settings)
}

/// The case with another antialiasing, which its name includes.
pub(super) fn antialiased(mut case: Case<Scene3d>, antialias: Antialias) -> Case<Scene3d> {
    case.settings.effects.antialias = antialias;
    case.name = format!(
        "{}, {}",
        case.name,
        match antialias {
            Antialias::None => "not antialiased",
            Antialias::Dilate => "dilated",
            Antialias::Mip => "mip",
            Antialias::Compensated => "compensated",
        }
    );
    case
}

/// The case with another order, which its name includes.
pub(super) fn ordered(mut case: Case<Scene3d>, order: Order) -> Case<Scene3d> {
    case.settings.effects.order = order;
    case.name = format!(
        "{}, {}",
        case.name,
        match order {
            Order::Index => "by index",
            Order::Global => "by depth of the mean",
            Order::PerPixel => "by depth at each pixel",
        }
    );
    case
}

/// The case under `Sum`.
pub(super) fn summed(mut case: Case<Scene3d>) -> Case<Scene3d> {
    case.settings.effects.blend = Blend::Sum;
    case.name = format!("{}, sum", case.name);
    case
}
