//! A scene, a view, settings and training from bytes.

use std::array;

use glam::{Mat3, Quat, Vec2, Vec3};
use gs_core::{
    Adam, AdamRates, Binning, Camera, Canvas, Gaussian2d, Gaussian3d, Image, Loss, Parameterization, RenderSettings,
    Scene, Scene2d, Scene3d,
    adam::{Group, Participants, Penalty},
    effects::{Antialias, Blend, Order, Statistics},
};

use super::bytes::Bytes;

/// Largest number of columns and rows: a tile of every backend, and a little more.
const MOST_COLUMNS: usize = 20;
const MOST_ROWS: usize = 18;

/// Largest number of Gaussians.
const MOST_GAUSSIANS: usize = 6;

/// One number in this many is hostile.
const RARITY: u8 = 16;

/// The inputs of a few training steps, which may be invalid.
#[derive(Debug, Clone, PartialEq)]
pub struct Fuzzed<S: Scene> {
    /// The Gaussians.
    pub scene: S,
    /// The view.
    pub view: S::View,
    /// Effects, accuracy and background.
    pub settings: RenderSettings,
    /// The target: always finite, and of the view's size if that is valid.
    pub target: Image,
    /// The loss.
    pub loss: Loss,
    /// The parameterization.
    pub parameterization: Parameterization,
    /// The optimizer's rates.
    pub rates: AdamRates,
    /// Whether steps after the first reuse lists.
    pub binning: Binning,
}

/// A 2D scene and a canvas from bytes.
pub fn scene_2d(bytes: &[u8]) -> Fuzzed<Scene2d> {
    let mut bytes = Bytes::new(bytes);
    let view = canvas(&mut bytes);
    let settings = settings(&mut bytes, [Order::Index; 3]);
    let (target, loss, parameterization, rates) = training(
        &mut bytes,
        (view.width, view.height),
        [Parameterization::ScaleRotation, Parameterization::CovarianceFactor],
    );
    let binning = bytes.pick([Binning::Fresh, Binning::Reuse]);
    // Penalties are for 3D scenes.
    let rates = AdamRates { penalty: Penalty::NONE, ..rates };
    let mut scene = Scene2d::default();
    while scene.len() < MOST_GAUSSIANS && !bytes.is_empty() {
        scene.push(Gaussian2d {
            mean: Vec2::new(bytes.wild(-4.0..24.0, RARITY), bytes.wild(-4.0..22.0, RARITY)),
            log_scale: Vec2::new(bytes.wild(-2.0..3.0, RARITY), bytes.wild(-2.0..3.0, RARITY)),
            rotation: bytes.wild(-4.0..4.0, RARITY),
            opacity_logit: if settings.effects.blend == Blend::Sum {
                f32::INFINITY
            } else {
                bytes.wild(-7.0..9.0, RARITY)
            },
            color: Vec3::from_array(array::from_fn(|_| bytes.wild(-0.5..1.5, RARITY))),
        });
    }
    Fuzzed { scene, view, settings, target, loss, parameterization, rates, binning }
}

/// A 3D scene and a camera from bytes.
pub fn scene_3d(bytes: &[u8]) -> Fuzzed<Scene3d> {
    let mut bytes = Bytes::new(bytes);
    let view = camera(&mut bytes);
    let settings = settings(&mut bytes, [Order::Index, Order::Global, Order::PerPixel]);
    let (target, loss, parameterization, rates) =
        training(&mut bytes, (view.width, view.height), [Parameterization::ScaleRotation; 2]);
    let binning = bytes.pick([Binning::Fresh, Binning::Reuse]);
    let mut scene = Scene3d { sh_degree: bytes.below(4) as u8, ..Scene3d::default() };
    while scene.len() < MOST_GAUSSIANS && !bytes.is_empty() {
        let ray = Vec3::new(bytes.wild(-0.8..0.8, RARITY), bytes.wild(-0.8..0.8, RARITY), 1.0);
        let mean = view.rotation.transpose() * (ray * bytes.wild(-0.5..6.0, RARITY) - view.translation);
        scene.push(Gaussian3d {
            mean,
            log_scale: Vec3::from_array(array::from_fn(|_| bytes.wild(-6.0..1.0, RARITY))),
            rotation: array::from_fn(|_| bytes.wild(-1.0..1.0, RARITY)),
            opacity_logit: bytes.wild(-7.0..9.0, RARITY),
            sh: (0..scene.sh_len()).map(|_| Vec3::from_array(array::from_fn(|_| bytes.wild(-2.0..2.0, 64)))).collect(),
        });
    }
    Fuzzed { scene, view, settings, target, loss, parameterization, rates, binning }
}

fn size(bytes: &mut Bytes<'_>) -> (u32, u32) {
    ((1 + bytes.below(MOST_COLUMNS)) as u32, (1 + bytes.below(MOST_ROWS)) as u32)
}

fn canvas(bytes: &mut Bytes<'_>) -> Canvas {
    let (width, height) = size(bytes);
    let canvas = Canvas::new(width, height);
    match bytes.below(4) {
        0 => {
            let origin = Vec2::new(bytes.wild(-8.0..8.0, RARITY), bytes.wild(-8.0..8.0, RARITY));
            canvas.showing(origin, Vec2::new(bytes.wild(1.0..40.0, RARITY), bytes.wild(1.0..40.0, RARITY)))
        }
        _ => canvas,
    }
}

fn camera(bytes: &mut Bytes<'_>) -> Camera {
    let (width, height) = size(bytes);
    let [x, y, z, w] = array::from_fn(|_| bytes.within(-1.0..1.0));
    let turn = Quat::from_xyzw(x, y, z, w);
    let rotation = if turn.length_squared() > 0.01 { Mat3::from_quat(turn.normalize()) } else { Mat3::IDENTITY };
    Camera {
        rotation,
        translation: Vec3::from_array(array::from_fn(|_| bytes.wild(-3.0..3.0, 32))),
        focal: Vec2::new(bytes.wild(4.0..60.0, 32), bytes.wild(4.0..60.0, 32)),
        center: Vec2::new(bytes.wild(0.0..20.0, 32), bytes.wild(0.0..18.0, 32)),
        width,
        height,
        near: bytes.wild(0.005..0.3, 32),
    }
}

fn settings(bytes: &mut Bytes<'_>, orders: [Order; 3]) -> RenderSettings {
    let mut settings = RenderSettings::blended(bytes.pick([Blend::Over, Blend::Over, Blend::Sum]));
    settings.effects.order = bytes.pick(orders);
    settings.effects.antialias = bytes.pick(Antialias::ALL);
    settings.effects.sh_degree = bytes.below(4) as u8;
    settings.effects.statistics = bytes.pick(Statistics::ALL);
    if bytes.below(2) == 1 {
        settings = settings.on(array::from_fn(|_| bytes.wild(0.0..1.0, 64)));
    }
    if bytes.below(8) == 1 {
        settings.accuracy.alpha_cut = bytes.wild(1e-6..0.5, RARITY);
        settings.accuracy.alpha_max = bytes.wild(0.5..0.9999, RARITY);
        settings.accuracy.transmittance_min = bytes.wild(0.0..0.5, RARITY);
    }
    settings
}

fn training(
    bytes: &mut Bytes<'_>,
    (width, height): (u32, u32),
    parameterizations: [Parameterization; 2],
) -> (Image, Loss, Parameterization, AdamRates) {
    let brightness = bytes.pick([0.0, 1.0, 1.0, 1e4]);
    let checked = bytes.below(2) == 1;
    let pixel = |x: u32, y: u32| {
        let value = if checked { (x + y) % 2 } else { x % 3 } as f32;
        [value, 0.5 * value, 1.0 - value].map(|v| brightness * v)
    };
    let target = Image::from_fn(width, height, pixel).expect("a drawn size is possible");
    let lambda = bytes.wild(0.0..1.0, 64);
    let loss = bytes.pick([Loss::L2, Loss::L1, Loss::PAPER, Loss::L1Dssim { lambda }]);
    let parameterization = bytes.pick(parameterizations);
    let groups = std::array::from_fn(|_| Group::constant(bytes.pick([0.0, 1e-3, 0.1, 10.0])));
    let adam = Adam::default().with(|s| {
        [s.mean, s.scale, s.rotation, s.opacity, s.color, s.color_rest] = groups;
        s.min_scale = 1e-6;
        s.max_scale = 1e6;
        s.participants = bytes.pick([Participants::All, Participants::Visible]);
        s.penalty = bytes.pick([Penalty::NONE, Penalty { opacity: 0.01, scale: 0.01 }]);
    });
    (target, loss, parameterization, adam.at(0.0))
}
