//! Rankings of Gaussians by score; every criterion picks the first of one ranking.

use serde::{Deserialize, Serialize};

/// What growth by rank does with Gaussians whose score is 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum WhenFlat {
    /// No growth: a Gaussian that was never drawn, or whose image is perfect, has nothing to gain.
    #[default]
    Nothing,
    /// Growth behind all others, by index, so that the number of Gaussians grows in any case.
    Forced,
}

/// Candidates for growth, highest score first, ties by index.
///
/// Gaussians whose score is NaN, infinite or negative are no candidates; those with 0 only under
/// [`WhenFlat::Forced`].
#[derive(Debug, Clone, PartialEq)]
pub struct Ranking {
    indices: Vec<u32>,
    scores: Vec<f32>,
    population: usize,
}

impl Ranking {
    /// Ranks (index, score) pairs. The number of pairs is the population of which
    /// [`Self::top_percent`] takes its share.
    pub fn new(scores: impl IntoIterator<Item = (u32, f32)>, when_flat: WhenFlat) -> Self {
        let mut population = 0;
        let mut pairs: Vec<(u32, f32)> = scores
            .into_iter()
            .inspect(|_| population += 1)
            .filter(|&(_, score)| score.is_finite())
            .filter(|&(_, score)| score > 0.0 || (score == 0.0 && when_flat == WhenFlat::Forced))
            .map(|(index, score)| (index, score.abs())) // no −0, which would rank below 0
            .collect();
        pairs.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let (indices, scores) = pairs.into_iter().unzip();
        Self { indices, scores, population }
    }

    /// The candidates whose score is at least `threshold`.
    pub fn at_least(&self, threshold: f32) -> &[u32] {
        &self.indices[..self.scores.partition_point(|&score| score >= threshold)]
    }

    /// The first `percent` % of the population, rounded up (so at least one, unless `percent` is
    /// 0), as far as there are candidates.
    pub fn top_percent(&self, percent: f32) -> &[u32] {
        &self.indices[..share_of(self.population, percent).min(self.indices.len())]
    }
}

/// `percent` % of `count`, rounded up, so at least one unless `percent` is 0.
pub fn share_of(count: usize, percent: f32) -> usize {
    if percent >= 100.0 {
        return count;
    }
    let exact = count as f64 * f64::from(percent) / 100.0;
    // A percentage that f32 holds a little too large, such as 0.1, must not round a whole number up
    // to the next.
    (exact * (1.0 - f64::from(f32::EPSILON))).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranking(scores: &[f32], when_flat: WhenFlat) -> Ranking {
        Ranking::new(scores.iter().enumerate().map(|(i, &s)| (i as u32, s)), when_flat)
    }

    #[test]
    fn the_most_urgent_come_first_and_ties_by_index() {
        let scores = [0.2, f32::NAN, 0.5, 0.0, 0.2, f32::INFINITY, -1.0, -0.0];
        assert_eq!(ranking(&scores, WhenFlat::Nothing).at_least(0.0), [2, 0, 4]);
        assert_eq!(ranking(&scores, WhenFlat::Forced).at_least(0.0), [2, 0, 4, 3, 7]);
        assert_eq!(ranking(&scores, WhenFlat::Nothing).at_least(0.2), [2, 0, 4]);
        assert_eq!(ranking(&scores, WhenFlat::Nothing).at_least(0.3), [2]);
        assert_eq!(ranking(&scores, WhenFlat::Nothing).at_least(f32::NAN), [0u32; 0]);
    }

    #[test]
    fn percentages_are_of_the_population_and_rounded_up() {
        let count = |n: usize, percent| ranking(&vec![1.0; n], WhenFlat::Nothing).top_percent(percent).len();
        assert_eq!(count(20, 10.0), 2);
        assert_eq!(count(21, 10.0), 3);
        assert_eq!(count(1, 10.0), 1);
        assert_eq!(count(0, 10.0), 0);
        assert_eq!(count(1000, 0.1), 1);
        assert_eq!(count(1000, 0.7), 7);
        assert_eq!(count(7, 100.0), 7);
        assert_eq!(count(7, 0.0), 0);
        assert_eq!(count(7, f32::NAN), 0);
        let mostly_flat: Vec<f32> = (0..100).map(|i| if i < 3 { 1.0 } else { 0.0 }).collect();
        assert_eq!(ranking(&mostly_flat, WhenFlat::Nothing).top_percent(10.0).len(), 3);
        assert_eq!(ranking(&mostly_flat, WhenFlat::Forced).top_percent(10.0).len(), 10);
    }
}
