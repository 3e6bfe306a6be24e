//! Random numbers, and a random scene that resembles a trained one.

use glam::Vec3;
use gs_core::{Camera, Gaussian3d, Scene, Scene3d, logit};

/// The seed of all random numbers.
pub(crate) const SEED: u64 = 20_261_121;

/// SplitMix64 (Steele et al. 2014).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// 0 to 1.
    pub(crate) fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Standard normal.
    pub(crate) fn normal(&mut self) -> f32 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (std::f32::consts::TAU * self.unit()).cos()
    }

    /// Uniform on the sphere.
    pub(crate) fn direction(&mut self) -> Vec3 {
        Vec3::new(self.normal(), self.normal(), self.normal()).normalize_or(Vec3::Z)
    }
}

/// A scene like a trained outdoor scene of SH degree 3.
///
/// It has surfaces at all depths, and flat Gaussians of a few pixels with a long tail, most of them
/// nearly opaque or nearly transparent.
pub(crate) fn garden(count: usize, (width, height): (u32, u32)) -> (Scene3d, Camera) {
    let mut random = Random(SEED);
    let camera = Camera::looking_forward(width, height, 1.2);
    let mut scene = Scene3d { sh_degree: 3, ..Scene3d::default() };
    for _ in 0..count {
        let depth = 1.5 * (2.5 * random.unit()).exp();
        let (x, y) = (1.2 * random.unit() - 0.1, 1.2 * random.unit() - 0.1);
        let (x, y) = (x * width as f32, y * height as f32);
        let mean =
            Vec3::new((x - camera.center.x) / camera.focal.x, (y - camera.center.y) / camera.focal.y, 1.0) * depth;
        let px = 2.0 * (0.6 * random.normal()).exp() * depth / camera.focal.x;
        let log_scale = Vec3::new(px.ln(), px.ln() - random.unit(), px.ln() - 1.0 - 2.0 * random.unit());
        let opacity = if random.unit() < 0.5 { 0.7 + 0.29 * random.unit() } else { 0.02 + 0.5 * random.unit() };
        let sh = (0..16).map(|k| random.direction() * if k == 0 { 1.0 } else { 0.1 }).collect();
        let rotation = [random.normal(), random.normal(), random.normal(), random.normal() + 1e-3];
        scene.push(Gaussian3d { mean, log_scale, rotation, opacity_logit: logit(opacity), sh });
    }
    (scene, camera)
}
