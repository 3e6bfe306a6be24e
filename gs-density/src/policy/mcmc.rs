//! 3DGS as Markov chain Monte Carlo: relocation and growth with opacity correction.

use gs_core::{
    EditPlan, Error,
    constants::PRUNE_OPACITY,
    edit::{Birth, Change, Moments, Origin, Place, PruneCause},
    logit, sigmoid,
};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::rule::{Rule, check_percent};
use crate::{
    noise::Noise,
    observation::{DensityGaussian, DensityPolicy, DensityScene, Needs, Observation, Rng},
    round::{Prune, check_newcomers, share_of},
};

gs_core::impl_with!(Mcmc);

/// The largest N for which eq. 9 is evaluated. *Source:* the code of 3DGS-MCMC, whose table of
/// binomials has 51 rows.
const MOST_PARTS: u32 = 50;

/// Relocates dead Gaussians to live ones and grows by a share per round, with corrections that keep
/// the image (*source:* 3DGS-MCMC, Kheradmand et al. 2024).
///
/// Gradients play no role: Gaussians are drawn in proportion to opacity, and [`Noise`] between the
/// steps explores. A Gaussian that becomes N of them gets, N times, the opacity 1 − (1 − o)^(1/N),
/// and scales shrunk so that the N, blended one behind the other, hide as much along a line through
/// the mean as the one did (its eq. 9). In a scene without opacities, where Gaussians are summed,
/// none is dead, all are drawn with equal chance, and colours are divided by N instead, which is
/// exact. But there the policy is of little use: the N have equal gradients and no noise, so they
/// stay equal.
///
/// Differences from the source: one draw serves relocation and growth; new Gaussians stand right
/// behind the one they come from, where the correction holds, instead of in the slots of the dead;
/// the share is rounded up, so that few Gaussians grow, too; and its losses on opacity and scale
/// are not part of a policy (see [`Penalty`](gs_core::Penalty)).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Mcmc {
    /// Largest opacity of dead Gaussians (unless all are dead). At least 0 and below 1, default
    /// [`PRUNE_OPACITY`].
    pub dead_opacity: f32,
    /// Share of the Gaussians by which their number grows in each round, rounded up. 0..=100 %,
    /// default 5.
    pub percent: f32,
    /// Moments of all N after a draw: fresh, the default, or zeroed, as in the source's code.
    pub newcomers: Moments,
    /// Noise between steps.
    pub noise: Noise,
}

impl Default for Mcmc {
    fn default() -> Self {
        Self { dead_opacity: PRUNE_OPACITY, percent: 5.0, newcomers: Moments::Fresh, noise: Noise::default() }
    }
}

impl Mcmc {
    /// Number of Gaussians wanted after a round with `len`.
    fn target(&self, len: usize, budget: usize) -> usize {
        (len + share_of(len, self.percent)).min(budget)
    }
}

impl Rule for Mcmc {
    fn validate(&self) -> Result<(), Error> {
        Error::within("dead-opacity", self.dead_opacity, 0.0..1.0, "0 or more, and below 1")?;
        check_percent(self.percent)?;
        check_newcomers(self.newcomers)?;
        self.noise.validate()
    }

    fn adapt_to_3d(&mut self) {
        self.newcomers = Moments::Zeroed;
    }
}

impl<S: DensityScene> DensityPolicy<S> for Mcmc {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        observation.check_lengths()?;
        let scene = observation.scene;
        // Prunes opacities up to and including `dead_opacity`.
        let prune = Prune { opacity: self.dead_opacity.next_up(), ..Prune::NOT_FINITE_ONLY };
        let mut removed = prune.removals(observation);
        if removed.len() == scene.len() {
            // No Gaussian is left to be copied, so those that can recover stay.
            removed.retain(|r| r.cause == PruneCause::NotFinite);
        }
        let mut dead = removed.iter().map(|r| r.index).peekable();
        let alive: Vec<u32> = (0..scene.len() as u32).filter(|&i| dead.next_if_eq(&i).is_none()).collect();
        let wanted = self.target(scene.len(), observation.budget).saturating_sub(alive.len());
        let mut plan = EditPlan { removed, ..EditPlan::default() };
        for (index, copies) in draw(scene, &alive, wanted, rng) {
            let part = part_of(scene.gaussian(index as usize), copies + 1, scene.has_opacity());
            plan.changed.push(Change { index, gaussian: part.clone(), moments: self.newcomers });
            plan.added.extend((0..copies).map(|_| Birth {
                gaussian: part.clone(),
                parent: Some(index),
                moments: self.newcomers,
                origin: Origin::Clone,
                place: Place::BehindParent,
            }));
        }
        Ok(plan)
    }

    fn needs(&self) -> Needs {
        Needs { noise: (self.noise.strength > 0.0).then_some(self.noise), ..Needs::default() }
    }
}

/// `count` draws from `alive` in proportion to opacity, as (Gaussian, how often), in order of the
/// Gaussians.
fn draw(scene: &impl DensityScene, alive: &[u32], count: usize, rng: &mut Rng) -> Vec<(u32, u32)> {
    let mut total = 0.0;
    let cumulative: Vec<f64> = (alive.iter())
        .map(|&i| {
            let opacity = if scene.has_opacity() { sigmoid(scene.opacity_logit(i as usize)) } else { 1.0 };
            total += f64::from(opacity);
            total
        })
        .collect();
    if !(total > 0.0) {
        return Vec::new();
    }
    let mut times = vec![0; alive.len()];
    for _ in 0..count {
        let at = rng.random_range(0.0..total);
        times[cumulative.partition_point(|&sum| sum <= at).min(alive.len() - 1)] += 1;
    }
    alive.iter().copied().zip(times).filter(|&(_, times)| times > 0).collect()
}

/// Returns one of the `parts` Gaussians that replace a Gaussian.
fn part_of<G: DensityGaussian>(mut gaussian: G, parts: u32, has_opacity: bool) -> G {
    if has_opacity {
        // More than the source's maximum are corrected as if they were that many.
        let (opacity, shrink) = correction(sigmoid(gaussian.opacity_logit()), parts.min(MOST_PARTS));
        gaussian.set_opacity_logit(logit(opacity));
        gaussian.resize(shrink.ln());
    } else {
        gaussian.map_color(|color| color / parts as f32);
    }
    gaussian
}

/// Eq. 9 of 3DGS-MCMC: the opacity of each of N that replace one of opacity o, and the factor of
/// their scales, o / Σ_{i=1}^N Σ_{k=0}^{i−1} C(i−1, k) (−1)^k o_new^{k+1} / √(k+1).
///
/// In `f64`, and with o short of 1: the terms alternate and grow as (1 + o_new)^N.
fn correction(opacity: f32, parts: u32) -> (f32, f32) {
    let o = f64::from(opacity.min(1.0 - f32::EPSILON));
    // 1 − (1 − o)^(1/N), without cancellation for small o.
    let new = -((-o).ln_1p() / f64::from(parts)).exp_m1();
    let mut sum = 0.0;
    for i in 0..parts {
        let mut term = new; // C(i, k) (−1)^k o_new^{k+1}
        for k in 0..=i {
            sum += term / f64::from(k + 1).sqrt();
            term *= -new * f64::from(i - k) / f64::from(k + 1);
        }
    }
    let shrink = o / sum;
    // The source clamps the opacity from below; a scale that came to nothing would be lost.
    (new as f32, if shrink.is_finite() && shrink > 0.0 { shrink as f32 } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_hide_along_a_line_what_the_whole_did() {
        for opacity in [0.005f32, 0.03, 0.2, 0.5, 0.9, 0.99, 0.9999, 1.0] {
            for parts in [1, 2, 3, 7, 20, MOST_PARTS] {
                let (new, shrink) = correction(opacity, parts);
                let (o, new, shrink) = (f64::from(opacity), f64::from(new), f64::from(shrink));
                let at_mean = 1.0 - (1.0 - new).powi(parts as i32);
                assert!((at_mean - o).abs() < 1e-5, "{opacity}, {parts}: {at_mean} at the mean");
                // ∫ 1 − (1 − o_new w)^N dx against ∫ o w dx = o √(2π), for σ = 1.
                let (steps, reach) = (40_000, 12.0);
                let width = 2.0 * reach / f64::from(steps);
                let hidden: f64 = (0..steps)
                    .map(|i| {
                        let x = (-reach + (f64::from(i) + 0.5) * width) / shrink;
                        (1.0 - (1.0 - new * (-0.5 * x * x).exp()).powi(parts as i32)) * width
                    })
                    .sum();
                let whole = o * std::f64::consts::TAU.sqrt();
                assert!((hidden / whole - 1.0).abs() < 1e-3, "{opacity}, {parts}: {hidden} instead of {whole}");
                assert!(shrink <= 1.0 + 1e-6 && shrink > 0.1, "{opacity}, {parts}: {shrink}");
            }
        }
    }
}
