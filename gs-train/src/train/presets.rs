//! Presets of training in 3D: runs of minutes, a quick look, and the published 3DGS and 3DGS-MCMC.

use gs_core::{
    Adam, Blend, Camera, Loss, Penalty, RenderSettings,
    adam::{Group, MomentFormat, Schedule},
    constants::OPACITY_RESET_EVERY,
    edit::Moments,
    effects::{Antialias, Order},
};
use gs_density::{Actions, Densify, Grow, Mcmc, Policy, Prune, Signal, SizeThreshold};
use gs_io::dataset::DatasetKind;

use super::{exposure::Exposure, poses::RefinePoses, settings::TrainSettings};
use crate::run::{Recovery, Rounds};
use crate::{start::PointInit, views::Resolution};

gs_core::choices! {
    /// A preset of a 3D training: settings by name.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum TrainPreset {
        /// Runs of minutes, 2,000 to 8,000 steps: 3DGS with growth by rank of AbsGS's gradients, longer
        /// steps, learning rates that decay within the run, half the resolution at first, points found
        /// in the images where the data set has few, no opacity resets, no density control in the last
        /// third, the mean of the last scenes as the result, and moments of SH above degree 0 in 16
        /// bits.
        Standard = "standard": "For runs of minutes",
        /// A first look in 2,000 steps, at half resolution first, with the same moments.
        Quick = "quick": "For a first look",
        /// The settings of 3DGS (Kerbl et al. 2023), 30,000 steps, for comparison with other work. Two
        /// numbers differ from the code of 3DGS: α is at most 0.999 instead of 0.99, as in gsplat, and
        /// Gaussians reach as far as α is above the cut instead of three standard deviations.
        /// [`Accuracy::THREE_DGS`](gs_core::Accuracy::THREE_DGS) as `render.accuracy` has 0.99.
        #[default]
        ThreeDgs = "3dgs": "3D Gaussian Splatting as published",
        /// The settings of 3DGS-MCMC (Kheradmand et al. 2024), 30,000 steps, for a fixed number of
        /// Gaussians.
        Mcmc = "mcmc": "3DGS-MCMC: a fixed number of Gaussians, moved to where they are needed",
    }
}

/// Steps of the published runs.
const ITERATIONS: u32 = 30_000;

/// Steps of a run of minutes whose views are not known.
const STANDARD_ITERATIONS: u32 = 4_000;

/// Steps of a run of minutes for each view, and their bounds. Few views are soon known by heart:
/// more steps then fit them better, and views between them worse.
const STEPS_PER_VIEW: usize = 40;
const STANDARD_STEPS: [usize; 2] = [2_000, 8_000];

/// Steps of a run of minutes with few views, if a trial shows that a longer run gains.
const LENGTHENED: u32 = 4_000;

/// Pixels of training views for each Gaussian of a run of minutes: 480 values for 59 numbers. With
/// more Gaussians, scenes fit few views ever better, and views between them worse.
const PIXELS_PER_GAUSSIAN: u64 = 160;

/// Gaussians of a run of minutes for each initial point, where that is more than one for 160 pixels.
/// Many points are found in images that agree well, and such images need more Gaussians.
const GAUSSIANS_PER_POINT: f32 = 5.0;

/// A run of minutes also searches the images for points if a data set has fewer points than this
/// share of the largest number of Gaussians.
const FEW_POINTS: f32 = 0.25;

/// Share of a run of minutes whose scenes are averaged: most of the steps after density control.
const AVERAGE_LAST: f32 = 0.3;

/// Bounds of the number of Gaussians that follows from the pixels.
const STANDARD_GAUSSIANS: [u64; 2] = [20_000, 1_000_000];

/// Least number of steps for the published schedules; a shorter run would not recover from its
/// first reset of opacities.
const SHORTEST_AS_PUBLISHED: u32 = OPACITY_RESET_EVERY + 500;

/// Steps of a quick look.
const QUICK_ITERATIONS: u32 = 2_000;

impl TrainPreset {
    /// The settings for a run of `iterations` steps, by default the preset's own number.
    ///
    /// The published presets keep their schedules: density control from step 500 to 15,000 (MCMC:
    /// 25,000), and decay of the means' learning rate over 30,000 steps. A run of 7,000 steps is
    /// the beginning of one of 30,000, as in the code of 3DGS. Only runs of less than 3,500 steps
    /// scale the schedules to their length, as the other presets always do.
    pub fn settings(self, iterations: Option<u32>) -> TrainSettings {
        match self {
            Self::ThreeDgs => three_dgs(iterations.unwrap_or(ITERATIONS)),
            Self::Mcmc => mcmc(iterations.unwrap_or(ITERATIONS)),
            Self::Standard => standard(iterations.unwrap_or(STANDARD_ITERATIONS)),
            Self::Quick => quick(iterations.unwrap_or(QUICK_ITERATIONS)),
        }
    }
}

impl TrainPreset {
    /// [`Self::settings`] for training with the views of these cameras, from a data set of this
    /// kind, on the usual background of the kind.
    ///
    /// The views determine the steps and the largest number of Gaussians of [`Self::Standard`]: 40
    /// steps a view, 2,000 to 8,000 in all, and a Gaussian for 160 pixels, 20,000 to 1,000,000 in
    /// all. Where `iterations` is `None` and that is less than 4,000 steps, a trial before the run
    /// decides whether it has 4,000 and twice the Gaussians, and whether more Gaussians harm
    /// ([`TrainSettings::lengthen_to`]). Its [`gaussians_per_point`](TrainSettings::gaussians_per_point) may raise that number.
    ///
    /// [`Self::Standard`] and [`Self::Quick`] use [`Antialias::Mip`] for Blender's data sets. A pixel
    /// of a rendered image is about the mean over its square, whose variance of 1/12 px² is close
    /// to the 0.1 px² of `Mip`. Photographs are also blurred by the lens.
    pub fn settings_for<'a>(
        self,
        iterations: Option<u32>,
        kind: DatasetKind,
        cameras: impl IntoIterator<Item = &'a Camera>,
    ) -> TrainSettings {
        let mut settings = match self {
            Self::Standard => standard_for(iterations, cameras),
            _ => self.settings(iterations),
        };
        if kind == DatasetKind::Blender && matches!(self, Self::Standard | Self::Quick) {
            settings.render.effects.antialias = Antialias::Mip;
        }
        settings.on(kind.background())
    }
}

/// [`TrainPreset::Standard`] for the views of these cameras.
fn standard_for<'a>(iterations: Option<u32>, cameras: impl IntoIterator<Item = &'a Camera>) -> TrainSettings {
    let pixels: Vec<u64> =
        cameras.into_iter().map(|camera| u64::from(camera.width) * u64::from(camera.height)).collect();
    let [shortest, longest] = STANDARD_STEPS;
    let steps = (pixels.len() * STEPS_PER_VIEW).clamp(shortest, longest) as u32;
    let [least, most] = STANDARD_GAUSSIANS;
    let gaussians = (pixels.iter().sum::<u64>() / PIXELS_PER_GAUSSIAN).clamp(least, most) as u32;
    let undecided = iterations.is_none() && steps < LENGTHENED;
    let usual = standard(iterations.unwrap_or(steps));
    TrainSettings {
        gaussians,
        lengthen_to: if undecided { LENGTHENED } else { 0 },
        decide_gaussians: undecided,
        ..usual
    }
}

impl Default for TrainSettings {
    /// The settings of [`TrainPreset::ThreeDgs`].
    fn default() -> Self {
        TrainPreset::default().settings(None)
    }
}

fn three_dgs(iterations: u32) -> TrainSettings {
    let prune = Prune::default().with(|s| {
        s.larger_than = Some(SizeThreshold::ExtentFraction(0.1));
        s.larger_after = OPACITY_RESET_EVERY;
    });
    let densify = Densify::default().with(|s| s.newcomers = Moments::Zeroed);
    let actions = Actions::default().with(|s| {
        s.densify = densify;
        s.prune = prune;
    });
    let position = Group::constant(1.6e-4).with(|s| s.schedule = Schedule::Exponential { to: 0.01 });
    let mut render = RenderSettings::blended(Blend::Over).on([0.0; 3]);
    render.effects.order = Order::Global;
    render.effects.antialias = Antialias::Dilate;
    render.effects.sh_degree = 3;
    TrainSettings {
        gaussians: 2_000_000,
        gaussians_per_point: 0.0,
        fixed: 0,
        exactly: false,
        iterations,
        lengthen_to: 0,
        decide_gaussians: false,
        decay_over: if iterations < SHORTEST_AS_PUBLISHED { 0 } else { ITERATIONS },
        seed: 0,
        extent: None,
        render,
        recovery: Recovery::BeginAgain,
        sh_degree_every: (iterations / 7).clamp(1, 1_000),
        loss: Loss::PAPER,
        adam: Adam::default().with(|s| {
            s.mean = position;
            s.scale = Group::constant(5e-3);
            s.rotation = Group::constant(1e-3);
            s.opacity = Group::constant(5e-2);
            s.color = Group::constant(2.5e-3);
            s.color_rest = Group::constant(2.5e-3 / 20.0);
            s.epsilon = 1e-15;
            s.min_scale = 1e-7;
            s.max_scale = 1e3;
        }),
        init: PointInit { far_points: Some(false), ..PointInit::default() },
        dropout: 0.0,
        average_last: 0.0,
        policy: Policy::Grow(Grow::absolute(Signal::MeanGradient).with_actions(actions)),
        rounds: published_rounds(iterations, 0.5),
        remove_unseen: false,
        resolution: Resolution::Full,
        exposure: Exposure::Off,
        refine_poses: RefinePoses::Off,
    }
}

/// Rounds every 100 steps from 500 until this share of the published run.
fn published_rounds(iterations: u32, until_share: f64) -> Rounds {
    let length = if iterations < SHORTEST_AS_PUBLISHED { iterations } else { ITERATIONS };
    rounds(length, 500, until_share)
}

/// Rounds every 100 steps from `from` until this share of the run; closer together in runs of less
/// than 3,000 steps.
fn rounds(iterations: u32, from: u32, until_share: f64) -> Rounds {
    let every = (iterations / 30).clamp(1, 100);
    let until = (f64::from(iterations) * until_share) as u32;
    let from = from.min(iterations / 15).max(every);
    Rounds { every, from, until: until.max(from) }
}

fn mcmc(iterations: u32) -> TrainSettings {
    let usual = three_dgs(iterations);
    TrainSettings {
        adam: usual.adam.with(|s| s.penalty = Penalty { opacity: 0.01, scale: 0.01 }),
        gaussians: 1_000_000,
        init: PointInit { opacity: 0.5, scale: 0.1, ..usual.init },
        policy: Policy::Mcmc(Mcmc::default()).for_3d(),
        rounds: published_rounds(iterations, 5.0 / 6.0),
        ..usual
    }
}

/// The settings with learning rates of means, and of scale and rotation, multiplied by these
/// factors, and with moments of SH above degree 0 in 16 bits.
fn faster(adam: Adam, mean: f32, shape: f32) -> Adam {
    let times = |group: Group, factor: f32| group.with(|s| s.learning_rate = factor * group.learning_rate);
    adam.with(|s| {
        s.mean = times(adam.mean, mean);
        s.scale = times(adam.scale, shape);
        s.rotation = times(adam.rotation, shape);
        s.color_rest_moments = MomentFormat::Bf16;
    })
}

fn standard(iterations: u32) -> TrainSettings {
    let usual = three_dgs(iterations);
    let mut policy = Grow::percentile(Signal::AbsoluteGradient);
    policy.actions.densify.split_above = Grow::abs_gs().actions.densify.split_above;
    if let Some(actions) = usual.policy.actions() {
        policy.actions.densify.newcomers = actions.densify.newcomers;
        policy.actions.prune = actions.prune;
        // A run of minutes has no time to recover from a reset of opacities.
        policy.actions.reset.every = 0;
    }
    TrainSettings {
        gaussians: 200_000,
        gaussians_per_point: GAUSSIANS_PER_POINT,
        decay_over: 0,
        adam: faster(usual.adam, 3.0, 2.5),
        policy: Policy::Grow(policy),
        rounds: rounds(iterations, 500, 0.67),
        average_last: AVERAGE_LAST,
        remove_unseen: true,
        init: PointInit { search_below: FEW_POINTS, ..PointInit::default() },
        resolution: Resolution::from_coarse(2),
        exposure: Exposure::Auto,
        ..usual
    }
}

fn quick(iterations: u32) -> TrainSettings {
    let usual = three_dgs(iterations);
    let Policy::Grow(Grow { actions, .. }) = usual.policy else { return usual };
    TrainSettings {
        gaussians: 200_000,
        decay_over: 0,
        adam: faster(usual.adam, 4.0, 4.0),
        policy: Policy::Grow(Grow::percentile(Signal::MeanGradient).with_actions(actions)),
        rounds: rounds(iterations, 200, 0.6),
        remove_unseen: true,
        init: PointInit { random: 20_000, ..PointInit::default() },
        resolution: Resolution::CoarseToFine { from: 2, full_after: 0.4 },
        ..usual
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shorter_run_is_the_beginning_of_the_published_one() {
        let settings = TrainPreset::ThreeDgs.settings(None);
        assert_eq!(settings.rounds, Rounds { every: 100, from: 500, until: 15_000 });
        assert_eq!((settings.iterations, settings.sh_degree_every), (30_000, 1_000));
        let shorter = TrainPreset::ThreeDgs.settings(Some(7_000));
        assert_eq!(shorter, TrainSettings { iterations: 7_000, ..settings.clone() });
        assert_eq!(shorter.rates_at(7_000, 1.0), settings.rates_at(7_000, 1.0));
        let mcmc = TrainPreset::Mcmc.settings(None);
        assert_eq!(mcmc.rounds, Rounds { every: 100, from: 500, until: 25_000 });
    }

    #[test]
    fn steps_and_gaussians_of_minutes_follow_the_views() {
        let settings = |views: usize, width: u32, height: u32, steps: Option<u32>| {
            let camera = Camera::looking_forward(width, height, 1.0);
            let settings = TrainPreset::Standard.settings_for(steps, DatasetKind::Colmap, &vec![camera; views]);
            settings.validate().unwrap();
            (settings.iterations, settings.gaussians)
        };
        let undecided = |views: usize, steps: Option<u32>| {
            let cameras = vec![Camera::looking_forward(80, 60, 1.0); views];
            let settings = TrainPreset::Standard.settings_for(steps, DatasetKind::Colmap, &cameras);
            (settings.lengthen_to, settings.decide_gaussians)
        };
        assert_eq!(undecided(99, None), (4_000, true));
        assert_eq!([undecided(99, Some(300)), undecided(100, None)], [(0, false); 2]);
        assert_eq!(settings(100, 400, 400, None), (4_000, 100_000));
        assert_eq!(settings(12, 800, 532, None), (2_000, 31_920));
        assert_eq!(settings(1_000, 1_600, 1_200, None), (8_000, 1_000_000));
        assert_eq!(settings(12, 80, 60, Some(300)), (300, 20_000));
        let cameras = [Camera::looking_forward(400, 400, 1.0)];
        for preset in [TrainPreset::Quick, TrainPreset::ThreeDgs, TrainPreset::Mcmc] {
            assert_eq!(preset.settings_for(Some(50), DatasetKind::Colmap, &cameras), preset.settings(Some(50)));
        }
    }

    #[test]
    fn rendered_images_have_the_pixels_of_mip_except_as_published() {
        for preset in TrainPreset::ALL {
            let render = |kind: DatasetKind| preset.settings_for(None, kind, &[]).render;
            let [photographs, rendered] = [DatasetKind::Nerfstudio, DatasetKind::Blender].map(render);
            let published = matches!(preset, TrainPreset::ThreeDgs | TrainPreset::Mcmc);
            assert_eq!(photographs.effects.antialias, Antialias::Dilate, "{preset}");
            assert_eq!(rendered.effects.antialias == Antialias::Dilate, published, "{preset}");
            assert_eq!((photographs.background, rendered.background), ([0.0; 3], [1.0; 3]), "{preset}");
        }
    }

    #[test]
    fn standard_alone_searches_the_images_where_points_are_few() {
        let shares = TrainPreset::ALL.map(|preset| (preset, preset.settings(None).init.search_below));
        for (preset, share) in shares {
            assert_eq!(share, if preset == TrainPreset::Standard { FEW_POINTS } else { 0.0 }, "{preset}");
        }
    }

    #[test]
    fn resets_fall_on_rounds() {
        for iterations in [3_000, 7_000, 12_345, 30_000] {
            let rounds = TrainPreset::ThreeDgs.settings(Some(iterations)).rounds;
            assert!(OPACITY_RESET_EVERY.is_multiple_of(rounds.every), "{iterations}: {rounds:?}");
        }
    }
}
