//! Density control: which Gaussians grow, which are pruned, and what is done to them.
//!
//! A policy ([`DensityPolicy`]) is a struct of thresholds without hidden state: it looks at an [`Observation`] and returns an
//! [`EditPlan`](gs_core::EditPlan), which a backend applies. It knows no rasterizer.
//!
//! - Who grows, by rank and threshold: [`Grow`], measured by one of three statistics ([`Signal`]).
//! - What is done then, the same for all of them ([`Actions`]): [`Densify`] clones and splits, [`Prune`] removes, [`OpacityReset`]
//!   resets. The budget is met exactly where enough Gaussians qualify; those that call for growth the most go first.
//! - Growth without parents: [`ResidualGrowth`] prunes and seeds where the residual is large, [`ErrorAddition`] (Image-GS) only adds.
//! - Growth without scores: [`Mcmc`] relocates and copies by opacity, with [`Noise`] between steps.
//! - [`Policy`] is any of them, for settings files and command lines.
//!
//! All of it is for scenes in 2D and in 3D alike ([`DensityScene`]), but for growth without parents, which is of the plane.
//!
//! # A policy of your own
//!
//! A [`Round`] prunes, keeps the budget and edits; who grows is all that is left to say. Here it is the Gaussians that move much and
//! are large, as they have most to win:
//!
//! ```
//! use gs_core::{EditPlan, Error, Gaussian2d, effects::Statistics};
//! use gs_density::{Actions, DensityPolicy, Observation, Rng, Round, WhenFlat};
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
//!         let score = |i: usize| observation.statistics.mean_gradient(i) * area_px2(i);
//!         let ranking = round.rank_by(score, WhenFlat::Nothing);
//!         Ok(round.grow(ranking.top_percent(20.0), rng))
//!     }
//!
//!     fn statistics(&self) -> Statistics {
//!         Statistics::MeanGradient
//!     }
//!
//!     fn needs_residual(&self) -> bool {
//!         false
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
//! # let statistics = DensityStatistics { gradient_sum: vec![1e-3; 10], visible: vec![100; 10] };
//! // What the training loop does, every few hundred steps:
//! let observation = Observation {
//!     scene: &scene,           // 10 Gaussians
//!     statistics: &statistics, // [10]
//!     residual: None,
//!     extent: 32.0,
//!     step: 99,
//!     progress: 0.1,
//!     budget: 100,
//! };
//! let plan = MovingMass::default().plan(&observation, &mut Rng::new(0, 0))?;
//! assert_eq!(plan.len_after(10), 12);
//! # Ok::<(), Error>(())
//! ```

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod correction;
mod densify;
mod error_addition;
mod gaussian;
mod grow;
mod mcmc;
mod noise;
mod observation;
mod policy;
mod prune;
mod ranking;
mod reset;
mod residual;
mod round;
pub mod seed;
mod signal;
mod size;

pub use correction::OpacityCorrection;
pub use densify::{ClonePlacement, Densify, LongAxisSplit, MomentHeir, SplitPlacement};
pub use error_addition::ErrorAddition;
pub use gaussian::{DensityGaussian, DensityScene};
pub use grow::{Combine, FORCED_GROWTH_PERCENT, Grow, share_of};
pub use mcmc::Mcmc;
pub use noise::Noise;
pub use observation::{DensityPolicy, Observation, Residual, Rng};
pub use policy::Policy;
pub use prune::Prune;
pub use ranking::{Ranking, WhenFlat};
pub use reset::OpacityReset;
pub use residual::ResidualGrowth;
pub use round::{Actions, Round};
pub use signal::Signal;
pub use size::SizeThreshold;
