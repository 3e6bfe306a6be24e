//! What each effect costs, and what leaving it out would change.

use pollster::FutureExt as _;
use std::time::Instant;

use gs_core::{Effects, Error, Rasterizer, RenderSettings, Scene, effects::Effect, profile::Quantiles};
use serde::Serialize;

use super::{Difference, Sight};

/// What one effect costs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Price {
    /// The effect.
    pub effect: Effect,
    /// Its value.
    pub value: &'static str,
    /// The value that it is compared with, a step cheaper.
    pub cheaper: &'static str,
    /// How much longer a picture takes with it, ms: the median over the rounds of the difference within a round.
    pub milliseconds: f64,
    /// That as a share of the time of a picture with all effects.
    pub share: f64,
    /// What pictures without it are like.
    pub change: Difference,
}

/// What all effects of some settings cost.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Prices {
    /// The median time of a picture with all effects, ms.
    pub milliseconds: f64,
    /// The same with what is called for instead, ms.
    pub called_for_milliseconds: f64,
    /// The median of how far two measurements of the same are apart, ms: what costs less is as good as nothing.
    pub noise: f64,
    /// One of each effect that is on.
    pub each: Vec<Price>,
}

/// Measures the effects of the `wanted` settings in a scene's views, and what it takes with the settings that are `called_for` instead:
/// `rounds` times, in turns, after once without looking at the clock.
///
/// # Errors
/// Those of [`Rasterizer::forward`].
pub fn prices<S: Scene, R: Rasterizer<S>>(
    sight: &Sight<'_, S, R>,
    wanted: &RenderSettings,
    called_for: &RenderSettings,
    rounds: usize,
) -> Result<Prices, Error> {
    let with = |effects: Effects| RenderSettings { effects, ..*wanted };
    let cheaper: Vec<(Effect, Effects)> =
        Effect::ALL.into_iter().filter_map(|effect| Some((effect, effect.cheaper(&wanted.effects)?))).collect();
    let without: Vec<RenderSettings> = cheaper.iter().map(|(_, effects)| with(*effects)).collect();
    let mut each = Vec::with_capacity(cheaper.len());
    for ((effect, effects), change) in cheaper.iter().zip(sight.differences(wanted, &without)?) {
        let (value, cheaper) = (effect.value(&wanted.effects), effect.value(effects));
        each.push(Price { effect: *effect, value, cheaper, milliseconds: 0.0, share: 0.0, change });
    }
    let (mut whole, mut apart, mut called) = (Vec::new(), Vec::new(), Vec::new());
    let mut saved = vec![Vec::new(); cheaper.len()];
    for _ in 0..rounds.max(1) {
        let first = sight.milliseconds(wanted)?;
        for (without, saved) in without.iter().zip(&mut saved) {
            saved.push(first - sight.milliseconds(without)?);
        }
        called.push(sight.milliseconds(called_for)?);
        let second = sight.milliseconds(wanted)?;
        whole.extend([first, second]);
        apart.push((first - second).abs());
    }
    let milliseconds = Quantiles::of(&whole).median;
    for (price, saved) in each.iter_mut().zip(&saved) {
        price.milliseconds = Quantiles::of(saved).median;
        price.share = price.milliseconds / milliseconds;
    }
    // What is the same costs the same; chance would tell them apart.
    let called_for_milliseconds = if called_for == wanted { milliseconds } else { Quantiles::of(&called).median };
    let noise = Quantiles::of(&apart).median;
    Ok(Prices { milliseconds, called_for_milliseconds, noise, each })
}

impl<S: Scene, R: Rasterizer<S>> Sight<'_, S, R> {
    /// The time of a picture, the mean over the views, ms.
    fn milliseconds(&self, settings: &RenderSettings) -> Result<f64, Error> {
        let started = Instant::now();
        for view in self.views {
            // What was left out is known when the picture is done, and is little to read from a device.
            self.on.culled(&self.on.forward(self.splats, view, settings).block_on()?);
        }
        Ok(started.elapsed().as_secs_f64() * 1e3 / self.views.len().max(1) as f64)
    }
}
