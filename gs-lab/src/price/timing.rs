//! Times of many candidates, interleaved so that disturbances of the machine affect all of them
//! alike.

use gs_core::{Error, RenderSettings, profile::Quantiles};
use serde::Serialize;

use super::Renderer;

/// Fewest and most rounds within a time.
pub(super) const ROUNDS: [usize; 2] = [7, 60];

/// A candidate slower than the quickest of its group by this factor is measured in every second
/// round; by four times this factor, in every fourth.
const SLOW: f64 = 4.0;

/// Fewest measurements of a candidate.
const FEWEST: usize = 3;

/// Measured times, seconds, with their spread.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Times {
    /// Median and quantiles.
    #[serde(flatten)]
    pub(crate) spread: Quantiles,
    /// All measurements, in order.
    pub(crate) samples: Vec<f64>,
}

impl From<Vec<f64>> for Times {
    fn from(samples: Vec<f64>) -> Self {
        Self { spread: Quantiles::of(&samples), samples }
    }
}

/// What is timed: settings on a machine.
pub(super) struct Timed<'c, V> {
    /// What renders.
    pub(super) renderer: &'c dyn Renderer<V>,
    /// The candidates among which slow ones are measured less often.
    pub(super) group: &'c str,
    pub(super) settings: RenderSettings,
}

/// How often each candidate is measured.
#[derive(Debug, Clone, Copy)]
pub(super) enum Rounds {
    /// All of them so many times.
    Exactly(usize),
    /// As often as fits into these seconds, but at least seven times; slow ones less often.
    Within(f64),
}

impl<V> Timed<'_, V> {
    /// Seconds per view.
    fn seconds(&self, views: &[V]) -> Result<f64, Error> {
        let all = views.iter().map(|view| self.renderer.seconds(view, &self.settings)).sum::<Result<f64, Error>>()?;
        Ok(all / views.len().max(1) as f64)
    }
}

impl Rounds {
    /// The number of rounds, and for each candidate the distance of the rounds that it takes part in.
    fn of<V>(self, candidates: &[Timed<'_, V>], warm: &[f64], views: usize) -> (usize, Vec<usize>) {
        let seconds = match self {
            Self::Exactly(rounds) => return (rounds.max(1), vec![1; warm.len()]),
            Self::Within(seconds) => seconds,
        };
        let slowness = |at: usize| {
            let own = (0..warm.len()).filter(|&other| candidates[other].group == candidates[at].group);
            warm[at] / own.map(|other| warm[other]).fold(f64::INFINITY, f64::min)
        };
        let every = (0..warm.len()).map(|at| match slowness(at) {
            ratio if ratio > 4.0 * SLOW => 4,
            ratio if ratio > SLOW => 2,
            _ => 1,
        });
        let every: Vec<usize> = every.collect();
        let round: f64 = warm.iter().zip(&every).map(|(time, &every)| time * views as f64 / every as f64).sum();
        let rounds = ((seconds / round) as usize).clamp(ROUNDS[0], ROUNDS[1]);
        (rounds, every.into_iter().map(|every| every.min(rounds / FEWEST)).collect())
    }
}

/// Seconds per view of each candidate, one value for each round that it took part in, after a warm-up.
/// Every second round is in reverse order, so that a candidate does not always follow the same
/// neighbour.
pub(super) fn interleaved<V>(candidates: &[Timed<'_, V>], views: &[V], rounds: Rounds) -> Result<Vec<Vec<f64>>, Error> {
    let warm = candidates.iter().map(|candidate| candidate.seconds(views)).collect::<Result<Vec<f64>, Error>>()?;
    let (rounds, every) = rounds.of(candidates, &warm, views.len());
    let mut times = vec![Vec::with_capacity(rounds); candidates.len()];
    let mut last: Option<&dyn Renderer<V>> = None;
    for round in 0..rounds {
        for step in 0..candidates.len() {
            let at = if round % 2 == 0 { step } else { candidates.len() - 1 - step };
            // Slow candidates are spread over the rounds.
            if (round + at) % every[at] == 0 {
                let Timed { renderer, settings, .. } = candidates[at];
                // One pass that is not measured wakes up the machine's threads.
                if !last.replace(renderer).is_some_and(|last| std::ptr::addr_eq(last, renderer)) {
                    renderer.seconds(&views[0], &settings)?;
                }
                times[at].push(candidates[at].seconds(views)?);
            }
        }
    }
    Ok(times)
}
