//! A city that is computed, with as many Gaussians as wanted, and the photographs of a flight over
//! it: a capture of any size, whose cameras are exact.

mod capture;
mod lens;
mod model;
mod surface;

use glam::{Mat3, Quat, Vec2, Vec3, vec3};
use gs_core::{
    Blend, Gaussian3d, RenderSettings, Scene as _, Scene3d,
    constants::{SH_C0, SH_C1},
    effects::{Antialias, Order},
    logit,
};
use gs_density::Rng;
use rand::{RngExt, SeedableRng};

pub(crate) use self::capture::Capture;
use self::surface::{Appearance, Surface, surfaces};

/// Side of a block of houses, m.
const BLOCK_M: f32 = 48.0;

/// Width of a street with its pavements, m.
const STREET_M: f32 = 12.0;

/// Standard deviation of a Gaussian along its surface, and across it, in distances of Gaussians.
const ALONG: f32 = 0.7;
const ACROSS: f32 = 0.05;

/// Opacity of all Gaussians.
const OPACITY: f32 = 0.95;

/// Colour of the sky.
const SKY: [f32; 3] = [0.62, 0.74, 0.88];

/// Houses, streets and trees, made of Gaussians on their surfaces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct City {
    /// Blocks along each side, at least 1; a block and its street are 60 m long.
    pub(crate) blocks: u32,
    /// Number of Gaussians, at least 1.
    pub(crate) gaussians: usize,
    /// Seed of all random numbers.
    pub(crate) seed: u64,
}

impl City {
    /// Length of a side, from the middle of a street to that of another, m.
    pub(crate) fn side(&self) -> f32 {
        self.blocks as f32 * (BLOCK_M + STREET_M)
    }

    /// The Gaussians, of SH degree 1, in metres: x to the east, y down, z to the north, from the
    /// south-western corner. The ground is at y = 0.
    pub(crate) fn scene(&self) -> Scene3d {
        let mut rng = Rng::seed_from_u64(self.seed);
        let surfaces = surfaces(self, &mut rng);
        let area: f64 = surfaces.iter().map(|surface| f64::from(surface.area())).sum();
        let apart = (area / self.gaussians as f64).sqrt() as f32;
        let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
        let (mut before, mut made) = (0.0, 0);
        for surface in &surfaces {
            before += f64::from(surface.area());
            let until = (before / area * self.gaussians as f64).round() as usize;
            let count = until.min(self.gaussians).saturating_sub(made);
            let shift = Vec2::new(rng.random_range(0.0..1.0), rng.random_range(0.0..1.0));
            for index in 0..count {
                scene.push(gaussian(surface, spread(index, shift), apart, &mut rng));
            }
            made += count;
        }
        scene
    }

    /// How its scene is rendered.
    pub(crate) fn render(&self) -> RenderSettings {
        let settings = RenderSettings::blended(Blend::Over).with(|s| {
            s.effects.order = Order::Global;
            s.effects.antialias = Antialias::Mip;
            s.effects.sh_degree = 1;
        });
        settings.on(SKY)
    }
}

/// The point of this index of a sequence that covers the unit square evenly, at any length.
/// *Source:* Roberts 2018, the R₂ sequence.
fn spread(index: usize, shift: Vec2) -> Vec2 {
    const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];
    let [x, y] = STEPS.map(|step| (step * index as f64).fract() as f32);
    (Vec2::new(x, y) + shift).fract()
}

/// A flat Gaussian on a surface, at its shares of the edges; the next is about `apart` metres away.
fn gaussian(surface: &Surface, share: Vec2, apart: f32, rng: &mut Rng) -> Gaussian3d {
    let normal = surface.normal();
    let along = surface.edges[0].normalize();
    let rotation = Quat::from_mat3(&Mat3::from_cols(along, normal.cross(along), normal));
    let Appearance { color, gloss } = surface.at(share);
    let sun = vec3(0.4, -0.75, -0.5).normalize();
    let light = 0.5 + 0.5 * normal.dot(sun).max(0.0);
    let grain: f32 = rng.random_range(-0.03..0.03);
    let color = (color * light + grain).clamp(Vec3::ZERO, Vec3::ONE);
    // The sky is reflected the more, the flatter one looks: seen from above, walls are brighter.
    let [y, z, x] = [-SH_C1, SH_C1, -SH_C1];
    let reflected = Vec3::from(SKY) * gloss * 0.4;
    let sh = vec![(color - 0.5) / SH_C0, reflected / y, reflected * normal.z / z, reflected * normal.x / x];
    // Not larger than the surface.
    let most = surface.edges.map(|edge| 0.3 * edge.length());
    let size = most.map(|most| (ALONG * apart).min(most));
    Gaussian3d {
        mean: surface.corner + surface.edges[0] * share.x + surface.edges[1] * share.y,
        log_scale: vec3(size[0], size[1], ACROSS * apart).map(f32::ln),
        rotation: [rotation.w, rotation.x, rotation.y, rotation.z],
        opacity_logit: logit(OPACITY),
        sh,
    }
}
