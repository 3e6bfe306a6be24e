//! The grid of means, 2¹⁶ steps of ln-distance along each axis, and the order along its Morton
//! curve.

use glam::Vec3;

const STEPS: f64 = 65_535.0;

/// The range of each axis, sign(x) ln(1 + abs(x)).
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
}

impl Grid {
    /// The smallest grid that holds all means.
    pub(super) fn around(means: &[Vec3]) -> Self {
        let low = means.iter().fold(Vec3::INFINITY, |low, &mean| low.min(mean));
        let high = means.iter().fold(Vec3::NEG_INFINITY, |high, &mean| high.max(mean));
        Self { mins: low.to_array().map(log), maxs: high.to_array().map(log) }
    }

    /// The nearest point.
    pub(super) fn words(&self, mean: Vec3) -> [u16; 3] {
        std::array::from_fn(|axis| {
            let (min, max) = (self.mins[axis], self.maxs[axis]);
            let share = if max > min { (log(mean[axis]) - min) / (max - min) } else { 0.0 };
            (share * STEPS).round() as u16
        })
    }

    /// The mean at a point.
    pub(super) fn mean(&self, words: [u16; 3]) -> Vec3 {
        let along = |axis: usize| {
            let (min, max) = (self.mins[axis], self.maxs[axis]);
            let log = min + (max - min) * (f64::from(words[axis]) / STEPS);
            (log.abs().exp_m1() as f32).copysign(log as f32)
        };
        Vec3::from_array(std::array::from_fn(along))
    }
}

fn log(value: f32) -> f64 {
    f64::from(value).abs().ln_1p().copysign(value.into())
}

/// The numbers of points along the Morton curve, in each of the runs of these lengths.
pub(super) fn along_morton_curve(points: &[[u16; 3]], runs: &[usize]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    let mut rest = &mut *order;
    for &run in runs {
        let (run, after) = rest.split_at_mut(run);
        run.sort_by_cached_key(|&i| {
            let [x, y, z] = points[i as usize].map(spread);
            x | y << 1 | z << 2
        });
        rest = after;
    }
    order
}

/// Bit k of a number as bit 3 k.
fn spread(word: u16) -> u64 {
    (0..16).fold(0, |bits, k| bits | (u64::from(word) >> k & 1) << (3 * k))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_come_back_to_half_a_step() {
        let means = [Vec3::new(-40.0, 0.0, 5.0), Vec3::new(3.0, 0.0, 5.5), Vec3::new(0.001, 0.0, 5.2)];
        let grid = Grid::around(&means);
        for mean in means {
            let words = grid.words(mean);
            let back = grid.mean(words);
            // Half a step of the logarithm of 1 + 40.
            assert!((back - mean).abs().max_element() <= 41.0 * (41.0_f32 * 4.0).ln() / 131_070.0, "{mean} {back}");
            assert_eq!((grid.words(back), back.y), (words, 0.0));
        }
    }

    #[test]
    fn the_curve_keeps_neighbours_together() {
        let points = [[0, 0, 1], [1, 1, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0]];
        assert_eq!(along_morton_curve(&points, &[5]), [4, 3, 2, 1, 0]);
        assert_eq!(along_morton_curve(&points, &[2, 3]), [1, 0, 4, 3, 2]);
        assert_eq!(spread(0b1000_0000_0000_0101), 1 << 45 | 1 << 6 | 1);
    }
}
