//! Times of many candidates, interleaved so that disturbances of the machine affect all of them
//! alike.

use gs_core::{Error, RenderSettings};

use crate::price::frontier::Contender;

/// Fewest and most rounds.
pub(crate) const ROUNDS: [usize; 2] = [7, 60];

/// A candidate slower than the quickest of its backend by this factor is measured in every second
/// round; by four times this factor, in every fourth.
const SLOW: f64 = 4.0;

/// Fewest measurements of a candidate.
const FEWEST: usize = 3;

/// A contender with settings.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidate {
    /// Index of the contender.
    pub(crate) contender: usize,
    pub(crate) settings: RenderSettings,
}

/// Seconds per view of each candidate, one value for each round that it took part in. There are as
/// many rounds as fit into `seconds`, but at least seven, after a warm-up. Every second round is in
/// reverse order, so that a candidate does not always follow the same neighbour.
pub(crate) fn interleaved<V>(
    contenders: &[Contender<'_, V>],
    candidates: &[Candidate],
    views: &[V],
    seconds: f64,
) -> Result<Vec<Vec<f64>>, Error> {
    let renderer = |contender: usize| &contenders[contender].renderer;
    let once = |candidate: &Candidate| -> Result<f64, Error> {
        let renderer = renderer(candidate.contender);
        let all: f64 =
            views.iter().map(|view| renderer.seconds(view, &candidate.settings)).sum::<Result<f64, Error>>()?;
        Ok(all / views.len().max(1) as f64)
    };
    let warm = candidates.iter().map(once).collect::<Result<Vec<f64>, Error>>()?;
    let backend = |at: usize| &contenders[candidates[at].contender].backend;
    let quickest = |of: usize| {
        let own = (0..warm.len()).filter(|&other| backend(other) == backend(of)).map(|other| warm[other]);
        own.fold(f64::INFINITY, f64::min)
    };
    let mut every: Vec<usize> = (0..warm.len())
        .map(|at| match warm[at] / quickest(at) {
            ratio if ratio > 4.0 * SLOW => 4,
            ratio if ratio > SLOW => 2,
            _ => 1,
        })
        .collect();
    let round: f64 = warm.iter().zip(&every).map(|(time, &every)| time * views.len() as f64 / every as f64).sum();
    let rounds = ((seconds / round) as usize).clamp(ROUNDS[0], ROUNDS[1]);
    every.iter_mut().for_each(|every| *every = (*every).min(rounds / FEWEST));
    let mut times = vec![Vec::with_capacity(rounds); candidates.len()];
    let mut last = None;
    for round in 0..rounds {
        for step in 0..candidates.len() {
            let at = if round % 2 == 0 { step } else { candidates.len() - 1 - step };
            // Slow candidates are spread over the rounds.
            if (round + at) % every[at] == 0 {
                let Candidate { contender, settings } = &candidates[at];
                // One pass that is not measured wakes up the contender's threads.
                if last.replace(*contender) != Some(*contender) {
                    renderer(*contender).seconds(&views[0], settings)?;
                }
                times[at].push(once(&candidates[at])?);
            }
        }
    }
    Ok(times)
}
