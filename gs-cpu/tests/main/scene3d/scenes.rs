//! Scenes, cameras and images made from hashes of indices.

use glam::{Mat3, Vec2, Vec3};
use gs_core::{Camera, Gaussian3d, Image, RenderSettings, Scene, Scene3d, effects::Order};
use gs_cpu::{CpuRasterizer, CpuSettings};

pub(crate) fn rasterizer(threads: usize) -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(threads);
        s.level = None;
    }))
    .unwrap()
}

/// A number in 0..1.
pub(crate) fn unit(seed: u32) -> f32 {
    let x = seed.wrapping_add(1).wrapping_mul(0x9E37_79B9);
    let x = (x ^ (x >> 15)).wrapping_mul(0x85EB_CA6B);
    ((x ^ (x >> 13)) >> 8) as f32 / (1u32 << 24) as f32
}

/// `count` Gaussians, 2 to 5 world units in front of [`camera`], of at most `size` px, some of them
/// needles.
pub(crate) fn scene(count: u32, sh_degree: u8, size: f32) -> Scene3d {
    let mut scene = Scene3d { sh_degree, ..Scene3d::default() };
    for i in 0..count {
        let u = |k: u32| unit(i * 97 + k);
        let depth = 2.0 + 3.0 * u(0);
        let ln_px = (size * depth / camera(64, 48).focal.x).ln();
        let gaussian = Gaussian3d {
            mean: Vec3::new((u(1) - 0.5) * 0.7, (u(2) - 0.5) * 0.5, 1.0) * depth,
            log_scale: Vec3::new(ln_px - 1.2 * u(3), ln_px - 2.0 * u(4), ln_px - u(5)),
            rotation: [u(6) - 0.5, u(7) - 0.5, u(8) - 0.5, u(9) + 0.2],
            opacity_logit: 4.0 * u(10) - 2.0,
            sh: (0..16)
                .map(|k| {
                    (Vec3::new(u(20 + 3 * k), u(21 + 3 * k), u(22 + 3 * k)) - 0.4) * if k == 0 { 1.5 } else { 0.4 }
                })
                .collect(),
        };
        scene.push(gaussian.with_degree(sh_degree));
    }
    scene
}

/// A camera near the origin, turned a little, its principal point off the centre.
pub(crate) fn camera(width: u32, height: u32) -> Camera {
    Camera {
        rotation: Mat3::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 0.1),
        translation: Vec3::new(0.05, -0.1, 0.2),
        center: Vec2::new(0.46 * width as f32, 0.55 * height as f32),
        ..Camera::looking_forward(width, height, 0.9)
    }
}

pub(crate) fn image(width: u32, height: u32) -> Image {
    Image::from_fn(width, height, |x, y| [0, 1, 2].map(|c| unit((y * width + x) * 3 + c + 70_000))).unwrap()
}

pub(crate) fn settings(order: Order, sh_degree: u8) -> RenderSettings {
    let mut settings = RenderSettings::default().on([0.2, 0.4, 0.1]);
    settings.effects.order = order;
    settings.effects.sh_degree = sh_degree;
    settings
}
