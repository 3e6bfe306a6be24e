//! Floaters planted into a scene, to measure how many of them are found.

use glam::Vec3;
use gs_core::{Image, Output, Parameterization, Rasterizer, RenderSettings, Scene as _, Scene3d};
use gs_density::Rng;
use gs_train::train::PosedView;
use pollster::FutureExt as _;
use rand::{RngExt as _, SeedableRng as _};

/// How large planted Gaussians are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Sizes {
    /// As large as one of the scene.
    World,
    /// As large in the picture as one of the scene that the view shows.
    #[allow(dead_code, reason = "only the example plants both")]
    Picture,
}

/// Adds Gaussians to a scene between the cameras of views and the surface that they show: at 0.15 to 0.85 of
/// the depth at random pixels, with the shape, the colours and the opacity of three random Gaussians.
pub(crate) fn plant<R: Rasterizer<Scene3d>>(
    on: &R,
    scene: &mut Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
    (count, sizes): (usize, Sizes),
) {
    let covered = render.of_alpha();
    let inverse = covered.with(|s| s.output = Output::InverseDepth);
    let splats = on.upload(scene, Parameterization::ScaleRotation).unwrap();
    let draw = |view: &PosedView, render| on.draw(&splats, &view.camera, render).block_on().unwrap().0;
    let maps: Vec<[Image; 2]> = views.iter().map(|view| [draw(view, &covered), draw(view, &inverse)]).collect();
    let mut rng = Rng::seed_from_u64(1);
    let before = scene.len();
    while scene.len() < before + count {
        let view = rng.random_range(0..views.len());
        let camera = &views[view].camera;
        let (x, y) = (rng.random_range(0..camera.width), rng.random_range(0..camera.height));
        let [alpha, inverse] = [0, 1].map(|map: usize| maps[view][map].pixel(x, y)[0]);
        let (share, donors) = (rng.random_range(0.15..0.85), [(); 3].map(|()| rng.random_range(0..before)));
        if alpha < 0.5 {
            continue;
        }
        let depth = share * alpha / inverse;
        let pixel = glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let place = ((pixel - camera.center) / camera.focal * depth).extend(depth);
        let [mut shape, color, opacity] = donors.map(|donor| scene.gaussian(donor));
        if sizes == Sizes::Picture {
            let Some((_, donor_depth)) = camera.project(shape.mean) else { continue };
            shape.log_scale += (depth / donor_depth).ln();
        }
        let mean: Vec3 = camera.rotation.transpose() * (place - camera.translation);
        scene.push(gs_core::Gaussian3d { mean, sh: color.sh, opacity_logit: opacity.opacity_logit, ..shape });
    }
}
