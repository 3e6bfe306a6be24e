//! The time per frame, and the resolution while the picture moves.

use std::collections::VecDeque;

/// The longest frame that still feels like motion, ms.
pub(crate) const BUDGET_MS: f32 = 50.0;

/// A finer resolution must be expected to take less than this share of the budget, so that the
/// resolution does not alternate.
const MARGIN: f32 = 0.8;

/// How many times slower than the fastest resolution the chosen one may be if none is fast enough;
/// the finest such resolution is chosen.
const WORTHWHILE: f32 = 2.0;

/// Divisors of the picture's sides, finest resolution first.
const DIVISORS: [u32; 6] = [1, 2, 3, 4, 6, 8];

/// The most frames for a median.
const RECENT: usize = 31;

/// The times of the last frames.
#[derive(Debug, Clone, Default)]
pub(crate) struct FrameTimes {
    recent: VecDeque<f32>,
}

impl FrameTimes {
    /// Adds a frame, ms.
    pub(crate) fn add(&mut self, milliseconds: f32) {
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(milliseconds);
    }

    /// Forgets all frames.
    pub(crate) fn clear(&mut self) {
        self.recent.clear();
    }

    /// The number of frames.
    pub(crate) fn len(&self) -> usize {
        self.recent.len()
    }

    /// Median of the times, ms; the upper one of an even number.
    pub(crate) fn median(&self) -> Option<f32> {
        let mut sorted: Vec<f32> = self.recent.iter().copied().collect();
        sorted.sort_by(f32::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }
}

/// The known time per frame at each resolution, and the resolution in motion.
#[derive(Debug, Clone, Default)]
pub(crate) struct MotionResolution {
    /// Time per frame by resolution, ms; `None` if unknown.
    known: [Option<f32>; DIVISORS.len()],
    /// The resolution in motion, an index into [`DIVISORS`].
    level: usize,
}

impl MotionResolution {
    /// Adds the time of a frame with this divisor, ms.
    pub(crate) fn add(&mut self, divisor: u32, milliseconds: f32) {
        let Some(level) = DIVISORS.iter().position(|&known| known == divisor) else { return };
        let milliseconds = milliseconds.max(1e-3);
        // A change of one resolution, such as by coming nearer, is a change of all.
        let change = self.known[level].map_or(1.0, |before| milliseconds / before);
        for other in self.known.iter_mut().flatten() {
            *other *= change;
        }
        self.known[level] = Some(milliseconds);
    }

    /// Forgets all times.
    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }

    /// The divisor of the picture's sides in motion.
    pub(crate) fn divisor(&mut self) -> u32 {
        let expected: [f32; DIVISORS.len()] = std::array::from_fn(|level| self.expected(level));
        let allowed = |level: usize| if level < self.level { MARGIN * BUDGET_MS } else { BUDGET_MS };
        let fastest = expected.into_iter().fold(f32::INFINITY, f32::min);
        let fits = (0..DIVISORS.len()).find(|&level| expected[level] <= allowed(level));
        let acceptable = || (0..DIVISORS.len()).find(|&level| expected[level] <= WORTHWHILE * fastest);
        self.level = fits.or_else(acceptable).unwrap_or(0);
        DIVISORS[self.level]
    }

    /// The expected time of a frame at this resolution, ms: as measured, or in proportion to the
    /// pixels of the nearest coarser one, or of the nearest finer one.
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

    /// The divisors of this many frames in motion, each of which takes `time(divisor)`.
    fn moving(motion: &mut MotionResolution, frames: usize, time: impl Fn(u32) -> f32) -> Vec<u32> {
        let frame = |_| {
            let divisor = motion.divisor();
            motion.add(divisor, time(divisor));
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
    fn fast_frames_keep_the_full_resolution() {
        assert_eq!(moving(&mut MotionResolution::default(), 50, |_| 45.0), [1; 50]);
    }

    #[test]
    fn slow_frames_become_coarser_until_they_are_fast_enough() {
        let mut motion = MotionResolution::default();
        motion.add(1, 400.0);
        let divisors = moving(&mut motion, 100, |divisor| 2.0 + 398.0 / (divisor * divisor) as f32);
        assert_eq!(divisors[0], 3, "400 ms / 9 would do");
        assert!(divisors[5..].iter().all(|&divisor| divisor == 3), "{divisors:?}");
        // If part of the time does not depend on the resolution, one coarser.
        let mut motion = MotionResolution::default();
        let divisors = moving(&mut motion, 100, |divisor| 20.0 + 300.0 / (divisor * divisor) as f32);
        assert!(divisors[6..].iter().all(|&divisor| divisor == 4), "{divisors:?}");
    }

    #[test]
    fn resolution_stays_if_it_does_not_help() {
        let mut motion = MotionResolution::default();
        let divisors = moving(&mut motion, 100, |divisor| 300.0 + 20.0 / (divisor * divisor) as f32);
        assert_eq!(divisors[20..], [1; 80], "{divisors:?}");
    }

    #[test]
    fn full_resolution_comes_back() {
        let mut motion = MotionResolution::default();
        assert!(moving(&mut motion, 30, |divisor| 400.0 / (divisor * divisor) as f32)[29] > 1);
        let divisors = moving(&mut motion, 30, |divisor| 10.0 / (divisor * divisor) as f32);
        assert_eq!(divisors[29], 1, "{divisors:?}");
        // A slow first frame is forgotten after a fast one at rest.
        let mut motion = MotionResolution::default();
        motion.add(1, 3000.0);
        moving(&mut motion, 10, |divisor| 9.0 / (divisor * divisor) as f32);
        motion.add(1, 9.0);
        assert_eq!(motion.divisor(), 1);
        motion.clear();
        assert_eq!(motion.divisor(), 1);
    }
}
