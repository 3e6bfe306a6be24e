//! Hostile values in the arguments of calls: views, settings, targets, losses, rates.

use glam::{Vec2, Vec3};
use gs_core::{
    AdamRates, Binning, Camera, Canvas, Error, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene,
    Scene2d, Scene3d, TrainStep, Wait,
    effects::{Blend, Order},
};
use pollster::FutureExt as _;

use super::{super::run::rows_of, VALUES, state::same_causes};
use crate::{
    conformance::{parameterizations, refused},
    failure::Failure,
    oracle::{Oracle, OracleView},
    scenes,
    subject::Subject,
    tolerance::compare_images,
};

/// The inputs of a training step.
#[derive(Debug, Clone)]
pub struct Inputs<S: Scene> {
    /// Name of the inputs.
    pub name: &'static str,
    /// The slots to test.
    pub breadth: Breadth,
    /// The Gaussians.
    pub scene: S,
    /// The view.
    pub view: S::View,
    /// Effects, accuracy and background.
    pub settings: RenderSettings,
    /// The target.
    pub target: Image,
    /// The loss.
    pub loss: Loss,
    /// The optimizer's rates.
    pub rates: AdamRates,
}

/// The slots to test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Breadth {
    /// All.
    Whole,
    /// Only the slots on which images and losses depend. The others do not depend on the blend.
    Pictures,
}

/// Whether backends must offer the feature of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Offered {
    /// Backends must offer the feature.
    Always,
    /// Backends may refuse the feature as unsupported, but then for all valid values.
    Optionally,
}

/// A number of the inputs.
#[derive(Debug, Clone, Copy)]
pub struct Slot<S: Scene> {
    /// The slot's name.
    pub name: &'static str,
    /// Whether backends must offer the feature of the slot.
    pub offered: Offered,
    /// Ends of the valid range, if [`VALUES`] are not on both sides of each.
    pub ends: &'static [f32],
    /// Sets the number.
    pub put: fn(&mut Inputs<S>, f32),
}

impl<S: Scene> Slot<S> {
    /// The tested values: [`VALUES`], the ends of the range, and the numbers next to each end.
    fn values(&self) -> impl Iterator<Item = f32> {
        let ends = self.ends.iter().flat_map(|end| [end.next_down(), *end, end.next_up()]);
        VALUES.into_iter().chain(ends)
    }
}

impl<S: Scene> Inputs<S> {
    /// A training step with these inputs.
    pub(super) fn step(&self) -> TrainStep<'_> {
        TrainStep { settings: &self.settings, loss: self.loss, rates: &self.rates, binning: Binning::Fresh }
    }

    /// The slots to test, without those of the view.
    pub(super) fn slots(&self) -> Vec<Slot<S>> {
        match self.breadth {
            Breadth::Pictures => pictures(),
            Breadth::Whole => pictures().into_iter().chain(rates()).collect(),
        }
    }
}

const SIZE: (u32, u32) = (20, 13);

fn inputs<S: Subject>(
    (name, breadth): (&'static str, Breadth),
    scene: S,
    view: S::View,
    settings: RenderSettings,
) -> Inputs<S> {
    let (width, height) = view.size();
    let target = scenes::target(width, height, 3).expect("a possible size");
    // With this ε, a gradient that is mere rounding does not become a whole step.
    let rates = S::adam().with(|s| s.epsilon = 1e-6).at(0.0);
    Inputs { name, breadth, scene, view, settings: settings.on([0.3, 0.2, 0.4]), target, loss: Loss::L2, rates }
}

/// Three small Gaussians in a row. The tested one in the middle touches neither of the others.
pub(super) fn scene_2d() -> Vec<Inputs<Scene2d>> {
    [("sum", Breadth::Pictures, Blend::Sum), ("over", Breadth::Whole, Blend::Over)]
        .map(|(name, breadth, blend)| {
            let gaussian = |i: usize| gs_core::Gaussian2d {
                mean: Vec2::new(3.2 + 6.6 * i as f32, 6.3),
                log_scale: Vec2::new(-0.4, -0.2),
                rotation: 0.4,
                opacity_logit: if blend == Blend::Sum { f32::INFINITY } else { 0.7 },
                color: Vec3::new(0.8, 0.3 * i as f32, 0.4),
            };
            let scene = (0..3).map(gaussian).collect();
            inputs((name, breadth), scene, Canvas::new(SIZE.0, SIZE.1), RenderSettings::blended(blend))
        })
        .into()
}

/// Three small 3D Gaussians, in two orders.
pub(super) fn scene_3d() -> Vec<Inputs<Scene3d>> {
    let orders =
        [("by mean depth", Breadth::Whole, Order::Global), ("by pixel depth", Breadth::Pictures, Order::PerPixel)];
    orders
        .map(|(name, breadth, order)| {
            let view = Camera { near: 0.2, ..Camera::looking_forward(SIZE.0, SIZE.1, 0.9) };
            let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
            for i in 0..3 {
                let pixel = Vec2::new(3.2 + 6.6 * i as f32, 6.3);
                scene.push(gs_core::Gaussian3d {
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
            inputs((name, breadth), scene, view, settings)
        })
        .into()
}

macro_rules! slots {
    ($($name:literal $([$($end:literal),*])?: $slot:expr),* $(,)?) => {
        [$(Slot { name: $name, offered: Offered::Always, ends: &[$($($end),*)?], put: $slot }),*]
    };
}

/// The slots on which an image and its loss depend, without the view.
fn pictures<S: Scene>() -> Vec<Slot<S>> {
    let slots: [Slot<S>; 10] = slots![
        "alpha_cut" [1e-6, 0.5]: |i, v| i.settings.accuracy.alpha_cut = v,
        "alpha_max" [1e-6, 0.9999]: |i, v| i.settings.accuracy.alpha_max = v,
        "transmittance_min" [0.5]: |i, v| i.settings.accuracy.transmittance_min = v,
        "background red": |i, v| i.settings.background[0] = v,
        "background green": |i, v| i.settings.background[1] = v,
        "background blue": |i, v| i.settings.background[2] = v,
        "target red": |i, v| i.target.pixels_mut()[7][0] = v,
        "target green": |i, v| i.target.pixels_mut()[7][1] = v,
        "target blue": |i, v| i.target.pixels_mut()[7][2] = v,
        "lambda" [1.0]: |i, v| i.loss = Loss::L1Dssim { lambda: v },
    ];
    slots.into()
}

/// The further slots on which a step depends.
fn rates<S: Scene>() -> Vec<Slot<S>> {
    let slots: [Slot<S>; 21] = slots![
        "learning rate of means": |i, v| i.rates.mean.learning_rate = v,
        "beta1 of means" [1.0]: |i, v| i.rates.mean.beta1 = v,
        "beta2 of means" [1.0]: |i, v| i.rates.mean.beta2 = v,
        "learning rate of scales": |i, v| i.rates.scale.learning_rate = v,
        "beta1 of scales" [1.0]: |i, v| i.rates.scale.beta1 = v,
        "beta2 of scales" [1.0]: |i, v| i.rates.scale.beta2 = v,
        "learning rate of rotations": |i, v| i.rates.rotation.learning_rate = v,
        "beta1 of rotations" [1.0]: |i, v| i.rates.rotation.beta1 = v,
        "beta2 of rotations" [1.0]: |i, v| i.rates.rotation.beta2 = v,
        "learning rate of opacities": |i, v| i.rates.opacity.learning_rate = v,
        "beta1 of opacities" [1.0]: |i, v| i.rates.opacity.beta1 = v,
        "beta2 of opacities" [1.0]: |i, v| i.rates.opacity.beta2 = v,
        "learning rate of colours": |i, v| i.rates.color.learning_rate = v,
        "beta1 of colours" [1.0]: |i, v| i.rates.color.beta1 = v,
        "beta2 of colours" [1.0]: |i, v| i.rates.color.beta2 = v,
        "learning rate of higher SH": |i, v| i.rates.color_rest.learning_rate = v,
        "beta1 of higher SH" [1.0]: |i, v| i.rates.color_rest.beta1 = v,
        "beta2 of higher SH" [1.0]: |i, v| i.rates.color_rest.beta2 = v,
        "epsilon": |i, v| i.rates.epsilon = v,
        "min_scale": |i, v| i.rates.min_scale = v,
        "max_scale": |i, v| i.rates.max_scale = v,
    ];
    let penalties: [Slot<S>; 2] = slots![
        "penalty on opacities": |i, v| i.rates.penalty.opacity = v,
        "penalty on scales": |i, v| i.rates.penalty.scale = v,
    ];
    slots.into_iter().chain(optional(penalties)).collect()
}

/// The slots as ones that backends may refuse.
fn optional<S: Scene, const N: usize>(slots: [Slot<S>; N]) -> [Slot<S>; N] {
    slots.map(|slot| Slot { offered: Offered::Optionally, ..slot })
}

pub(super) fn canvas_slots() -> [Slot<Scene2d>; 4] {
    slots![
        "canvas origin x": |i, v| i.view.origin.x = v,
        "canvas origin y": |i, v| i.view.origin.y = v,
        "canvas extent x": |i, v| i.view.extent.x = v,
        "canvas extent y": |i, v| i.view.extent.y = v,
    ]
}

pub(super) fn camera_slots() -> [Slot<Scene3d>; 17] {
    slots![
        "camera rotation 00" [1.0]: |i, v| i.view.rotation.x_axis.x = v,
        "camera rotation 10": |i, v| i.view.rotation.x_axis.y = v,
        "camera rotation 20": |i, v| i.view.rotation.x_axis.z = v,
        "camera rotation 01": |i, v| i.view.rotation.y_axis.x = v,
        "camera rotation 11" [1.0]: |i, v| i.view.rotation.y_axis.y = v,
        "camera rotation 21": |i, v| i.view.rotation.y_axis.z = v,
        "camera rotation 02": |i, v| i.view.rotation.z_axis.x = v,
        "camera rotation 12": |i, v| i.view.rotation.z_axis.y = v,
        "camera rotation 22" [1.0]: |i, v| i.view.rotation.z_axis.z = v,
        "camera translation x": |i, v| i.view.translation.x = v,
        "camera translation y": |i, v| i.view.translation.y = v,
        "camera translation z": |i, v| i.view.translation.z = v,
        "focal length x": |i, v| i.view.focal.x = v,
        "focal length y": |i, v| i.view.focal.y = v,
        "principal point x": |i, v| i.view.center.x = v,
        "principal point y": |i, v| i.view.center.y = v,
        "near plane": |i, v| i.view.near = v,
    ]
}

/// Counts of the outcomes of the values in a slot.
#[derive(Debug, Default)]
struct Tally {
    accepted: usize,
    refused: usize,
    unsupported: usize,
}

impl Tally {
    /// The number of values, or an error if they do not test the slot.
    fn values(&self, offered: Offered) -> Result<usize, Failure> {
        let &Self { accepted, refused, unsupported } = self;
        let settled = accepted == 0 || unsupported == 0;
        Failure::unless(settled, || format!("{accepted} values are accepted, and {unsupported} are not supported"))?;
        let needed = if offered == Offered::Optionally { accepted + unsupported } else { accepted };
        if needed == 0 || refused == 0 {
            return Err(Failure::Nothing(format!("{accepted} values are possible, {refused} are not")));
        }
        Ok(accepted + refused + unsupported)
    }
}

/// Tests all values in one slot, in every parameterization that the backend offers. Returns the
/// number of runs. Values that gs-core accepts must be accepted, and others refused.
pub(super) fn poison<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    slot: &Slot<S>,
) -> Result<usize, Failure> {
    let mut runs = 0;
    for parameterization in parameterizations::<S, R>(rasterizer)? {
        let mut tally = Tally::default();
        for value in slot.values() {
            let mut poisoned = inputs.clone();
            (slot.put)(&mut poisoned, value);
            let outcome = if check(&poisoned).is_err() {
                tally.refused += 1;
                refuses(rasterizer, &poisoned, parameterization)
            } else {
                match stands(rasterizer, inputs, &poisoned, parameterization) {
                    Err(Failure::Backend(Error::Unsupported { .. })) if slot.offered == Offered::Optionally => {
                        tally.unsupported += 1;
                        Ok(())
                    }
                    outcome => {
                        // A penalty of 0 has no effect.
                        tally.accepted += usize::from(differ(inputs, &poisoned));
                        outcome
                    }
                }
            };
            outcome.map_err(|failure| failure.at(format!("{value:e}, {parameterization:?}")))?;
        }
        runs += tally.values(slot.offered)?;
    }
    Ok(runs)
}

/// Whether gs-core accepts the inputs.
fn check<S: Subject>(inputs: &Inputs<S>) -> Result<(), Error> {
    check_picture(inputs)?;
    inputs.target.check_finite("the target")?;
    inputs.loss.validate()?;
    inputs.rates.validate()
}

/// Whether gs-core accepts the inputs of an image; sizes first.
fn check_picture<S: Subject>(inputs: &Inputs<S>) -> Result<(), Error> {
    S::check_view(&inputs.view)?;
    inputs.settings.validate()
}

/// Whether two inputs with the same Gaussians differ.
fn differ<S: Subject>(a: &Inputs<S>, b: &Inputs<S>) -> bool {
    show_differently(a, b) || a.target != b.target || a.loss != b.loss || a.rates != b.rates
}

/// Whether the inputs of the images differ.
fn show_differently<S: Subject>(a: &Inputs<S>, b: &Inputs<S>) -> bool {
    a.view != b.view || a.settings != b.settings
}

/// Checks that every call refuses invalid inputs, and that a refused step leaves the splats
/// unchanged.
fn refuses<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    parameterization: Parameterization,
) -> Result<(), Failure> {
    let refusal = |error: &Error| matches!(error, Error::Setting { .. } | Error::Size { .. } | Error::Pixel { .. });
    let target = rasterizer.upload_target(&inputs.target);
    if inputs.target.check_finite("the target").is_err() {
        return refused("the target", target, refusal);
    }
    let target = target?;
    let mut splats = rasterizer.upload(&inputs.scene, parameterization)?;
    let before = rasterizer.save(&splats).block_on()?;
    let pass = rasterizer.forward(&splats, &inputs.view, &inputs.settings);
    if check_picture(inputs).is_err() {
        refused("a forward pass", pass.block_on(), refusal)?;
    } else {
        let backward = rasterizer.backward(&splats, pass.block_on()?, &target, &inputs.loss);
        if inputs.loss.validate().is_err() {
            refused("a backward pass", backward.block_on(), refusal)?;
        } else {
            let (_, gradients) = backward.block_on()?;
            refused("a step", rasterizer.step(&mut splats, &gradients, &inputs.rates).block_on(), refusal)?;
        }
    }
    refused(
        "a training step",
        rasterizer.train_step(&mut splats, &inputs.view, &target, &inputs.step()).block_on(),
        refusal,
    )?;
    let kept = rasterizer.save(&splats).block_on()? == before;
    Failure::unless(kept, || "a step that was refused changed the splats".to_owned())
}

/// Checks that valid inputs are drawn as by the oracle, and trained without NaN losses. Gaussians
/// that do not stay finite must be culled and counted.
fn stands<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    clean: &Inputs<S>,
    inputs: &Inputs<S>,
    parameterization: Parameterization,
) -> Result<(), Failure> {
    let mut splats = rasterizer.upload(&inputs.scene, parameterization)?;
    if show_differently(clean, inputs) {
        is_drawn(rasterizer, inputs, &splats, parameterization)?;
    }
    let target = rasterizer.upload_target(&inputs.target)?;
    for _ in 0..2 {
        if let Err(error) = rasterizer.train_step(&mut splats, &inputs.view, &target, &inputs.step()).block_on() {
            let before = rasterizer.upload(&inputs.scene, parameterization)?;
            let kept = rasterizer.save(&splats).block_on()? == rasterizer.save(&before).block_on()?;
            Failure::unless(kept, || format!("a step that was refused ({error}) changed the splats"))?;
            return Err(error.into());
        }
    }
    let mut losses = Vec::new();
    rasterizer.losses(&mut splats, Wait::All, &mut losses).block_on()?;
    Failure::unless(!losses.iter().any(|loss| loss.is_nan()), || format!("losses {losses:?}"))?;
    let pass = rasterizer.forward(&splats, &inputs.view, &inputs.settings).block_on()?;
    let (image, culled) = (rasterizer.image(&pass).block_on()?, rasterizer.culled(&pass));
    is_finite(&image).map_err(|failure| failure.at("after two steps"))?;
    let after = rasterizer.download(&splats).block_on()?;
    let broken = (0..after.len()).filter(|&i| after.picked([i]).validate().is_err()).count();
    Failure::unless(culled.not_finite as usize >= broken, || {
        format!("after two steps, {broken} Gaussians are not finite, and {} are counted", culled.not_finite)
    })
}

/// Checks the image and the culled Gaussians against the oracle.
fn is_drawn<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    splats: &R::Splats,
    parameterization: Parameterization,
) -> Result<(), Failure> {
    let pass = rasterizer.forward(splats, &inputs.view, &inputs.settings).block_on()?;
    let (image, culled) = (rasterizer.image(&pass).block_on()?, rasterizer.culled(&pass));
    let rows = rows_of(rasterizer, &inputs.scene, splats, parameterization)?;
    let expected = Oracle::new(inputs.view, inputs.settings)?.render(&rows);
    let same = same_causes(culled, expected.culled);
    Failure::unless(same, || format!("left out {culled:?}, the oracle {:?}", expected.culled))?;
    match compare_images(&expected, &image) {
        Err(Failure::Nothing(_)) => is_finite(&image).map_err(|failure| failure.at("the background alone")),
        agreement => agreement.map(drop),
    }
}

fn is_finite(image: &Image) -> Result<(), Failure> {
    Ok(image.check_finite("the image")?)
}
