//! Negative controls of the suite: a backend with one fault fails the case that is meant to find
//! it.

use pollster::FutureExt as _;
use std::ops::{Deref, DerefMut};

use glam::Vec2Swizzles;
use gs_conformance::conformance::cases;
use gs_core::{
    AdamRates, Backend, Canvas, Culled, DensityStatistics, EditPlan, Error, Gaussian2d, Image, Loss, MeanNoise,
    Optimizer, Parameterization, Rasterizer, RenderSettings, Scene, Scene2d, SplatsState, TargetImage, TrainStep, Wait,
    effects::{Antialias, Blend, Statistics},
};
use gs_cpu::{CpuRasterizer, CpuSettings, ForwardPass, Gradients, Splats2d, Target};

/// The fault of the backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    /// No fault.
    Faultless,
    ShiftsImages,
    DimsImages,
    ForgetsTheBackground,
    ForgetsTheCanvas,
    ForgetsTheAccuracy,
    ForgetsAntialiasing,
    ForgetsCompensation,
    PaintsEmptyScenes,
    CountsNothingCulled,
    NegatesRotationGradients,
    SwapsMeanGradients,
    DoublesLosses,
    DoublesTheLossAlone,
    GradientsInWrongUnits,
    IgnoresTheBlueGradient,
    LosesTheLastGaussian,
    ForgetsMomentsOnRestore,
    StepsUphill,
    ForgetsBiasCorrection,
    IgnoresEpsilon,
    SwapsRates,
    FusedStepDoesTooMuch,
    SwapsLosses,
    DropsLosses,
    RepeatsLosses,
    ForgetsLossesOnEdit,
    DoublesStatistics,
    LetsGradientsCancel,
    MistakesErrorsForGradients,
    CountsStepsForPixels,
    CollectsUnderOneBlend,
    NoiseIsAStep,
    IgnoresMasks,
    IgnoresAlpha,
    IgnoresWeights,
    SolvesNothing,
    ForgetsMomentsOnEdit,
    ForgetsStatisticsOnEdit,
    EditsEvenWhenItRefuses,
    AcceptsNan,
    SwallowsBadSettings,
    RestoresAnything,
    DrawsByParity,
    NoCropOrigin,
}

use Fault::*;

struct Sabotaged {
    sound: CpuRasterizer,
    fault: Fault,
}

/// Splats of the correct backend, and losses that the caller has not taken yet.
struct Kept {
    sound: Splats2d,
    losses: Vec<f32>,
}

impl From<Splats2d> for Kept {
    fn from(sound: Splats2d) -> Self {
        Self { sound, losses: Vec::new() }
    }
}

impl Deref for Kept {
    type Target = Splats2d;

    fn deref(&self) -> &Splats2d {
        &self.sound
    }
}

impl DerefMut for Kept {
    fn deref_mut(&mut self) -> &mut Splats2d {
        &mut self.sound
    }
}

impl Sabotaged {
    fn sound(
        &self,
    ) -> &impl Optimizer<
        Scene2d,
        Splats = Splats2d,
        ForwardPass = ForwardPass<Scene2d>,
        Gradients = Gradients<Scene2d>,
        Target = Target,
    > {
        self.sound.for_2d()
    }

    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }

    /// Replaces the splats by ones with an altered state.
    fn alter(&self, splats: &mut Kept, change: impl Fn(&mut SplatsState)) -> Result<(), Error> {
        let mut state = self.sound().save(splats).block_on()?;
        change(&mut state);
        splats.sound = self.sound().restore(&state)?;
        Ok(())
    }
}

fn zero_moments(state: &mut SplatsState) {
    let count = state.integers("steps").unwrap().len();
    state.insert("moment1", vec![[0.0; 9]; count]);
    state.insert("moment2", vec![[0.0; 9]; count]);
}

type Sound = CpuRasterizer;

impl Backend for Sabotaged {
    fn describe(&self) -> String {
        format!("{:?}", self.fault)
    }
}

impl Rasterizer<Scene2d> for Sabotaged {
    type Splats = Kept;
    type ForwardPass = <Sound as Rasterizer<Scene2d>>::ForwardPass;
    type Gradients = <Sound as Rasterizer<Scene2d>>::Gradients;
    type Target = <Sound as Rasterizer<Scene2d>>::Target;

    fn upload(&self, scene: &Scene2d, parameterization: Parameterization) -> Result<Self::Splats, Error> {
        let mut scene = scene.clone();
        if self.is(AcceptsNan) {
            scene.means.iter_mut().filter(|m| m.is_nan()).for_each(|m| *m = glam::Vec2::ZERO);
        }
        if self.is(PaintsEmptyScenes) && scene.is_empty() {
            let (mean, color) = (glam::Vec2::splat(4.0), glam::Vec3::ONE);
            let log_scale = glam::Vec2::ONE;
            scene.push(Gaussian2d { mean, log_scale, rotation: 0.0, opacity_logit: f32::INFINITY, color });
        }
        self.sound().upload(&scene, parameterization).map(Kept::from)
    }

    async fn download(&self, splats: &Self::Splats) -> Result<Scene2d, Error> {
        let scene = self.sound().download(splats).block_on()?;
        let count = scene.len().saturating_sub(usize::from(self.is(LosesTheLastGaussian)));
        Ok(if count == scene.len() { scene } else { scene.iter().take(count).collect() })
    }

    fn len(&self, splats: &Self::Splats) -> usize {
        self.sound().len(splats)
    }

    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Self::Target, Error> {
        let mut target = target.into();
        match self.fault {
            IgnoresMasks => target.mask = None,
            IgnoresAlpha => target.alpha = None,
            IgnoresWeights => target.weights = None,
            _ => {}
        }
        self.sound().upload_target(target)
    }

    async fn forward(
        &self,
        splats: &Self::Splats,
        view: &Canvas,
        settings: &RenderSettings,
    ) -> Result<Self::ForwardPass, Error> {
        let (mut view, mut settings) = (*view, *settings);
        let collects = !matches!(settings.effects.statistics, Statistics::None | Statistics::MeanGradient);
        if self.is(CollectsUnderOneBlend) && collects && settings.effects.blend == Blend::Over {
            return Err(Error::Unsupported { backend: "sabotaged", effect: "statistics in an order".to_owned() });
        }
        match self.fault {
            ForgetsTheBackground => settings.effects.background = gs_core::effects::Background::None,
            ForgetsTheCanvas => view = Canvas::new(view.width, view.height),
            NoCropOrigin => view.origin = glam::Vec2::ZERO,
            ForgetsTheAccuracy => settings.accuracy = gs_core::Accuracy::default(),
            ForgetsAntialiasing => settings.effects.antialias = Antialias::None,
            ForgetsCompensation if settings.effects.antialias.compensates() => {
                settings.effects.antialias = Antialias::Dilate;
            }
            LetsGradientsCancel if settings.effects.statistics == Statistics::AbsoluteGradient => {
                settings.effects.statistics = Statistics::MeanGradient;
            }
            MistakesErrorsForGradients if settings.effects.statistics == Statistics::PixelError => {
                settings.effects.statistics = Statistics::AbsoluteGradient;
            }
            CountsStepsForPixels if settings.effects.statistics == Statistics::PixelGradient => {
                settings.effects.statistics = Statistics::MeanGradient;
            }
            SwallowsBadSettings if settings.validate().is_err() => settings = RenderSettings::default(),
            _ => {}
        }
        if self.is(DrawsByParity) {
            let mut scene = self.sound().download(splats).block_on()?;
            scene.colors.iter_mut().step_by(2).for_each(|c| *c *= 0.9);
            return self
                .sound()
                .forward(&self.sound().upload(&scene, Parameterization::ScaleRotation)?, &view, &settings)
                .block_on();
        }
        self.sound().forward(splats, &view, &settings).block_on()
    }

    async fn image(&self, pass: &Self::ForwardPass) -> Result<Image, Error> {
        let image = self.sound().image(pass).block_on()?;
        let (w, h) = image.size();
        match self.fault {
            ShiftsImages => Image::from_fn(w, h, |x, y| image.pixel((x + 1) % w, y)),
            DimsImages => Image::from_fn(w, h, |x, y| image.pixel(x, y).map(|v| v * 0.9999)),
            _ => Ok(image),
        }
    }

    fn culled(&self, pass: &Self::ForwardPass) -> Culled {
        if self.is(CountsNothingCulled) { Culled::default() } else { self.sound().culled(pass) }
    }

    async fn backward(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        target: &Self::Target,
        loss: &Loss,
    ) -> Result<(f32, Self::Gradients), Error> {
        let (loss, gradients) = self.sound().backward(splats, pass, target, loss).block_on()?;
        Ok((if self.is(DoublesLosses) { 2.0 * loss } else { loss }, gradients))
    }

    async fn loss(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        target: &Self::Target,
        loss: &Loss,
    ) -> Result<f32, Error> {
        let loss = self.backward(splats, pass, target, loss).block_on()?.0;
        Ok(if self.is(DoublesTheLossAlone) { 2.0 * loss } else { loss })
    }

    async fn image_vjp(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        v_image: &Image,
    ) -> Result<Self::Gradients, Error> {
        if self.is(IgnoresTheBlueGradient) {
            let (width, height) = v_image.size();
            let v_image = Image::from_fn(width, height, |x, y| {
                let [red, green, _] = v_image.pixel(x, y);
                [red, green, 0.0]
            })?;
            return self.sound().image_vjp(splats, pass, &v_image).block_on();
        }
        self.sound().image_vjp(splats, pass, v_image).block_on()
    }

    async fn gradients(&self, splats: &Self::Splats, gradients: &Self::Gradients) -> Result<Scene2d, Error> {
        let mut scene = self.sound().gradients(splats, gradients).block_on()?;
        match self.fault {
            NegatesRotationGradients => scene.rotations.iter_mut().for_each(|v| *v = -*v),
            SwapsMeanGradients => scene.means.iter_mut().for_each(|v| *v = v.yx()),
            GradientsInWrongUnits => scene.means.iter_mut().for_each(|v| *v *= 1.01),
            _ => {}
        }
        Ok(scene)
    }
}

impl Optimizer<Scene2d> for Sabotaged {
    async fn save(&self, splats: &Self::Splats) -> Result<SplatsState, Error> {
        self.sound().save(splats).block_on()
    }

    fn restore(&self, state: &SplatsState) -> Result<Self::Splats, Error> {
        if self.is(RestoresAnything) && self.sound().restore(state).is_err() {
            return self.sound().upload(&Scene2d::default(), state.parameterization).map(Kept::from);
        }
        let mut splats = Kept::from(self.sound().restore(state)?);
        if self.is(ForgetsMomentsOnRestore) {
            self.alter(&mut splats, zero_moments)?;
        }
        Ok(splats)
    }

    async fn step(
        &self,
        splats: &mut Self::Splats,
        gradients: &Self::Gradients,
        rates: &AdamRates,
    ) -> Result<(), Error> {
        let mut rates = *rates;
        match self.fault {
            StepsUphill => {
                for rate in
                    [&mut rates.mean, &mut rates.scale, &mut rates.rotation, &mut rates.opacity, &mut rates.color]
                {
                    rate.learning_rate *= -1.0;
                }
            }
            IgnoresEpsilon => rates.epsilon = 1e-15,
            SwapsRates => std::mem::swap(&mut rates.mean, &mut rates.scale),
            ForgetsBiasCorrection => self.alter(splats, |state| {
                let count = state.integers("steps").unwrap().len();
                state.insert_u32("steps", vec![1_000_000; count]);
            })?,
            _ => {}
        }
        self.sound().step(splats, gradients, &rates).block_on()
    }

    async fn train_step(
        &self,
        splats: &mut Self::Splats,
        view: &Canvas,
        target: &Self::Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        let pass = self.forward(splats, view, step.settings).block_on()?;
        let (loss, gradients) = self.backward(splats, pass, target, &step.loss).block_on()?;
        self.step(splats, &gradients, step.rates).block_on()?;
        if self.is(FusedStepDoesTooMuch) {
            self.step(splats, &gradients, step.rates).block_on()?;
        }
        splats.losses.push(loss);
        Ok(())
    }

    async fn losses(&self, splats: &mut Self::Splats, _: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        let known = losses.len();
        losses.append(&mut splats.losses);
        match self.fault {
            SwapsLosses => losses[known..].reverse(),
            DropsLosses if losses.len() > known + 1 => drop(losses.pop()),
            RepeatsLosses => splats.losses.extend_from_slice(&losses[known..]),
            _ => {}
        }
        Ok(())
    }

    async fn solve_colors(
        &self,
        splats: &mut Self::Splats,
        view: &Canvas,
        target: &Self::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        let iterations = if self.is(SolvesNothing) { 1 } else { iterations };
        self.sound().solve_colors(splats, view, target, settings, iterations).block_on()
    }

    async fn statistics(&self, splats: &Self::Splats) -> Result<DensityStatistics, Error> {
        let mut statistics = self.sound().statistics(splats).block_on()?;
        if self.is(DoublesStatistics) {
            statistics.signal_sum.iter_mut().for_each(|v| *v *= 2.0);
        }
        Ok(statistics)
    }

    fn add_noise(&self, splats: &mut Self::Splats, noise: &MeanNoise) -> Result<(), Error> {
        self.sound().add_noise(splats, noise)?;
        if self.is(NoiseIsAStep) { self.alter(splats, zero_moments) } else { Ok(()) }
    }

    async fn edit(&self, splats: &mut Self::Splats, plan: &EditPlan<Gaussian2d>) -> Result<(), Error> {
        if self.is(EditsEvenWhenItRefuses) && plan.sources(self.sound().len(splats)).is_err() {
            self.alter(splats, zero_moments)?;
        }
        self.sound().edit(splats, plan).block_on()?;
        match self.fault {
            ForgetsMomentsOnEdit => self.alter(splats, zero_moments),
            ForgetsStatisticsOnEdit => self.alter(splats, |state| {
                let count = state.integers("steps").unwrap().len();
                state.insert("gradient_sum", vec![[0.0]; count]);
            }),
            ForgetsLossesOnEdit => {
                splats.losses.clear();
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

#[test]
fn every_fault_is_caught_by_its_case() {
    let caught_by = [
        (ShiftsImages, "images_match"),
        (ShiftsImages, "sizes_match"),
        (DimsImages, "images_match"),
        (ForgetsTheBackground, "images_match"),
        (ForgetsTheBackground, "empty_scenes_show_the_background"),
        (ForgetsTheCanvas, "canvases_match"),
        (ForgetsTheCanvas, "gradients_match_through_canvases"),
        (ForgetsTheAccuracy, "other_accuracies_match"),
        (ForgetsAntialiasing, "antialiased_images_match_2d"),
        (ForgetsCompensation, "antialiased_images_match_2d"),
        (ForgetsCompensation, "antialiased_gradients_match_2d"),
        (PaintsEmptyScenes, "empty_scenes_show_the_background"),
        (CountsNothingCulled, "culled_are_counted"),
        (NegatesRotationGradients, "gradients_match"),
        (SwapsMeanGradients, "gradients_match_in_covariance_factors"),
        (GradientsInWrongUnits, "gradients_match"),
        (IgnoresTheBlueGradient, "image_vjps_match"),
        (GradientsInWrongUnits, "statistics_are_the_positional_gradients"),
        (DoublesLosses, "gradients_match"),
        (DoublesLosses, "steps_decrease_the_loss"),
        (DoublesTheLossAlone, "incomplete_targets_are_completed"),
        (LosesTheLastGaussian, "scenes_come_back"),
        (ForgetsMomentsOnRestore, "restored_splats_continue_bit_for_bit"),
        (ForgetsMomentsOnRestore, "first_steps_do_not_reuse_lists_of_renderings"),
        (StepsUphill, "steps_decrease_the_loss"),
        (StepsUphill, "covariance_factor_steps_match"),
        (ForgetsBiasCorrection, "adam_matches"),
        (IgnoresEpsilon, "adam_matches"),
        (SwapsRates, "adam_matches"),
        (SwapsRates, "covariance_factor_steps_match"),
        (FusedStepDoesTooMuch, "fused_steps_match_separate_stages"),
        (SwapsLosses, "losses_are_reported_once_and_in_order"),
        (DropsLosses, "losses_are_reported_once_and_in_order"),
        (RepeatsLosses, "losses_are_reported_once_and_in_order"),
        (ForgetsLossesOnEdit, "every_call_sees_pending_steps"),
        (DoublesStatistics, "statistics_are_the_positional_gradients"),
        (LetsGradientsCancel, "absolute_gradients_match"),
        (MistakesErrorsForGradients, "pixel_errors_match"),
        (CountsStepsForPixels, "pixel_gradients_match"),
        (CollectsUnderOneBlend, "absolute_gradients_match"),
        (CollectsUnderOneBlend, "pixel_errors_match"),
        (IgnoresMasks, "incomplete_targets_are_completed"),
        (IgnoresAlpha, "incomplete_targets_are_completed"),
        (IgnoresWeights, "weights_are_factors_of_the_loss"),
        (IgnoresWeights, "solved_colors_are_the_best"),
        (NoiseIsAStep, "noise_moves_means_and_nothing_else"),
        (SolvesNothing, "solved_colors_are_the_best"),
        (ForgetsMomentsOnEdit, "edits_carry_everything_along"),
        (ForgetsMomentsOnEdit, "changes_that_inherit_go_on"),
        (ForgetsMomentsOnEdit, "adam_matches"),
        (ForgetsStatisticsOnEdit, "edits_carry_everything_along"),
        (EditsEvenWhenItRefuses, "refused_edits_change_nothing"),
        (AcceptsNan, "scenes_that_are_not_finite_are_refused"),
        (SwallowsBadSettings, "bad_views_and_settings_are_errors"),
        (RestoresAnything, "mismatches_are_errors"),
        (DrawsByParity, "order_does_not_matter_under_sum"),
        (DrawsByParity, "halves_make_the_whole"),
        (NoCropOrigin, "crops_are_parts_of_the_image"),
    ];
    let cases = cases::<Sabotaged>();
    let passes = |fault, name| {
        let sound = CpuRasterizer::new(CpuSettings::default().with(|s| {
            s.threads = Some(2);
            s.level = None;
        }))
        .unwrap();
        let case = cases.iter().find(|case| case.name == name).unwrap();
        (case.run)(&Sabotaged { sound, fault }).is_ok()
    };
    let missed: Vec<_> = caught_by.iter().filter(|&&(fault, name)| passes(fault, name)).collect();
    assert!(missed.is_empty(), "not caught: {missed:?}");
    let unguarded: Vec<_> = cases.iter().map(|c| c.name).filter(|n| !caught_by.iter().any(|(_, m)| m == n)).collect();
    assert!(unguarded.is_empty(), "cases without a negative control: {unguarded:?}");
    let caught_without_fault: Vec<_> = cases.iter().map(|c| c.name).filter(|name| !passes(Faultless, name)).collect();
    assert!(caught_without_fault.is_empty(), "fail without a fault: {caught_without_fault:?}");
}
