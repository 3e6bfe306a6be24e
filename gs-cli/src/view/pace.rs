//! How long frames take, and how much of the resolution is given up for it while the picture moves.

use std::collections::VecDeque;

/// A frame that takes longer than this does not feel like motion, ms.
pub(crate) const BUDGET_MS: f32 = 50.0;

/// A finer resolution is gone to where it is expected to take less than this share of the budget: so it does not go to and fro.
const MARGIN: f32 = 0.8;

/// Where no resolution is fast enough, the finest that is not this many times slower than the fastest.
const WORTHWHILE: f32 = 2.0;

/// By what the sides of the picture are divided, finest first.
const DIVISORS: [u32; 6] = [1, 2, 3, 4, 6, 8];

/// How many frames the median is of, at most.
const RECENT: usize = 31;

/// The median of what the last frames took.
#[derive(Debug, Clone, Default)]
pub(crate) struct FrameTimes {
    recent: VecDeque<f32>,
}

impl FrameTimes {
    /// One more frame, ms.
    pub(crate) fn add(&mut self, milliseconds: f32) {
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(milliseconds);
    }

    /// Frames from now on are of another kind.
    pub(crate) fn clear(&mut self) {
        self.recent.clear();
    }

    /// How many frames there are.
    pub(crate) fn len(&self) -> usize {
        self.recent.len()
    }

    /// Their median, ms, of an even number the upper one; `None` of none.
    pub(crate) fn median(&self) -> Option<f32> {
        let mut sorted: Vec<f32> = self.recent.iter().copied().collect();
        sorted.sort_by(f32::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }
}

/// What is known of the time that each resolution takes, and the one that motion is shown at.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pace {
    /// ms a frame, by resolution; `None` where none was seen yet.
    known: [Option<f32>; DIVISORS.len()],
    /// The resolution of motion, an index into [`DIVISORS`].
    level: usize,
}

impl Pace {
    /// A frame with its sides divided by `divisor` took so long, ms.
    pub(crate) fn measured(&mut self, divisor: u32, milliseconds: f32) {
        let Some(level) = DIVISORS.iter().position(|&known| known == divisor) else { return };
        let milliseconds = milliseconds.max(1e-3);
        // What makes one resolution slower, such as coming nearer, makes all of them.
        let change = self.known[level].map_or(1.0, |before| milliseconds / before);
        for other in self.known.iter_mut().flatten() {
            *other *= change;
        }
        self.known[level] = Some(milliseconds);
    }

    /// What is drawn is of another kind from now on, and as fast as it is.
    pub(crate) fn forget(&mut self) {
        *self = Self::default();
    }

    /// By what the sides of the picture are to be divided while it moves.
    pub(crate) fn divisor(&mut self) -> u32 {
        let expected: [f32; DIVISORS.len()] = std::array::from_fn(|level| self.expected(level));
        let allowed = |level: usize| if level < self.level { MARGIN * BUDGET_MS } else { BUDGET_MS };
        let fastest = expected.into_iter().fold(f32::INFINITY, f32::min);
        let fits = (0..DIVISORS.len()).find(|&level| expected[level] <= allowed(level));
        let least_evil = || (0..DIVISORS.len()).find(|&level| expected[level] <= WORTHWHILE * fastest);
        self.level = fits.or_else(least_evil).unwrap_or(0);
        DIVISORS[self.level]
    }

    /// What a frame of that resolution takes, ms: as seen, else at most so much longer than a coarser one as it has more pixels, else
    /// hopefully as much shorter than a finer one.
    fn expected(&self, level: usize) -> f32 {
        let pixels = |of: usize, against: usize| (DIVISORS[against] as f32 / DIVISORS[of] as f32).powi(2);
        let finer = (0..level).rev().find_map(|other| self.known[other].map(|known| (other, known)));
        let coarser = (level + 1..DIVISORS.len()).find_map(|other| self.known[other].map(|known| (other, known)));
        match (self.known[level], finer, coarser) {
            (Some(known), ..) => known,
            (None, Some((_, finer)), Some((other, known))) => (known * pixels(level, other)).min(finer),
            (None, None, Some((other, known))) => known * pixels(level, other),
            (None, Some((other, known)), None) => known * pixels(level, other),
            (None, None, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moves for so many frames, of which one takes `time(divisor)`; the divisors.
    fn moving(pace: &mut Pace, frames: usize, time: impl Fn(u32) -> f32) -> Vec<u32> {
        let frame = |_| {
            let divisor = pace.divisor();
            pace.measured(divisor, time(divisor));
            divisor
        };
        (0..frames).map(frame).collect()
    }

    #[test]
    fn the_median_is_of_the_recent() {
        let mut times = FrameTimes::default();
        assert_eq!(times.median(), None);
        [30.0, 10.0, 20.0].into_iter().for_each(|time| times.add(time));
        assert_eq!((times.median(), times.len()), (Some(20.0), 3));
        (0..100).for_each(|_| times.add(5.0));
        assert_eq!((times.median(), times.len()), (Some(5.0), RECENT));
        times.clear();
        assert_eq!(times.median(), None);
    }

    #[test]
    fn whoever_is_fast_gives_nothing_up() {
        assert_eq!(moving(&mut Pace::default(), 50, |_| 45.0), [1; 50]);
    }

    #[test]
    fn slow_frames_become_coarser_until_they_are_fast_enough_and_stay_so() {
        let mut pace = Pace::default();
        pace.measured(1, 400.0);
        let divisors = moving(&mut pace, 100, |divisor| 2.0 + 398.0 / (divisor * divisor) as f32);
        assert_eq!(divisors[0], 3, "400 ms / 9 would do");
        assert!(divisors[5..].iter().all(|&divisor| divisor == 3), "{divisors:?}");
        // Where a frame has a part that no resolution makes shorter, one coarser.
        let mut pace = Pace::default();
        let divisors = moving(&mut pace, 100, |divisor| 20.0 + 300.0 / (divisor * divisor) as f32);
        assert!(divisors[6..].iter().all(|&divisor| divisor == 4), "{divisors:?}");
    }

    #[test]
    fn resolution_is_not_given_up_for_nothing() {
        let mut pace = Pace::default();
        let divisors = moving(&mut pace, 100, |divisor| 300.0 + 20.0 / (divisor * divisor) as f32);
        assert_eq!(divisors[20..], [1; 80], "{divisors:?}");
    }

    #[test]
    fn what_was_given_up_comes_back() {
        let mut pace = Pace::default();
        assert!(moving(&mut pace, 30, |divisor| 400.0 / (divisor * divisor) as f32)[29] > 1);
        let divisors = moving(&mut pace, 30, |divisor| 10.0 / (divisor * divisor) as f32);
        assert_eq!(divisors[29], 1, "{divisors:?}");
        // A first frame that was slow only once is no measure, once a frame at rest has shown it.
        let mut pace = Pace::default();
        pace.measured(1, 3000.0);
        moving(&mut pace, 10, |divisor| 9.0 / (divisor * divisor) as f32);
        pace.measured(1, 9.0);
        assert_eq!(pace.divisor(), 1);
        pace.forget();
        assert_eq!(pace.divisor(), 1);
    }
}
