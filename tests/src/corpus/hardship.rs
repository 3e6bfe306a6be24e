//! Randomised hard scenes for comparisons with difference quotients: those of
//! [`scenes`](crate::scenes), made hard in one way each, without decisions near their thresholds.

use glam::{Vec2, Vec3};
use gs_core::{
    Scene2d, Scene3d,
    effects::{Antialias, Blend, Order},
    logit,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::scenes::{Draw, Kind2d, Kind3d};

/// The way in which a scene is hard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Hardship {
    /// Aspects of 10² to 10⁵.
    Needles,
    /// Scales that differ by a millionth: almost nothing depends on the rotation.
    NearlyRound,
    /// Short axes of 0.02 to 0.1 px, in 3D of 0.
    Thin,
    /// Scales of 10³ to 10⁶ px.
    Huge,
    /// Means 10³ to 10⁵ px away, and scales that reach the image from there.
    Far,
    /// Opacities on both sides of the clamp, by up to a thousandth.
    Clamped,
    /// Colours of up to ±1000.
    Bright,
}

impl Hardship {
    /// All hardships.
    pub const ALL: [Self; 7] =
        [Self::Needles, Self::NearlyRound, Self::Thin, Self::Huge, Self::Far, Self::Clamped, Self::Bright];
}

/// Number of Gaussians of a hard scene.
const COUNT: usize = 4;

/// Columns and rows of its image.
const SIZE: (u32, u32) = (12, 9);

/// A 2D scene that is hard in one way, determined by the seed.
pub fn hard_2d(hardship: Hardship, blend: Blend, seed: u64) -> Draw<Scene2d> {
    let mut draw = Draw::new(Kind2d::Typical, blend, COUNT, SIZE, seed).on([0.3, 0.9, 0.1]);
    let mut rng = Pcg64::seed_from_u64(seed ^ 0x4a2d);
    let mut within = |least: f32, most: f32| rng.random_range(least..most);
    for i in 0..COUNT {
        let scene = &mut draw.scene;
        match hardship {
            Hardship::Needles => {
                let short = within(0.4, 0.8);
                scene.log_scales[i] = Vec2::new(short * 10f32.powf(within(2.0, 5.0)), short).map(f32::ln);
            }
            Hardship::NearlyRound => scene.log_scales[i].y = scene.log_scales[i].x + within(-1e-6, 1e-6),
            Hardship::Thin => {
                // Through the centres of a row of pixels, so that it is visible.
                scene.log_scales[i] = Vec2::new(within(2.0, 4.0), within(0.02, 0.1)).map(f32::ln);
                scene.rotations[i] = 0.0;
                scene.means[i].y = scene.means[i].y.floor() + 0.5 + within(-0.02, 0.02);
            }
            Hardship::Huge => {
                let size = 10f32.powf(within(3.0, 6.0));
                scene.log_scales[i] = Vec2::new(size, size * within(0.2, 1.0)).map(f32::ln);
            }
            Hardship::Far => {
                let distance = 10f32.powf(within(3.0, 5.0));
                scene.means[i] += Vec2::from_angle(within(0.0, 6.0)) * distance;
                scene.log_scales[i] = Vec2::splat(distance * within(0.5, 1.0)).map(f32::ln);
            }
            Hardship::Clamped if blend == Blend::Over => {
                scene.opacity_logits[i] = logit(0.999 + within(-9e-4, 9e-4));
            }
            Hardship::Clamped => {}
            Hardship::Bright => scene.colors[i] *= within(-1000.0, 1000.0),
        }
    }
    draw
}

/// A 3D scene that is hard in one way. The seed also determines its antialiasing.
pub fn hard_3d(hardship: Hardship, seed: u64) -> Draw<Scene3d> {
    let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, COUNT, SIZE, seed).on([0.3, 0.9, 0.1]);
    draw = draw.antialiased(Antialias::ALL[(seed % 4) as usize]);
    draw.settings.effects.order = Order::Index;
    let mut rng = Pcg64::seed_from_u64(seed ^ 0x4a2d);
    let mut within = |least: f32, most: f32| rng.random_range(least..most);
    for i in 0..COUNT {
        let scene = &mut draw.scene;
        match hardship {
            Hardship::Needles => scene.log_scales[i].x += within(2.0, 4.0) * std::f32::consts::LN_10,
            Hardship::NearlyRound => {
                scene.log_scales[i] = Vec3::splat(scene.log_scales[i].x) + Vec3::new(0.0, within(-1e-6, 1e-6), 1e-6);
            }
            // Surfels, which have an area when seen obliquely.
            Hardship::Thin => scene.log_scales[i].z = within(-30.0, -10.0),
            Hardship::Huge => scene.log_scales[i] += within(3.0, 5.0) * std::f32::consts::LN_10,
            Hardship::Far => {
                let away = draw.view.rotation.transpose() * Vec3::new(within(-1.0, 1.0), within(-1.0, 1.0), 0.0);
                let distance = 10f32.powf(within(1.0, 3.0));
                scene.means[i] += away.normalize() * distance;
                scene.log_scales[i] = Vec3::splat((distance * within(0.5, 1.0)).ln());
            }
            Hardship::Clamped => scene.opacity_logits[i] = logit(0.999 + within(-9e-4, 9e-4)),
            Hardship::Bright => {
                let factor = within(100.0, 1000.0);
                let coefficients = scene.sh_len();
                scene.sh[i * coefficients..][..coefficients].iter_mut().for_each(|c| *c *= factor);
            }
        }
    }
    draw
}
