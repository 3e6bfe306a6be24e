//! The times of many candidates, measured in turn so that whatever else the machine does falls on all of them alike.

use gs_core::{Error, RenderSettings};

use super::Contender;

/// Fewest and most rounds.
const ROUNDS: [usize; 2] = [7, 60];

/// A candidate that takes longer than this many times the quickest of its backend is measured in every second round; four times that, in every fourth.
const SLOW: f64 = 4.0;

/// Fewest times of a candidate.
const FEWEST: usize = 3;

/// Who renders with which settings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Candidate {
    /// Its place among the contenders.
    pub(super) contender: usize,
    pub(super) settings: RenderSettings,
}

/// Seconds a view of each candidate, one for each round that it was in; as many rounds as fit into `seconds`, but at least seven, after one that does not
/// count. Every second round goes backwards, so that nobody always follows the same neighbour.
///
/// # Errors
/// Those of rendering.
pub(super) fn interleaved<V>(
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
            // Slow ones take turns, too.
            if (round + at) % every[at] == 0 {
                let Candidate { contender, settings } = &candidates[at];
                // Threads that have slept while another's worked wake up first, as they do in a row of frames.
                if last.replace(*contender) != Some(*contender) {
                    renderer(*contender).seconds(&views[0], settings)?;
                }
                times[at].push(once(&candidates[at])?);
            }
        }
    }
    Ok(times)
}
