//! Gaussians as of a fitted image, in the plane and as a scene in space before a camera; what benchmarks of effects share.

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Camera, Canvas, Effects, Error, PlanarGaussian, PlanarScene, Rasterizer, RenderSettings, Scene,
    SpatialGaussian, SpatialScene,
    constants::SH_C0,
    effects::{Antialias, Order},
    scene::logit,
};

use crate::{
    garden::{Random, SEED},
    turns::{picture, table},
};

/// As fitted to a photograph of 768x512 px: the more Gaussians, the smaller.
pub(crate) fn fitted(count: u32) -> (PlanarScene, Canvas) {
    let mut random = Random(SEED);
    let (width, height) = (768, 512);
    let smaller = 0.5 * (count as f32 / 9_000.0).ln();
    let gaussian = |random: &mut Random| PlanarGaussian {
        mean: Vec2::new(random.unit() * width as f32, random.unit() * height as f32),
        log_scale: Vec2::new(1.6 + 0.5 * random.normal(), 0.9 + 0.5 * random.normal()) - smaller,
        rotation: std::f32::consts::PI * random.unit(),
        opacity_logit: logit(0.3 + 0.65 * random.unit()),
        color: Vec3::new(random.unit(), random.unit(), random.unit()),
    };
    ((0..count).map(|_| gaussian(&mut random)).collect(), Canvas::new(width, height))
}

/// The same Gaussians on a plane before a camera, one behind the other by a little, so that their order is that of the plane.
fn before_a_camera(scene: &PlanarScene, canvas: &Canvas) -> (SpatialScene, Camera) {
    let camera = Camera::looking_forward(canvas.width, canvas.height, 0.3);
    let mut flat = SpatialScene { sh_degree: 3, ..SpatialScene::default() };
    for (index, g) in scene.iter().enumerate() {
        let depth = 1.0 + 1e-6 * index as f32;
        let (sin, cos) = (0.5 * g.rotation).sin_cos();
        let gaussian = SpatialGaussian {
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

/// Gaussians of an image in the plane, and as a scene before a camera.
pub(crate) fn in_the_plane(
    planar: &impl Rasterizer<PlanarScene>,
    spatial: &impl Rasterizer<SpatialScene>,
    count: u32,
) -> Result<(), Error> {
    let (scene, canvas) = fitted(count);
    let (flat, camera) = before_a_camera(&scene, &canvas);
    let mut all = RenderSettings::blended(Blend::Over).on([1.0; 3]);
    all.effects = Effects { order: Order::TileDepth, sh_degree: 3, antialias: Antialias::Dilate, ..all.effects };
    let mut some = all;
    some.effects = Effects { sh_degree: 0, antialias: Antialias::None, ..all.effects };
    let mut exact = all;
    exact.effects.order = Order::PixelDepth;
    let rows = [
        picture("in the plane, sum", planar, &scene, &canvas, RenderSettings::blended(Blend::Sum))?,
        picture("in the plane, over", planar, &scene, &canvas, RenderSettings::blended(Blend::Over))?,
        picture("through a camera, tile-depth", spatial, &flat, &camera, some)?,
        picture("through a camera, tile-depth, sh-degree 3, dilate", spatial, &flat, &camera, all)?,
        picture("through a camera, pixel-depth, sh-degree 3, dilate", spatial, &flat, &camera, exact)?,
    ];
    table(&format!("{count} Gaussians of an image, 768x512 px"), &rows)
}
