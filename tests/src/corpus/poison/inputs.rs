//! Poison in what comes with each call: views, settings, targets, losses, rates of the optimiser.

use glam::{Vec2, Vec3};
use gs_core::{
    Adam, AdamRates, Binning, Camera, Canvas, Chart, Error, Image, Loss, PlanarScene, Rasterizer, RenderSettings,
    Scene, SpatialScene, TrainStep, Wait,
    effects::{Blend, Order},
};

use super::{VALUES, state::same_causes};
use crate::{
    failure::Failure,
    oracle::{Oracle, OracleView},
    scenes,
    subject::Subject,
    tolerance::compare_images,
};

/// Everything that a training step depends on.
#[derive(Debug, Clone)]
pub struct Inputs<S: Scene> {
    /// The Gaussians.
    pub scene: S,
    /// What they are seen through.
    pub view: S::View,
    /// Effects, accuracy and background.
    pub settings: RenderSettings,
    /// What they are compared with.
    pub target: Image,
    /// By what.
    pub loss: Loss,
    /// How they move.
    pub rates: AdamRates,
}

/// What +∞ is in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Infinite {
    /// No more than NaN is.
    Nothing,
    /// "Unlimited".
    Means,
}

/// A number of the inputs.
#[derive(Debug, Clone, Copy)]
pub struct Slot<S: Scene> {
    /// Its name.
    pub name: &'static str,
    /// What +∞ is there.
    pub infinite: Infinite,
    /// Puts a value there.
    pub put: fn(&mut Inputs<S>, f32),
}

const SIZE: (u32, u32) = (20, 13);

fn inputs<S: Subject>(scene: S, view: S::View, settings: RenderSettings) -> Inputs<S> {
    let (width, height) = view.size();
    let target = scenes::target(width, height, 3).expect("a possible size");
    // A gradient that is mere rounding must not become a whole step.
    let rates = Adam { epsilon: 1e-6, ..S::adam() }.at(0.0);
    Inputs { scene, view, settings: settings.on([0.3, 0.2, 0.4]), target, loss: Loss::L2, rates }
}

/// Three small Gaussians in a row, so that the poisoned one in the middle touches neither.
pub(super) fn planar() -> Vec<(&'static str, Inputs<PlanarScene>)> {
    [("sum", Blend::Sum), ("over", Blend::Over)]
        .map(|(name, blend)| {
            let gaussian = |i: usize| gs_core::PlanarGaussian {
                mean: Vec2::new(3.2 + 6.6 * i as f32, 6.3),
                log_scale: Vec2::new(-0.4, -0.2),
                rotation: 0.4,
                opacity_logit: if blend == Blend::Sum { f32::INFINITY } else { 0.7 },
                color: Vec3::new(0.8, 0.3 * i as f32, 0.4),
            };
            let scene = (0..3).map(gaussian).collect();
            (name, inputs(scene, Canvas::new(SIZE.0, SIZE.1), RenderSettings::blended(blend)))
        })
        .into()
}

/// The same in space, in two orders.
pub(super) fn spatial() -> Vec<(&'static str, Inputs<SpatialScene>)> {
    [("by mean depth", Order::TileDepth), ("by pixel depth", Order::PixelDepth)]
        .map(|(name, order)| {
            let view = Camera { near: 0.2, ..Camera::looking_forward(SIZE.0, SIZE.1, 0.9) };
            let mut scene = SpatialScene { sh_degree: 1, ..SpatialScene::default() };
            for i in 0..3 {
                let pixel = Vec2::new(3.2 + 6.6 * i as f32, 6.3);
                scene.push(gs_core::SpatialGaussian {
                    mean: ((pixel - view.center) / view.focal).extend(1.0) * (2.0 + 0.5 * i as f32),
                    log_scale: Vec3::new(-3.2, -3.0, -3.1),
                    rotation: [0.9, 0.1, -0.3, 0.2],
                    opacity_logit: 0.7,
                    sh: vec![Vec3::new(0.8, 0.3 * i as f32, 0.4), Vec3::splat(0.1), Vec3::splat(-0.1), Vec3::X],
                });
            }
            let mut settings = RenderSettings::blended(Blend::Over);
            settings.effects.order = order;
            settings.effects.sh_degree = 3;
            (name, inputs(scene, view, settings))
        })
        .into()
}

macro_rules! slots {
    ($($name:literal: $slot:expr),* $(,)?) => {
        [$(Slot { name: $name, infinite: if $name == "max_scale" { Infinite::Means } else { Infinite::Nothing }, put: $slot }),*]
    };
}

/// What both kinds of scenes have.
fn common<S: Scene>() -> Vec<Slot<S>> {
    slots![
        "alpha_cut": |i, v| i.settings.accuracy.alpha_cut = v,
        "alpha_max": |i, v| i.settings.accuracy.alpha_max = v,
        "transmittance_min": |i, v| i.settings.accuracy.transmittance_min = v,
        "background red": |i, v| i.settings.background[0] = v,
        "background green": |i, v| i.settings.background[1] = v,
        "background blue": |i, v| i.settings.background[2] = v,
        "target red": |i, v| i.target.pixels_mut()[7][0] = v,
        "target green": |i, v| i.target.pixels_mut()[7][1] = v,
        "target blue": |i, v| i.target.pixels_mut()[7][2] = v,
        "lambda": |i, v| i.loss = Loss::L1Dssim { lambda: v },
        "learning rate of means": |i, v| i.rates.mean.learning_rate = v,
        "beta1 of means": |i, v| i.rates.mean.beta1 = v,
        "beta2 of means": |i, v| i.rates.mean.beta2 = v,
        "learning rate of scales": |i, v| i.rates.scale.learning_rate = v,
        "beta1 of scales": |i, v| i.rates.scale.beta1 = v,
        "beta2 of scales": |i, v| i.rates.scale.beta2 = v,
        "learning rate of rotations": |i, v| i.rates.rotation.learning_rate = v,
        "beta1 of rotations": |i, v| i.rates.rotation.beta1 = v,
        "beta2 of rotations": |i, v| i.rates.rotation.beta2 = v,
        "learning rate of opacities": |i, v| i.rates.opacity.learning_rate = v,
        "beta1 of opacities": |i, v| i.rates.opacity.beta1 = v,
        "beta2 of opacities": |i, v| i.rates.opacity.beta2 = v,
        "learning rate of colours": |i, v| i.rates.color.learning_rate = v,
        "beta1 of colours": |i, v| i.rates.color.beta1 = v,
        "beta2 of colours": |i, v| i.rates.color.beta2 = v,
        "learning rate of higher SH": |i, v| i.rates.color_rest.learning_rate = v,
        "beta1 of higher SH": |i, v| i.rates.color_rest.beta1 = v,
        "beta2 of higher SH": |i, v| i.rates.color_rest.beta2 = v,
        "epsilon": |i, v| i.rates.epsilon = v,
        "min_scale": |i, v| i.rates.min_scale = v,
        "max_scale": |i, v| i.rates.max_scale = v,
        "penalty on opacities": |i, v| i.rates.penalty.opacity = v,
        "penalty on scales": |i, v| i.rates.penalty.scale = v,
    ]
    .into()
}

pub(super) fn planar_slots() -> Vec<Slot<PlanarScene>> {
    let canvas: [Slot<PlanarScene>; 4] = slots![
        "canvas origin x": |i, v| i.view.origin.x = v,
        "canvas origin y": |i, v| i.view.origin.y = v,
        "canvas extent x": |i, v| i.view.extent.x = v,
        "canvas extent y": |i, v| i.view.extent.y = v,
    ];
    canvas.into_iter().chain(common()).collect()
}

pub(super) fn spatial_slots() -> Vec<Slot<SpatialScene>> {
    let camera: [Slot<SpatialScene>; 17] = slots![
        "camera rotation 00": |i, v| i.view.rotation.x_axis.x = v,
        "camera rotation 10": |i, v| i.view.rotation.x_axis.y = v,
        "camera rotation 20": |i, v| i.view.rotation.x_axis.z = v,
        "camera rotation 01": |i, v| i.view.rotation.y_axis.x = v,
        "camera rotation 11": |i, v| i.view.rotation.y_axis.y = v,
        "camera rotation 21": |i, v| i.view.rotation.y_axis.z = v,
        "camera rotation 02": |i, v| i.view.rotation.z_axis.x = v,
        "camera rotation 12": |i, v| i.view.rotation.z_axis.y = v,
        "camera rotation 22": |i, v| i.view.rotation.z_axis.z = v,
        "camera translation x": |i, v| i.view.translation.x = v,
        "camera translation y": |i, v| i.view.translation.y = v,
        "camera translation z": |i, v| i.view.translation.z = v,
        "focal length x": |i, v| i.view.focal.x = v,
        "focal length y": |i, v| i.view.focal.y = v,
        "principal point x": |i, v| i.view.center.x = v,
        "principal point y": |i, v| i.view.center.y = v,
        "near plane": |i, v| i.view.near = v,
    ];
    camera.into_iter().chain(common()).collect()
}

/// Whether an error says that an input is not possible.
fn is_refusal(error: &Error) -> bool {
    matches!(error, Error::Setting { .. } | Error::Size { .. } | Error::Pixel { .. } | Error::Unsupported { .. })
}

/// Puts all values into one slot; how many runs that were.
pub(super) fn poison<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    slot: &Slot<S>,
) -> Result<usize, Failure> {
    for value in VALUES {
        let mut poisoned = inputs.clone();
        (slot.put)(&mut poisoned, value);
        let meaningful = value.is_finite() || slot.infinite == Infinite::Means && value == f32::INFINITY;
        match one(rasterizer, &poisoned) {
            Err(Failure::Backend(error)) if is_refusal(&error) => {}
            Ok(()) if !meaningful => return Err(Failure::Broken(format!("{value:e} is accepted"))),
            outcome => outcome.map_err(|failure| failure.at(format!("{value:e}")))?,
        }
    }
    Ok(VALUES.len())
}

/// What is not refused is drawn as the oracle draws it, and trained without a loss that is not a number; a Gaussian that does not stay finite is
/// left out and counted.
fn one<S: Subject, R: Rasterizer<S>>(rasterizer: &R, inputs: &Inputs<S>) -> Result<(), Failure> {
    let mut cloud = rasterizer.upload(&inputs.scene, Chart::ScaleRotation)?;
    let frame = rasterizer.forward(&cloud, &inputs.view, &inputs.settings)?;
    let (image, culled) = (rasterizer.image(&frame)?, rasterizer.culled(&frame)?);
    let expected = Oracle::new(inputs.view, inputs.settings)?.render(&inputs.scene.rows());
    let same = same_causes(culled, expected.culled);
    Failure::unless(same, || format!("left out {culled:?}, the oracle {:?}", expected.culled))?;
    match compare_images(&expected, &image) {
        Err(Failure::Nothing(_)) => {
            let finite = image.pixels().as_flattened().iter().all(|v| v.is_finite());
            Failure::unless(finite, || "an image of the background alone is not finite".to_owned())?;
        }
        agreement => drop(agreement?),
    }

    let target = rasterizer.upload_target(&inputs.target)?;
    let step =
        TrainStep { settings: &inputs.settings, loss: inputs.loss, rates: &inputs.rates, binning: Binning::Fresh };
    for _ in 0..2 {
        if let Err(error) = rasterizer.train_step(&mut cloud, &inputs.view, &target, &step) {
            let before = rasterizer.upload(&inputs.scene, Chart::ScaleRotation)?;
            let kept = rasterizer.save(&cloud)? == rasterizer.save(&before)?;
            Failure::unless(kept, || format!("a step that was refused ({error}) changed the cloud"))?;
            return Err(error.into());
        }
    }
    let mut losses = Vec::new();
    rasterizer.losses(&mut cloud, Wait::All, &mut losses)?;
    Failure::unless(!losses.iter().any(|loss| loss.is_nan()), || format!("losses {losses:?}"))?;
    let frame = rasterizer.forward(&cloud, &inputs.view, &inputs.settings)?;
    let (image, culled) = (rasterizer.image(&frame)?, rasterizer.culled(&frame)?);
    let finite = image.pixels().as_flattened().iter().all(|v| v.is_finite());
    Failure::unless(finite, || "after two steps, the image is not finite".to_owned())?;
    let after = rasterizer.download(&cloud)?;
    let broken = (0..after.len()).filter(|&i| after.picked([i]).validate().is_err()).count();
    Failure::unless(culled.not_finite as usize >= broken, || {
        format!("after two steps, {broken} Gaussians are not finite, and {} are counted", culled.not_finite)
    })
}
