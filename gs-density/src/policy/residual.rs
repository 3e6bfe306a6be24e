//! Growth by residual: replaces the least important Gaussians by new ones where the image is most
//! wrong.

use glam::Vec3;
use gs_core::{
    EditPlan, Error, Gaussian2d, Scene, Scene2d, check_len,
    edit::{AfterEdit, Birth, PruneCause, Removal},
    logit, sigmoid,
};
use serde::{Deserialize, Serialize};

use super::rule::Rule;
use crate::{
    observation::{DensityPolicy, Needs, Observation, Residual, Rng},
    round::Prune,
    seed::{Plane, Seeding, mean_around},
};

gs_core::impl_with!(ResidualGrowth);

/// Prunes the least important Gaussians and seeds as many, or more, where the residual is large.
///
/// The number of Gaussians rises linearly from `start_fraction` of the budget to all of it over the
/// first `growth_fraction` of the rounds. These rounds also replace some Gaussians; later rounds
/// only replace. The budget is met exactly. A scene with more Gaussians than the line never
/// shrinks, except to the budget. Where the residual is 0 everywhere, seeds are spread evenly.
///
/// Importance is |c|²·det L, the energy that a Gaussian adds to the image, in scenes without
/// opacities ([`Blend::Sum`]). With opacities ([`Blend::Over`]) it is o²·det L·(|c − ½|² + ¼), the
/// expected change in energy before any background colour. Where pixels have weights,
/// importance is multiplied by the weight of the pixel at the mean, and each squared residual by the
/// weight of its pixel.
///
/// New Gaussians stand first in the scene: under `Over` that is in front of all others, where they
/// are visible.
///
/// [`Blend::Sum`]: gs_core::Blend::Sum
/// [`Blend::Over`]: gs_core::Blend::Over
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct ResidualGrowth {
    /// Exponent of the density of seeds, |r|^exponent, where r is the residual's three channels
    /// together; 0.5..=8. Smaller values favour MS-SSIM, larger ones PSNR, up to 3.5 (at 9,000
    /// Gaussians 2.5 and 3.5 differ by 0.1 dB and 0.001).
    pub exponent: f32,
    /// Passes of the (1, 2, 1)/4 kernel over |r|^exponent, at most 64: σ = √(passes/2) px.
    pub smoothing_passes: u32,
    /// Share of the budget from which the number grows, 0..=1: the share that the scene was
    /// initialised with.
    pub start_fraction: f32,
    /// Share of the rounds in which the number grows, 0..=1. Late growth sees where the residual
    /// stays; the last rounds should only replace.
    pub growth_fraction: f32,
    /// Share of the Gaussians that a growing round replaces, 0..=1.
    pub prune_growing: f32,
    /// Share of the Gaussians that a later round replaces, 0..=1.
    pub prune_relocating: f32,
    /// Largest average number of seeds per pixel in a round; positive.
    pub max_per_pixel: f32,
    /// σ of a seed in units of the distance between the seeds of a round: σ = `sigma_factor` /
    /// √density. Positive.
    pub sigma_factor: f32,
    /// Smallest σ of a seed, px; positive.
    pub min_sigma_px: f32,
    /// Largest σ of a seed, px; not below the smallest.
    pub max_sigma_px: f32,
    /// Largest ratio of axes of a seed on an edge, at least 1.
    pub max_aspect: f32,
    /// Share of the residual around a seed that becomes its colour in scenes without opacities.
    /// With opacities a seed has the target's colour.
    pub color_share: f32,
    /// Opacity of a seed where there are opacities, above 0 and below 1.
    pub opacity: f32,
}

impl Default for ResidualGrowth {
    fn default() -> Self {
        Self {
            exponent: 3.0,
            smoothing_passes: 1,
            start_fraction: 0.08,
            growth_fraction: 0.5,
            prune_growing: 0.2,
            prune_relocating: 0.1,
            max_per_pixel: 0.3,
            sigma_factor: 0.12,
            min_sigma_px: 0.7,
            max_sigma_px: 12.0,
            max_aspect: 6.0,
            color_share: 0.5,
            opacity: 0.7,
        }
    }
}

impl Rule for ResidualGrowth {
    fn validate(&self) -> Result<(), Error> {
        let positive =
            |what, value: f32| Error::within(what, value, f32::MIN_POSITIVE..=f32::MAX, "positive and finite");
        for (what, share) in [
            ("start-fraction", self.start_fraction),
            ("growth-fraction", self.growth_fraction),
            ("prune-growing", self.prune_growing),
            ("prune-relocating", self.prune_relocating),
        ] {
            Error::within(what, share, 0.0..=1.0, "0 to 1")?;
        }
        Error::within("exponent", self.exponent, 0.5..=8.0, "0.5 to 8")?;
        Error::within("smoothing-passes", self.smoothing_passes, ..=64, "0 to 64")?;
        positive("max-per-pixel", self.max_per_pixel)?;
        positive("sigma-factor", self.sigma_factor)?;
        positive("min-sigma-px", self.min_sigma_px)?;
        Error::within(
            "max-sigma-px",
            self.max_sigma_px,
            self.min_sigma_px..=f32::MAX,
            "finite, at least min-sigma-px",
        )?;
        Error::within("max-aspect", self.max_aspect, 1.0..=f32::MAX, "finite and at least 1")?;
        Error::within("color-share", self.color_share, f32::MIN..=f32::MAX, "finite")?;
        Error::within("opacity", self.opacity, f32::MIN_POSITIVE..1.0, "above 0 and below 1")
    }
}

impl DensityPolicy for ResidualGrowth {
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<Gaussian2d>, Error> {
        self.validate()?;
        let scene = observation.scene;
        check_len("density statistics", scene.len(), observation.statistics.signal_sum.len())?;
        let Some(residual) = observation.residual else {
            return Err(Error::State("policy `residual` needs a residual".into()));
        };
        residual.check()?;

        let broken = Prune::NOT_FINITE_ONLY.removals(observation);
        let (removed, added) = self.census(observation, broken.len());
        let added = self.seeds(residual, scene.has_opacity(), added, rng);
        Ok(EditPlan {
            removed: least_important(scene, residual, &broken, removed),
            added: added.into_iter().map(Birth::seed).collect(),
            statistics: AfterEdit::Restart,
            ..EditPlan::default()
        })
    }

    fn needs(&self) -> Needs {
        Needs { residual: true, ..Needs::default() }
    }
}

impl ResidualGrowth {
    /// Numbers of Gaussians that a round removes and adds.
    fn census(&self, observation: &Observation<'_>, not_finite: usize) -> (usize, usize) {
        let (len, budget) = (observation.scene.len(), observation.budget);
        let grown = observation.progress / self.growth_fraction; // NaN for 0/0: all has grown
        let grown = if grown < 1.0 { f64::from(grown.max(0.0)) } else { 1.0 };
        let start = f64::from(self.start_fraction);
        let line = (budget as f64 * (start + (1.0 - start) * grown)).round() as usize;
        let count = line.max(len).min(budget);
        let share = if count > len { self.prune_growing } else { self.prune_relocating };
        let replaced = (f64::from(share) * len as f64).round() as usize;
        let removed = replaced.max(not_finite).max(len.saturating_sub(budget)).min(len);
        (removed, count - (len - removed))
    }

    /// `count` new Gaussians.
    fn seeds(&self, residual: &Residual, has_opacity: bool, count: usize, rng: &mut Rng) -> Vec<Gaussian2d> {
        if count == 0 {
            return Vec::new();
        }
        let Residual { target, rendered, .. } = residual;
        let (width, height) = target.size();
        let mut wanted = self.wanted(residual);
        wanted.smooth(self.smoothing_passes);
        let seeding = Seeding {
            max_per_pixel: self.max_per_pixel,
            lloyd_steps: 0,
            sigma_factor: self.sigma_factor,
            sigma_range_px: [self.min_sigma_px, self.max_sigma_px],
            max_aspect: self.max_aspect,
            opacity_logit: if has_opacity { logit(self.opacity) } else { f32::INFINITY },
        };
        let of_target = |pixel: usize| Vec3::from_array(target.pixels()[pixel]);
        let missing = |pixel: usize| {
            let r = (of_target(pixel) - Vec3::from_array(rendered.pixels()[pixel])) * self.color_share;
            if r.is_finite() { r } else { Vec3::ZERO }
        };
        seeding.gaussians(target, wanted, count, rng, |mean, sigma, _| {
            if has_opacity {
                mean_around((width, height), mean, sigma, of_target)
            } else {
                mean_around((width, height), mean, sigma, missing)
            }
        })
    }

    /// (√w |r|)^exponent of every pixel, w being its weight.
    fn wanted(&self, residual: &Residual) -> Plane {
        let Residual { target, rendered, .. } = residual;
        let (width, height) = target.size();
        let power = Power::of_square_root(self.exponent);
        Plane::from_rows(width, height, |y, row| {
            let pixels = y * width as usize..(y + 1) * width as usize;
            let (target, rendered) = (&target.pixels()[pixels.clone()], &rendered.pixels()[pixels]);
            for ((out, t), c) in row.chunks_mut(SPAN).zip(target.chunks(SPAN)).zip(rendered.chunks(SPAN)) {
                // Channels are squared as one long array and then added up: the first loop
                // vectorises, a loop over pixels does not.
                let mut squares = [0.0f32; 3 * SPAN];
                for ((square, t), c) in squares.iter_mut().zip(t.as_flattened()).zip(c.as_flattened()) {
                    *square = (t - c) * (t - c);
                }
                for (out, square) in out.iter_mut().zip(squares.as_chunks::<3>().0) {
                    *out = square[0] + square[1] + square[2];
                }
            }
            for (square, weight) in row.iter_mut().zip(residual.row_of_weights(y).into_iter().flatten()) {
                *square *= weight;
            }
            power.apply(row);
        })
    }
}

/// Pixels whose residuals are squared together.
const SPAN: usize = 64;

/// x ↦ x^(exponent/2), for x = |r|².
#[derive(Debug, Clone, Copy)]
enum Power {
    /// (x^¼)^n by squaring: exact enough, and twenty times faster than `powf`.
    Quarters(u32),
    /// Any other exponent.
    Real(f32),
}

impl Power {
    fn of_square_root(exponent: f32) -> Self {
        let quarters = 2.0 * exponent;
        if quarters.fract() == 0.0 { Self::Quarters(quarters as u32) } else { Self::Real(0.5 * exponent) }
    }

    fn apply(self, values: &mut [f32]) {
        match self {
            Self::Quarters(4) => {}
            Self::Quarters(7) => values.iter_mut().for_each(|v| *v = *v * v.sqrt() * v.sqrt().sqrt()),
            Self::Quarters(n) => values.iter_mut().for_each(|v| *v = v.sqrt().sqrt().powi(n as i32)),
            Self::Real(e) => values.iter_mut().for_each(|v| *v = v.powf(e)),
        }
    }
}

/// The `count` Gaussians to remove, by index: first the broken ones, which are not finite, then the
/// least important; among equals the first.
fn least_important(scene: &Scene2d, residual: &Residual, broken: &[Removal], count: usize) -> Vec<Removal> {
    // Importance and index in one number: the bits of a positive `f32` are ordered as its values.
    let mut keys: Vec<u64> = (0..scene.len())
        .map(|i| {
            let importance = importance(scene, i) * residual.weight_at(scene.means[i]);
            u64::from(importance.max(f32::MIN_POSITIVE).to_bits()) << 32 | i as u64
        })
        .collect();
    for removal in broken {
        keys[removal.index as usize] = removal.index.into();
    }
    if count < keys.len() {
        keys.select_nth_unstable(count);
        keys.truncate(count);
    }
    let mut removed: Vec<Removal> = keys
        .into_iter()
        .map(|key| {
            let cause = if key >> 32 == 0 { PruneCause::NotFinite } else { PruneCause::Unimportant };
            Removal { index: key as u32, cause }
        })
        .collect();
    removed.sort_unstable_by_key(|r| r.index);
    removed
}

/// The importance described at [`ResidualGrowth`]; may be NaN or infinite where parameters are not
/// finite or huge.
fn importance(scene: &Scene2d, index: usize) -> f32 {
    let determinant = scene.log_scales[index].element_sum().exp();
    let color = scene.colors[index];
    if scene.has_opacity() {
        let opacity = sigmoid(scene.opacity_logits[index]);
        opacity * opacity * determinant * ((color - Vec3::splat(0.5)).length_squared() + 0.25)
    } else {
        color.length_squared() * determinant
    }
}

#[cfg(test)]
mod tests;
