#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! - [`DensityPolicy`] reads an [`Observation`] and returns an [`EditPlan`](gs_core::EditPlan),
//!   which a backend applies. A policy is a struct of thresholds without hidden state.
//! - [`Policy`] is any of the policies of this crate, for settings files and command lines.
//! - [`Grow`] chooses by rank and threshold from one of three statistics ([`Signal`]). Its
//!   [`Actions`] are those of all policies that choose: [`Densify`] clones and splits, [`Prune`]
//!   removes, [`OpacityReset`] resets. A budget is met exactly where enough Gaussians qualify.
//! - [`ResidualGrowth`] removes and seeds by residual, [`ErrorAddition`] (Image-GS) only adds. Both
//!   are for 2D scenes; all else works for any [`DensityScene`].
//! - [`Mcmc`] relocates and copies by opacity, with [`Noise`] between steps.
//! - [`FastGs`], [`Taming`], [`ImprovedGs`], [`SteepGs`] and [`Mrnf`] read [`Evidence`] over
//!   several training views, which training in 3D gathers in the rounds that request it.
//! - [`levels()`] merges the Gaussians of a finished 3D scene into levels of detail.
//! - [`CountSchedule`] holds any of them to a schedule that ends at exactly the budget.
//!
//! # A policy of your own
//!
//! A [`Round`] prunes, keeps the budget and edits; the policy only says which Gaussians grow. This
//! one picks Gaussians that move much and are large:
//!
//! ```
//! use gs_core::{EditPlan, Error, Gaussian2d, effects::Statistics};
//! use gs_density::{Actions, DensityPolicy, Needs, Observation, Rng, Round, WhenFlat};
//!
//! #[derive(Default)]
//! struct MovingMass {
//!     actions: Actions,
//! }
//!
//! impl DensityPolicy for MovingMass {
//!     fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<Gaussian2d>, Error> {
//!         let round = Round::open(&self.actions, observation)?;
//!         let area_px2 = |i: usize| observation.scene.log_scales[i].element_sum().exp();
//!         let score = |i: usize| observation.statistics.mean_signal(i) * area_px2(i);
//!         let ranking = round.rank_by(score, WhenFlat::Nothing);
//!         Ok(round.grow(ranking.top_percent(20.0), rng))
//!     }
//!
//!     fn needs(&self) -> Needs {
//!         Needs { statistics: Statistics::MeanGradient, ..Needs::default() }
//!     }
//! }
//!
//! # use glam::{Vec2, Vec3};
//! # use gs_core::{DensityStatistics, Scene2d};
//! # let gaussian = Gaussian2d {
//! #     mean: Vec2::splat(16.0),
//! #     log_scale: Vec2::ONE,
//! #     rotation: 0.0,
//! #     opacity_logit: f32::INFINITY,
//! #     color: Vec3::ONE,
//! # };
//! # let scene: Scene2d = [gaussian; 10].into_iter().collect();
//! # let statistics = DensityStatistics { signal_sum: vec![1e-3; 10], visible: vec![100; 10] };
//! // What the training loop does, every few hundred steps:
//! let observation = Observation {
//!     scene: &scene,           // 10 Gaussians
//!     statistics: &statistics, // [10]
//!     residual: None,
//!     evidence: None,
//!     extent: 32.0,
//!     step: 99,
//!     progress: 0.1,
//!     progress_before: 0.0,
//!     budget: 100,
//! };
//! let plan = MovingMass::default().plan(&observation, &mut Rng::new(0, 0))?;
//! assert_eq!(plan.len_after(10), 12);
//! # Ok::<(), Error>(())
//! ```

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod count_schedule;
mod eigen;
mod levels;
mod merge;
mod noise;
mod observation;
mod policy;
mod round;
pub mod seed;

pub use self::{
    count_schedule::CountSchedule,
    levels::{Level, halves, levels, spatial_order},
    merge::merged,
    noise::Noise,
    observation::{
        DensityGaussian, DensityPolicy, DensityScene, Evidence, EvidenceRequest, Needs, Observation, PixelSums,
        Residual, Rng, Signal, ViewEvidence,
    },
    policy::{
        Combine, ErrorAddition, FORCED_GROWTH_PERCENT, FastGs, Grow, ImprovedGs, Mcmc, Mrnf, Policy, ResidualGrowth,
        ScoreWeights, SteepGs, Taming,
    },
    round::{
        Actions, Densify, LongAxisSplit, OpacityCorrection, OpacityReset, Prune, Ranking, Round, SizeThreshold,
        SplitPlacement, WhenFlat, share_of,
    },
};
