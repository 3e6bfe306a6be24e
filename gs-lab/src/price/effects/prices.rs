//! The cost of each effect, and what changes without it.

use gs_backend::FutureExt as _;
use std::time::Instant;

use gs_core::{Effects, Error, Rasterizer, RenderSettings, Scene, effects::Effect, profile::Quantiles};
use serde::Serialize;

use super::{Difference, UploadedScene};

/// The cost of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Price {
    /// The effect.
    pub effect: Effect,
    /// The effect's value in the wanted settings.
    pub value: &'static str,
    /// The next cheaper value, which it is compared with.
    pub cheaper: &'static str,
    /// The extra time of a picture, ms: the median over rounds of the difference within a round.
    pub milliseconds: f64,
    /// The extra time as a share of the time of a picture with all effects.
    pub share: f64,
    /// The difference between pictures with and without the effect.
    pub change: Difference,
}

/// The cost of all effects of some settings.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Prices {
    /// Median time of a picture with all wanted effects, ms.
    pub milliseconds: f64,
    /// Median time of a picture with the required effects only, ms.
    pub required_milliseconds: f64,
    /// Median difference between two measurements of the same settings, ms. Smaller costs are not
    /// significant.
    pub noise: f64,
    /// The cost of each enabled effect.
    pub each: Vec<Price>,
}

/// Measures the cost of the effects of the `wanted` settings, and the time with the `required`
/// settings, interleaved in `rounds` rounds.
///
/// # Errors
/// Those of [`Rasterizer::forward`].
pub fn prices<S: Scene, R: Rasterizer<S>>(
    uploaded: &UploadedScene<'_, S, R>,
    wanted: &RenderSettings,
    required: &RenderSettings,
    rounds: usize,
) -> Result<Prices, Error> {
    let with = |effects: Effects| (*wanted).with(|s| s.effects = effects);
    let cheaper: Vec<(Effect, Effects)> =
        Effect::ALL.into_iter().filter_map(|effect| Some((effect, effect.cheaper(&wanted.effects)?))).collect();
    let without: Vec<RenderSettings> = cheaper.iter().map(|(_, effects)| with(*effects)).collect();
    let mut each = Vec::with_capacity(cheaper.len());
    for ((effect, effects), change) in cheaper.iter().zip(uploaded.differences(wanted, &without)?) {
        let (value, cheaper) = (effect.value(&wanted.effects), effect.value(effects));
        each.push(Price { effect: *effect, value, cheaper, milliseconds: 0.0, share: 0.0, change });
    }
    let (mut whole, mut apart, mut required_times) = (Vec::new(), Vec::new(), Vec::new());
    let mut saved = vec![Vec::new(); cheaper.len()];
    for _ in 0..rounds.max(1) {
        let first = uploaded.milliseconds(wanted)?;
        for (without, saved) in without.iter().zip(&mut saved) {
            saved.push(first - uploaded.milliseconds(without)?);
        }
        required_times.push(uploaded.milliseconds(required)?);
        let second = uploaded.milliseconds(wanted)?;
        whole.extend([first, second]);
        apart.push((first - second).abs());
    }
    let milliseconds = Quantiles::of(&whole).median;
    for (price, saved) in each.iter_mut().zip(&saved) {
        price.milliseconds = Quantiles::of(saved).median;
        price.share = price.milliseconds / milliseconds;
    }
    // Equal settings have equal times; two measurements of them would differ by chance.
    let required_milliseconds = if required == wanted { milliseconds } else { Quantiles::of(&required_times).median };
    let noise = Quantiles::of(&apart).median;
    Ok(Prices { milliseconds, required_milliseconds, noise, each })
}

impl<S: Scene, R: Rasterizer<S>> UploadedScene<'_, S, R> {
    /// The time of a picture, ms, averaged over the views.
    fn milliseconds(&self, settings: &RenderSettings) -> Result<f64, Error> {
        let started = Instant::now();
        for view in self.views {
            // Waits until the picture is done; the counts are little to read from a device.
            self.rasterizer.culled(&self.rasterizer.forward(self.splats, view, settings).block_on()?);
        }
        Ok(started.elapsed().as_secs_f64() * 1e3 / self.views.len().max(1) as f64)
    }
}
