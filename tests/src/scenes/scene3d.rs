//! 3D scenes and cameras for tests: seeded generators, and proptest strategies. Gaussians are
//! generated in camera coordinates and then transformed to the world.

use std::ops::Range;

use glam::{Mat3, Quat, Vec2, Vec3};
use gs_core::{
    Camera, Gaussian3d, RenderSettings, Scene, Scene3d,
    effects::{Antialias, Blend, Order},
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{Draw, blends, counts, sizes};

/// Kinds of scenes and cameras. Scales are standard deviations in px of the image; quaternions have
/// any length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind3d {
    /// Scales 0.8 to 6 px, translucent, 2 to 8 world units away.
    Typical,
    /// Scales 20 to 200 px: each covers the whole image, and some the camera.
    Large,
    /// Scales 0.05 to 0.4 px: without antialiasing most fall between pixel centres.
    Tiny,
    /// Needles of 10 to 30 times their width, and every third a disc of a twentieth of its width.
    Needles,
    /// Many beyond the edge of the field of view, where the Jacobian's slopes are clamped, before
    /// an off-centre principal point.
    Edge,
    /// A third behind the camera, a third between the near plane and four times its distance.
    Near,
    /// Opacities 0.99 to 1, some logits +∞, and some −∞.
    Opaque,
    /// Scales 4 to 9 px in the middle at about the same distance: they interpenetrate.
    Overlapping,
    /// A camera without rotation, and Gaussians at three depths that are equal to the bit, some of
    /// them twice.
    EqualDepths,
}

impl Kind3d {
    /// All kinds.
    pub const ALL: [Self; 9] = [
        Self::Typical,
        Self::Large,
        Self::Tiny,
        Self::Needles,
        Self::Edge,
        Self::Near,
        Self::Opaque,
        Self::Overlapping,
        Self::EqualDepths,
    ];

    fn scales(self) -> Range<f32> {
        match self {
            Self::Typical | Self::Opaque | Self::EqualDepths => 0.8..6.0,
            Self::Edge | Self::Near => 2.0..8.0,
            Self::Large => 20.0..200.0,
            Self::Tiny => 0.05..0.4,
            Self::Needles => 0.3..0.6,
            Self::Overlapping => 4.0..9.0,
        }
    }
}

/// A camera of `size` px with any position and rotation, determined by the seed. Its principal
/// point is off the centre by up to a fifth of the image ([`Kind3d::Edge`]: nearly half), and
/// pixels are not quite square.
pub fn camera(kind: Kind3d, size: (u32, u32), seed: u64) -> Camera {
    let mut rng = Pcg64::seed_from_u64(seed ^ 0xcafe);
    let mut within = |range: Range<f32>| rng.random_range(range);
    let extent = Vec2::new(size.0 as f32, size.1 as f32);
    let focal = extent.max_element().max(8.0) * within(0.7..1.5);
    let off = if kind == Kind3d::Edge { 0.45 } else { 0.2 };
    let center = extent * (Vec2::splat(0.5) + off * Vec2::new(within(-1.0..1.0), within(-1.0..1.0)));
    let mut camera = Camera {
        focal: Vec2::new(focal, focal * within(0.9..1.1)),
        center,
        near: 0.2,
        ..Camera::looking_forward(size.0, size.1, 1.0)
    };
    if kind != Kind3d::EqualDepths {
        let axis = Vec3::new(within(-1.0..1.0), within(-1.0..1.0), within(0.1..1.0)).normalize();
        let place = Vec3::new(within(-3.0..3.0), within(-3.0..3.0), within(-3.0..3.0));
        camera.rotation = Mat3::from_quat(Quat::from_axis_angle(axis, within(0.0..3.0)));
        camera.translation = -(camera.rotation * place);
    }
    camera
}

/// `count` Gaussians in front of `camera`, with SH of this degree, determined by the seed.
pub fn scene_3d(kind: Kind3d, count: usize, camera: &Camera, sh_degree: u8, seed: u64) -> Scene3d {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut within = |range: Range<f32>| rng.random_range(range);
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let mut scene = Scene3d { sh_degree, ..Scene3d::default() };
    for i in 0..count {
        let unit = Vec2::new(within(0.0..1.0), within(0.0..1.0));
        let pixel = match kind {
            Kind3d::Edge => size * (unit * 2.4 - 0.7),
            Kind3d::Overlapping => size * (0.35 + 0.3 * unit),
            _ => size * unit,
        };
        let depth = match (kind, i % 3) {
            (Kind3d::Near, 0) => within(-5.0..0.15),
            (Kind3d::Near, 1) => camera.near * within(1.01..4.0),
            (Kind3d::Overlapping, _) => within(3.0..3.6),
            (Kind3d::EqualDepths, turn) => [2.0, 3.0, 2.5][turn],
            _ => within(2.0..8.0),
        };
        let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
        let mean = camera.rotation.transpose() * (ray * depth - camera.translation);
        let mut scales = Vec3::new(within(kind.scales()), within(kind.scales()), within(kind.scales()));
        if kind == Kind3d::Needles {
            let long = within(10.0..30.0);
            scales *= match i % 3 {
                0 => Vec3::new(long, 1.0, 1.0),
                1 => Vec3::new(1.0, 1.0, long),
                _ => Vec3::new(10.0, 0.5, 10.0),
            };
        }
        let world_per_pixel = depth.abs().max(camera.near) / camera.focal.x;
        let length = within(0.2..3.0);
        let turn = [within(-1.0..1.0), within(-1.0..1.0), within(-1.0..1.0), within(0.1..1.0)].map(|v| v * length);
        let opacity_logit = match (kind, i % 4) {
            (Kind3d::Opaque, 0) => f32::INFINITY,
            (Kind3d::Opaque, 1) if i % 8 == 5 => f32::NEG_INFINITY,
            (Kind3d::Opaque, _) => within(4.6..9.0),
            _ => within(-2.0..2.0),
        };
        // Mean colours of −0.1 to 1, so that some are clamped in some directions.
        let mut color = |scale: Range<f32>| Vec3::new(within(scale.clone()), within(scale.clone()), within(scale));
        // The same count for every degree, so that all other numbers are the same.
        let sh = (0..16).map(|k| if k == 0 { color(-2.1..1.7) } else { color(-0.2..0.2) }).collect();
        let log_scale = (scales * world_per_pixel).map(f32::ln);
        let gaussian = Gaussian3d { mean, log_scale, rotation: turn, opacity_logit, sh };
        scene.push(gaussian.with_degree(sh_degree));
        if kind == Kind3d::EqualDepths && i % 4 == 3 {
            let last = scene.means.len() - 1;
            scene.means[last] = scene.means[last - 3];
        }
    }
    scene
}

impl Draw<Scene3d> {
    /// A seeded scene and camera of a kind, with SH of degree 0 to 3 by the seed, and the global
    /// depth sort.
    pub fn for_3d(kind: Kind3d, blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Self {
        let view = camera(kind, size, seed);
        let mut settings = RenderSettings::blended(blend);
        settings.effects.order = Order::Global;
        settings.effects.sh_degree = 3;
        let degree = (seed % 4) as u8;
        Self { kind, scene: scene_3d(kind, count, &view, degree, seed), view, settings, target_seed: seed }
    }

    /// The drawing with another order.
    #[must_use]
    pub fn in_order(mut self, order: Order) -> Self {
        self.settings.effects.order = order;
        self
    }
}

/// Every [`Kind3d`].
pub fn kinds_3d() -> impl Strategy<Value = Kind3d> {
    proptest::sample::select(Kind3d::ALL.as_slice())
}

/// Scenes of up to 24 Gaussians and cameras of up to 40 × 32 px: all
/// kinds, blends, orders, antialiasings and SH degrees, with and without background.
pub fn draws_3d() -> impl Strategy<Value = Draw<Scene3d>> {
    let orders = proptest::sample::select([Order::Index, Order::Global, Order::PerPixel].as_slice());
    let antialiases = proptest::sample::select(Antialias::ALL.as_slice());
    let effects = (blends(), orders, antialiases, 0u8..=3);
    let background = proptest::option::of(proptest::array::uniform3(0.0f32..1.0));
    (kinds_3d(), effects, sizes(40, 32), counts(), any::<u64>(), background).prop_map(
        |(kind, (blend, order, antialias, sh_degree), size, count, seed, background)| {
            let mut draw = Draw::for_3d(kind, blend, count, size, seed).in_order(order).antialiased(antialias);
            draw.settings.effects.sh_degree = sh_degree;
            background.map_or_else(|| draw.clone(), |color| draw.clone().on(color))
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_draws_the_same_valid_scene_in_view() {
        for kind in Kind3d::ALL {
            let draw = Draw::for_3d(kind, Blend::Over, 24, (40, 30), 7);
            draw.scene.validate().unwrap();
            draw.view.validate().unwrap();
            assert_eq!(draw.scene.len(), 24);
            assert_eq!(draw, Draw::for_3d(kind, Blend::Over, 24, (40, 30), 7));
            assert_ne!(draw.scene, Draw::for_3d(kind, Blend::Over, 24, (40, 30), 8).scene);
            let seen = draw.scene.means.iter().filter_map(|&mean| draw.view.project(mean));
            let inside = |p: Vec2| p.min_element() > -1.0 && p.x < 41.0 && p.y < 31.0;
            let inside = seen.filter(|&(p, _)| inside(p)).count();
            let expected = match kind {
                Kind3d::Edge => 2..20,
                Kind3d::Near => 12..20,
                _ => 24..25,
            };
            assert!(expected.contains(&inside), "{kind:?}: {inside} of 24 in view");
        }
    }

    #[test]
    fn equal_depths_are_equal_to_the_bit() {
        let draw = Draw::for_3d(Kind3d::EqualDepths, Blend::Over, 24, (40, 30), 1);
        let mut depths: Vec<u32> = draw.scene.means.iter().map(|&m| draw.view.to_camera(m).z.to_bits()).collect();
        depths.sort_unstable();
        depths.dedup();
        assert_eq!(depths.len(), 3);
    }
}
