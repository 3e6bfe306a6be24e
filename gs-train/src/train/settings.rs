//! Settings of a 3D training: everything that it depends on besides its views and the backend.

use gs_core::{
    Adam, AdamRates, Dropout, Effects, Error, Loss, Output, RenderSettings, Scene as _, Scene3d,
    constants::MAX_GAUSSIANS, math::random_words,
};
use gs_density::Policy;
use serde::{Deserialize, Serialize};

use super::{exposure::Exposure, poses::RefinePoses};
use crate::run::{Recovery, Rounds, RunSettings, in_a_file, same_settings};
use crate::{
    start::{PointInit, Start, is_zero},
    views::Resolution,
};

gs_core::impl_with!(TrainSettings);
in_a_file!(TrainSettings);

/// Settings of a training in 3D. Runs with equal settings, views, start and backend give equal
/// results, bit for bit.
///
/// Missing fields of a serialised form take the value of [`TrainSettings::default`]; unknown ones
/// are an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct TrainSettings {
    /// Largest number of Gaussians, at least 1.
    pub gaussians: u32,
    /// Number of Gaussians for each point that training starts from, far points of
    /// [`PointInit::far_points`] not counted. If that makes more than [`Self::gaussians`], `gaussians` is
    /// raised to it before the first step, to twice its value at most. Not negative; default 0:
    /// never. The settings of a training that has begun have the raised number, and 0 here.
    #[serde(skip_serializing_if = "is_zero")]
    pub gaussians_per_point: f32,
    /// Number of Gaussians, the first of the scene that training starts from, that are drawn but stay as they
    /// are: steps, noise and density control do not touch them. They count in [`Self::gaussians`]. Default 0.
    #[serde(skip_serializing_if = "is_zero_count")]
    pub fixed: u32,
    /// Whether the run ends with exactly as many Gaussians as [`Self::gaussians`] says, along a
    /// schedule ([`CountSchedule`](gs_density::CountSchedule)), under any policy. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub exactly: bool,
    /// Number of steps, one view each; 0 leaves the first scene as it is.
    pub iterations: u32,
    /// Number of steps of a longer run, if a trial before the first step shows that it would gain. The trial does a
    /// part of the run on small images without some of the training views, which measure it
    /// ([`TrialReport`](super::TrialReport)). With at most [`Self::iterations`], or with fewer than five training views, there is no
    /// trial. Ignored (set to 0) when training starts from a scene. Default 0. The settings of a training that has begun
    /// have the decided number of steps, and 0 here.
    #[serde(skip_serializing_if = "is_zero_count")]
    pub lengthen_to: u32,
    /// Whether the trial also decides the largest number of Gaussians: the one that was best where more of them harm the
    /// views that it leaves out, and otherwise twice [`Self::gaussians`] where the run is lengthened. Ignored with
    /// [`Self::exactly`]. Default false. The settings of a training that has begun have the decided number as
    /// [`Self::gaussians`], and false here.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub decide_gaussians: bool,
    /// Number of steps over which learning rates decay; 0 for all of the run. The published
    /// settings decay over 30,000, also in shorter runs.
    pub decay_over: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Extent of the scene, world units; by default that of the cameras
    /// ([`extent_of`](super::extent_of)).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extent: Option<f32>,
    /// Effects, background and accuracy. Its `effects.sh_degree` is the highest; the policy decides
    /// about its `effects.statistics`.
    pub render: RenderSettings,
    /// Steps after which the SH degree grows by one, from 0; 0 starts with the highest. Default
    /// 1000 (3DGS).
    pub sh_degree_every: u32,
    /// Loss to minimise.
    pub loss: Loss,
    /// Settings of the optimizer. The bounds of scales and the learning rate of means are in units of
    /// the extent.
    pub adam: Adam,
    /// The first Gaussians at points.
    pub init: PointInit,
    /// Share of the Gaussians that a step leaves out at random, 0..=0.9. It rises linearly from 0 in
    /// the first step to this value in the last (*source:* [`Dropout`]). Default 0.
    #[serde(skip_serializing_if = "is_zero")]
    pub dropout: f32,
    /// Policy of density control.
    pub policy: Policy,
    /// Rounds of density control.
    pub rounds: Rounds,
    /// Share of the run, at its end, whose scenes are averaged, 0..=1: the run ends with the mean of
    /// each parameter over at most 32 scenes, evenly spread over these steps. After a round of
    /// density control the mean begins again, because there are other Gaussians. (*Source:* Izmailov
    /// et al. 2018, *Averaging Weights Leads to Wider Optima and Better Generalization*, arXiv
    /// 1803.05407.) Default 0: the run ends with the last scene.
    #[serde(skip_serializing_if = "is_zero")]
    pub average_last: f32,
    /// Whether Gaussians that no training view shows are removed after the last step, because other
    /// views may show them: those whose ellipse reaches into no image, and those that are too
    /// transparent to be drawn. A run that ends with [`Self::exactly`] its number of Gaussians keeps
    /// them. Ignored (set to false) when training starts from a scene. Default: false, as published;
    /// true in the presets `standard` and `quick`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub remove_unseen: bool,
    /// What happens to a diverging training.
    #[serde(skip_serializing_if = "Recovery::is_default")]
    pub recovery: Recovery,
    /// Resolution of the images in the steps.
    pub resolution: Resolution,
    /// What happens to differences in exposure and white balance between images.
    #[serde(skip_serializing_if = "Exposure::is_off")]
    pub exposure: Exposure,
    /// Whether the poses of the training views' cameras are refined along with the scene.
    #[serde(skip_serializing_if = "RefinePoses::is_off")]
    pub refine_poses: RefinePoses,
}
/// Settings files leave out counts that are 0 by default.
fn is_zero_count(value: &u32) -> bool {
    *value == 0
}

impl TrainSettings {
    /// Returns these settings with this largest number of Gaussians, which the points that training
    /// starts from do not raise, nor a trial changes.
    #[must_use]
    pub fn with_gaussians(self, gaussians: u32) -> Self {
        Self { gaussians, gaussians_per_point: 0.0, decide_gaussians: false, ..self }
    }

    /// Returns these settings with the largest number of Gaussians for a start from this many points
    /// ([`Self::gaussians_per_point`]).
    #[must_use]
    pub(crate) fn for_points(self, points: usize) -> Self {
        let wanted = (f64::from(self.gaussians_per_point) * points as f64) as u32;
        let gaussians = wanted.clamp(self.gaussians, self.most_for_points());
        Self { gaussians, gaussians_per_point: 0.0, ..self }
    }

    /// Returns these settings for a start from a scene of this many Gaussians: all of them may be needed, there is no
    /// trial, and there is room for them unless the largest number is one that points would not raise either
    /// ([`Self::gaussians_per_point`]).
    #[must_use]
    pub(crate) fn for_scene(self, gaussians: usize) -> Self {
        let raised = u32::try_from(gaussians).unwrap_or(u32::MAX).clamp(self.gaussians, MAX_GAUSSIANS);
        let gaussians = if self.gaussians_per_point > 0.0 { raised } else { self.gaussians };
        Self { gaussians, remove_unseen: false, lengthen_to: 0, decide_gaussians: false, ..self }
    }

    /// Returns these settings as those of a training that has begun with them, if `held` are its
    /// [settings](super::Trainer3d::settings_to_repeat): with what its start has measured, raised or left out. If `held`
    /// differ from what is returned, the training began with other settings.
    #[must_use]
    pub fn begun_as(self, held: &Self, start: &Start) -> Self {
        let mut begun = match start {
            Start::Scene(scene) => self.for_scene(scene.len()),
            _ => self,
        };
        begun.extent = begun.extent.or(held.extent);
        if begun.gaussians_per_point > 0.0 && (begun.gaussians..=begun.most_for_points()).contains(&held.gaussians) {
            (begun.gaussians, begun.gaussians_per_point) = (held.gaussians, 0.0);
        }
        // Too few views, or too short a run, to decide anything.
        if held.lengthen_to == 0 {
            (begun.lengthen_to, begun.decide_gaussians) = (0, false);
        }
        begun
    }

    fn most_for_points(&self) -> u32 {
        self.gaussians.saturating_mul(2).min(MAX_GAUSSIANS).max(self.gaussians)
    }

    /// Returns these settings for a run of another number of steps: rounds, resets, decay and SH degrees are at the same
    /// shares of the run, and what happens in rounds stays in rounds.
    #[must_use]
    pub(crate) fn lasting(mut self, iterations: u32) -> Self {
        if iterations == self.iterations {
            return self;
        }
        let factor = f64::from(iterations) / f64::from(self.iterations.max(1));
        let scaled = |steps: u32| (f64::from(steps) * factor).round() as u32;
        let at_least_one = |steps: u32| if steps > 0 { scaled(steps).max(1) } else { 0 };
        let Rounds { every, from, until } = self.rounds;
        self.rounds = Rounds { every: at_least_one(every), from: scaled(from), until: scaled(until) };
        // A reset is part of a round.
        let round = self.rounds.every.max(1);
        let of_rounds = |steps: u32| if steps > 0 { scaled(steps).div_ceil(round).max(1) * round } else { 0 };
        self.decay_over = at_least_one(self.decay_over);
        self.sh_degree_every = at_least_one(self.sh_degree_every);
        if let Some(actions) = self.policy.actions_mut() {
            actions.reset.every = of_rounds(actions.reset.every);
            actions.reset.once_after = of_rounds(actions.reset.once_after);
            actions.prune.larger_after = scaled(actions.prune.larger_after);
        }
        (self.iterations, self.lengthen_to) = (iterations, 0);
        self
    }

    /// The Gaussians that the step after `step` steps leaves out.
    pub(super) fn dropout_at(&self, step: u32) -> Dropout {
        Dropout::default().with(|s| {
            s.rate = self.dropout * (step as f32 / self.iterations.saturating_sub(1).max(1) as f32).min(1.0);
            s.seed = random_words([self.seed, step, 0, 2])[0];
        })
    }

    /// Highest SH degree in the step after `step` steps.
    pub(super) fn sh_degree_at(&self, step: u32) -> u8 {
        let highest = self.render.effects.sh_degree;
        match self.sh_degree_every {
            0 => highest,
            every => u8::try_from(step.saturating_add(1) / every).unwrap_or(u8::MAX).min(highest),
        }
    }

    /// Settings of Adam after `step` steps, in world units.
    pub(super) fn rates_at(&self, step: u32, extent: f32) -> AdamRates {
        let mut rates = self.adam.at(self.decay_at(step));
        rates.mean.learning_rate *= extent;
        rates.min_scale *= extent;
        rates.max_scale *= extent;
        rates.fixed = self.fixed;
        rates
    }

    /// Progress of the decay of learning rates after `step` steps: 0 at first, 1 at the end or
    /// after [`Self::decay_over`] steps.
    fn decay_at(&self, step: u32) -> f32 {
        let steps = if self.decay_over > 0 { self.decay_over } else { self.iterations };
        (step as f32 / steps.max(1) as f32).min(1.0)
    }

    /// Returns these settings with this background. With white, settings that reset opacities do so
    /// also at the first round of density control, which removes white fog (*source:* 3DGS).
    #[must_use]
    pub fn on(mut self, background: [f32; 3]) -> Self {
        self.render = self.render.on(background);
        let first = self.rounds.from.next_multiple_of(self.rounds.every.max(1));
        if let Some(actions) = self.policy.actions_mut().filter(|actions| actions.reset.every > 0) {
            actions.reset.once_after = if background == [1.0; 3] { first } else { 0 };
        }
        self
    }

    /// Returns these settings with another policy. Pruning and opacity resets stay those of these
    /// settings, or those of 3DGS where they have none; MRNF, which resets no opacities, has its
    /// own. Where a policy prunes on after its growth, as FastGS and MRNF do, the rounds of a preset
    /// go on for as long as is published, if that fits into the run. In runs that are shorter than
    /// the published ones, FastGS prunes as often after its growth as there.
    #[must_use]
    pub fn with_policy(mut self, policy: Policy) -> Self {
        let usual = self.policy.actions().copied().or(Self::default().policy.actions().copied()).unwrap_or_default();
        self.policy = policy.for_3d();
        let has_own = matches!(self.policy, Policy::Mrnf(_));
        if let Some(actions) = self.policy.actions_mut() {
            if !has_own {
                (actions.prune, actions.reset) = (usual.prune, usual.reset);
            }
            // Growth ends where that of these settings does.
            let share = f64::from(actions.growth_fraction / usual.growth_fraction);
            let until = (f64::from(self.rounds.until) / share).round();
            if share < 1.0 && until < f64::from(self.iterations) {
                self.rounds.until = until as u32;
            }
        }
        if let Policy::FastGs(fast) = &mut self.policy {
            let every = self.rounds.every.max(1);
            // A tenth of the run, but as published in one of 30,000 steps or more.
            fast.final_every = fast.final_every.min(self.iterations / 10).next_multiple_of(every).max(every);
        }
        self
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range, and what is allowed.
    pub fn validate(&self) -> Result<(), Error> {
        Error::within("the number of Gaussians", self.gaussians, 1..=MAX_GAUSSIANS, "1 to 100,000,000")?;
        Error::within("the number of fixed Gaussians", self.fixed, ..self.gaussians, "less than that of all")?;
        if self.fixed > 0 && self.refine_poses != RefinePoses::Off {
            return Err(Error::setting("refine-poses", self.refine_poses, "off where some Gaussians are fixed"));
        }
        let per_point = self.gaussians_per_point;
        Error::within("gaussians-per-point", per_point, 0.0..=f32::MAX, "finite and not negative")?;
        let extent = self.extent.unwrap_or(1.0);
        Error::within("the extent", extent, f32::MIN_POSITIVE..=f32::MAX, "positive and finite")?;
        Error::within("average-last", self.average_last, 0.0..=1.0, "0 to 1")?;
        self.init.validate()?;
        self.policy.validate_3d()?;
        self.rounds.validate()?;
        self.resolution.validate()?;
        if self.render.output != Output::Color {
            return Err(Error::setting("render.output", self.render.output.name(), "color, which images show"));
        }
        if !self.render.dropout.is_none() {
            return Err(Error::setting(
                "render.dropout",
                self.render.dropout.rate,
                "0: set `dropout` instead, from which each step's rate follows",
            ));
        }
        self.render.with(|s| s.dropout.rate = self.dropout).validate()?;
        self.loss.validate()?;
        self.adam.validate()
    }
}

impl RunSettings<Scene3d> for TrainSettings {
    const FORMAT: &'static str = "training-3d-1";

    same_settings!(Scene3d);

    fn average_last(&self) -> f32 {
        self.average_last
    }

    fn budget_is_bound(&self) -> bool {
        self.gaussians == Self::default().gaussians && !self.policy.aims_at_budget()
    }

    fn fixed(&self) -> u32 {
        self.fixed
    }

    fn effects_after(&self, step: u32) -> Effects {
        Effects { sh_degree: self.sh_degree_at(step), ..self.render.effects }
    }

    fn mean_factor(&self, step: u32) -> f32 {
        self.adam.mean.schedule.factor(self.decay_at(step))
    }

    fn scale_bounds(&self) -> (f32, f32) {
        let rates = self.rates_at(0, self.extent.unwrap_or(1.0));
        (rates.min_scale, rates.max_scale)
    }

    /// Returns true: each step has another view.
    fn bins_afresh_after(&self, _: u32) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::presets::TrainPreset;

    #[test]
    fn presets_are_valid_and_come_back_unchanged() {
        for preset in TrainPreset::ALL {
            for iterations in [None, Some(0), Some(1), Some(300), Some(7_000)] {
                let settings = preset.settings(iterations);
                settings.validate().unwrap();
                let text = toml::to_string(&settings).unwrap();
                assert_eq!(toml::from_str::<TrainSettings>(&text).unwrap(), settings, "{text}");
            }
        }
    }

    #[cfg(feature = "edit")]
    #[test]
    fn a_run_of_other_length_has_its_rounds_and_resets_at_the_same_shares() {
        for preset in TrainPreset::ALL {
            for steps in [1, 113, 2_640, 11_000, 29_999] {
                let whole = preset.settings(Some(30_000));
                let settings = whole.clone().lasting(steps);
                settings.validate().unwrap();
                assert_eq!(settings.iterations, steps);
                let share = |settings: &TrainSettings, at: u32| f64::from(at) / f64::from(settings.iterations);
                let [now, before] = [&settings, &whole].map(|settings| share(settings, settings.rounds.until));
                assert!((now - before).abs() <= 0.5 / f64::from(steps) + 1e-9, "{preset}: {now} {before}");
                let resets = |settings: &TrainSettings| settings.policy.clone().actions_mut().map(|a| a.reset.every);
                let [now, before] = [&settings, &whole].map(|settings| resets(settings).unwrap_or_default());
                assert!(now.is_multiple_of(settings.rounds.every.max(1)), "{preset}: {now}");
                assert_eq!(now > 0, before > 0);
            }
        }
    }

    #[test]
    fn degrees_grow_one_by_one() {
        let settings = TrainSettings { sh_degree_every: 100, ..TrainSettings::default() };
        let degrees = [0, 98, 99, 199, 299, 999, u32::MAX].map(|step| settings.sh_degree_at(step));
        assert_eq!(degrees, [0, 0, 1, 2, 3, 3, 3]);
        assert_eq!(TrainSettings { sh_degree_every: 0, ..settings }.sh_degree_at(0), 3);
    }

    #[test]
    fn many_points_raise_the_number_of_gaussians_to_twice_at_most() {
        let settings = TrainSettings { gaussians: 100, gaussians_per_point: 4.0, ..TrainSettings::default() };
        let raised = [0, 25, 30, 50, 1_000].map(|points| settings.clone().for_points(points).gaussians);
        assert_eq!(raised, [100, 100, 120, 200, 200]);
        assert_eq!(settings.clone().for_points(30), settings.clone().with_gaussians(120));
        assert_eq!(settings.with_gaussians(70).for_points(1_000).gaussians, 70);
    }

    #[test]
    fn a_resumed_training_allows_only_what_its_start_may_have_changed() {
        let mut wanted = TrainSettings { gaussians: 100, gaussians_per_point: 4.0, ..TrainSettings::default() };
        (wanted.lengthen_to, wanted.decide_gaussians) = (wanted.iterations + 1, true);
        let held = |gaussians: u32| {
            let extent = Some(7.0);
            TrainSettings { gaussians, gaussians_per_point: 0.0, extent, ..wanted.clone() }
        };
        let allowed = [99, 100, 200, 201].map(|n| wanted.clone().begun_as(&held(n), &Start::Random) == held(n));
        assert_eq!(allowed, [false, true, true, false]);
        let without_trial = TrainSettings { lengthen_to: 0, decide_gaussians: false, ..held(100) };
        assert_eq!(wanted.clone().begun_as(&without_trial, &Start::Random), without_trial);
        assert_ne!(wanted.clone().with_gaussians(70).begun_as(&held(100), &Start::Random), held(100));
    }

    #[test]
    fn dropout_rises_to_its_rate_with_another_seed_in_each_step() {
        let settings = TrainSettings { dropout: 0.2, iterations: 101, ..TrainSettings::default() };
        let rates = [0, 50, 100].map(|step| settings.dropout_at(step).rate);
        assert_eq!(rates, [0.0, 0.1, 0.2]);
        let other = TrainSettings { seed: 1, ..settings.clone() };
        let seeds = [settings.dropout_at(1), settings.dropout_at(2), other.dropout_at(1)].map(|dropout| dropout.seed);
        assert!(seeds[0] != seeds[1] && seeds[0] != seeds[2], "{seeds:?}");
        assert!(TrainSettings { dropout: 0.0, ..settings }.dropout_at(50).is_none());
    }

    #[test]
    fn lengths_are_in_units_of_the_extent() {
        let settings = TrainPreset::ThreeDgs.settings(None);
        let (first, last) = (settings.rates_at(0, 5.0), settings.rates_at(settings.iterations, 5.0));
        assert!((first.mean.learning_rate - 8e-4).abs() < 1e-9);
        assert!((last.mean.learning_rate - 8e-6).abs() < 1e-10);
        assert_eq!(first.scale.learning_rate, 0.005);
        assert_eq!(first.max_scale, 5.0 * settings.adam.max_scale);
    }

    #[test]
    fn white_thins_the_fog_at_the_first_round() {
        let once = |settings: &TrainSettings| settings.policy.actions().unwrap().reset.once_after;
        let usual = TrainSettings::default();
        assert_eq!(once(&usual.clone().on([0.0; 3])), 0);
        let white = usual.on([1.0; 3]);
        assert_eq!((once(&white), white.render.background_color()), (500, [1.0; 3]));
        assert_eq!(once(&white.clone().on([0.0, 1.0, 0.0])), 0);
        let quick = TrainPreset::Quick.settings(Some(2_000)).on([1.0; 3]);
        assert!(quick.rounds.progress(once(&quick), 2_000).is_some(), "{:?}", quick.rounds);
    }

    #[test]
    fn another_policy_prunes_and_resets_as_before() {
        for preset in TrainPreset::ALL {
            for name in Policy::NAMES {
                let policy = Policy::from_name(name).unwrap();
                let settings = preset.settings(None).with_policy(policy);
                assert_eq!(settings.validate().is_err(), ["residual", "image-gs"].contains(&name), "{name}");
                if let Some(actions) = settings.policy.actions().filter(|_| name != "mrnf") {
                    assert_eq!(actions.prune.larger_after, 3000, "{name}");
                    let expected = if preset == TrainPreset::Standard { 0 } else { 3000 };
                    assert_eq!(actions.reset.every, expected);
                }
            }
        }
        let mrnf = TrainPreset::ThreeDgs.settings(None).with_policy(Policy::from_name("mrnf").unwrap());
        assert_eq!(mrnf.policy.actions().unwrap().reset.every, 0);
        assert_eq!(mrnf.policy.actions().unwrap().prune.opacity, 1.0 / 255.0);
    }

    /// Growth until about step 15,000, as published, and rounds until 27,000 and 28,500.
    #[test]
    fn pruning_after_growth_goes_on_as_published() {
        let rounds = |preset: TrainPreset, iterations, name: &str| {
            preset.settings(iterations).with_policy(Policy::from_name(name).unwrap()).rounds
        };
        for (name, until) in [("absolute", 15_000), ("taming", 15_000), ("fastgs", 27_000), ("mrnf", 28_500)] {
            assert_eq!(rounds(TrainPreset::ThreeDgs, None, name), Rounds { every: 100, from: 500, until }, "{name}");
        }
        let fast = TrainPreset::ThreeDgs.settings(None).with_policy(Policy::from_name("fastgs").unwrap());
        let grows = |step| fast.policy.actions().unwrap().grows(fast.rounds.progress(step, 30_000).unwrap());
        assert_eq!([14_900, 15_300].map(grows), [true, false]);
        // A shorter run has the rounds of its preset.
        for (preset, iterations) in [(TrainPreset::Standard, 4_000), (TrainPreset::ThreeDgs, 7_000)] {
            let usual = preset.settings(Some(iterations));
            assert_eq!(rounds(preset, Some(iterations), "fastgs"), usual.rounds, "{preset}");
        }
    }

    #[test]
    fn invalid_settings_are_refused() {
        type Spoil = fn(&mut TrainSettings);
        let cases: [(&str, Spoil); 13] = [
            ("average-last", |s| s.average_last = f32::NAN),
            ("number of Gaussians", |s| s.gaussians = 0),
            ("fixed Gaussians", |s| s.fixed = s.gaussians),
            ("refine-poses", |s| (s.fixed, s.refine_poses) = (1, RefinePoses::Auto)),
            ("gaussians-per-point", |s| s.gaussians_per_point = f32::NAN),
            ("extent", |s| s.extent = Some(f32::NAN)),
            ("initial opacity", |s| s.init.opacity = 1.0),
            ("policy is `residual`", |s| s.policy = Policy::from_name("residual").unwrap()),
            ("resolution.from", |s| s.resolution = Resolution::CoarseToFine { from: 5, full_after: 0.5 }),
            ("dropout", |s| s.dropout = 0.95),
            ("render.dropout", |s| s.render.dropout.rate = 0.1),
            ("sh-degree", |s| s.render.effects.sh_degree = 4),
            ("learning rate of SH", |s| s.adam.color_rest.learning_rate = f32::NAN),
        ];
        for (expected, spoil) in cases {
            let mut settings = TrainSettings::default();
            spoil(&mut settings);
            let message = settings.validate().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        assert!(toml::from_str::<TrainSettings>("iteration = 7").is_err());
    }
}
