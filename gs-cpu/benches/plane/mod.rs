//! Gaussians as of a fitted image, in 2D and as a 3D scene before a camera; what benchmarks of effects share.

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Camera, Canvas, Effects, Error, Gaussian2d, Gaussian3d, Rasterizer, RenderSettings, Scene, Scene2d, Scene3d,
    constants::SH_C0,
    effects::{Antialias, Order},
    scene::logit,
};

use crate::{
    garden::{Random, SEED},
    turns::{picture, table},
};

/// As fitted to a photograph of 768x512 px: the more Gaussians, the smaller.
pub(crate) fn fitted(count: u32) -> (Scene2d, Canvas) {
    let mut random = Random(SEED);
    let (width, height) = (768, 512);
    let smaller = 0.5 * (count as f32 / 9_000.0).ln();
    let gaussian = |random: &mut Random| Gaussian2d {
        mean: Vec2::new(random.unit() * width as f32, random.unit() * height as f32),
        log_scale: Vec2::new(1.6 + 0.5 * random.normal(), 0.9 + 0.5 * random.normal()) - smaller,
        rotation: std::f32::consts::PI * random.unit(),
        opacity_logit: logit(0.3 + 0.65 * random.unit()),
        color: Vec3::new(random.unit(), random.unit(), random.unit()),
    };
    ((0..count).map(|_| gaussian(&mut random)).collect(), Canvas::new(width, height))
}

/// The same Gaussians on a plane before a camera, one behind the other by a little, so that their order is that of the plane.
fn before_a_camera(scene: &Scene2d, canvas: &Canvas) -> (Scene3d, Camera) {
    let camera = Camera::looking_forward(canvas.width, canvas.height, 0.3);
    let mut flat = Scene3d { sh_degree: 3, ..Scene3d::default() };
    for (index, g) in scene.iter().enumerate() {
        let depth = 1.0 + 1e-6 * index as f32;
        let (sin, cos) = (0.5 * g.rotation).sin_cos();
        let gaussian = Gaussian3d {
            mean: ((g.mean - camera.center) / camera.focal * depth).extend(depth),
            log_scale: (g.log_scale + (depth / camera.focal.x).ln()).extend(-20.0),
            rotation: [cos, 0.0, 0.0, sin],
            opacity_logit: g.opacity_logit,
            sh: vec![(g.color - 0.5) / SH_C0],
        };
        flat.push(gaussian.with_degree(3));
    }
    (flat, camera)
}

/// Gaussians of an image in 2D, and as a scene before a camera.
pub(crate) fn in_the_plane(
    scene_2d: &impl Rasterizer<Scene2d>,
    scene_3d: &impl Rasterizer<Scene3d>,
    count: u32,
) -> Result<(), Error> {
    let (scene, canvas) = fitted(count);
    let (flat, camera) = before_a_camera(&scene, &canvas);
    let mut all = RenderSettings::blended(Blend::Over).on([1.0; 3]);
    all.effects = Effects { order: Order::Global, sh_degree: 3, antialias: Antialias::Dilate, ..all.effects };
    let mut some = all;
    some.effects = Effects { sh_degree: 0, antialias: Antialias::None, ..all.effects };
    let mut exact = all;
    exact.effects.order = Order::PerPixel;
    let rows = [
        picture("in 2D, sum", scene_2d, &scene, &canvas, RenderSettings::blended(Blend::Sum))?,
        picture("in 2D, over", scene_2d, &scene, &canvas, RenderSettings::blended(Blend::Over))?,
        picture("through a camera, global", scene_3d, &flat, &camera, some)?,
        picture("through a camera, global, sh-degree 3, dilate", scene_3d, &flat, &camera, all)?,
        picture("through a camera, per-pixel, sh-degree 3, dilate", scene_3d, &flat, &camera, exact)?,
    ];
    table(&format!("{count} Gaussians of an image, 768x512 px"), &rows)
}
