//! A table of 256 values that stand for many: k-means in one dimension.

/// Values in a table.
const LEVELS: usize = 256;

/// Bins of the first estimate.
const BINS: usize = 4096;

/// Rounds of Lloyd's algorithm; the error hardly falls after them.
const ROUNDS: usize = 40;

/// A table of 256 values in ascending order.
#[derive(Debug)]
pub(super) struct Codebook {
    levels: Vec<f32>,
}

impl Codebook {
    /// A table for these finite values: the values themselves where they are few, or else one that
    /// makes the squared error small.
    pub(super) fn of(mut values: Vec<f32>) -> Self {
        values.sort_unstable_by(f32::total_cmp);
        let mut distinct = values.clone();
        distinct.dedup();
        let levels = if distinct.len() <= LEVELS { distinct } else { fitted(&values) };
        Self { levels }
    }

    /// The index of the nearest value.
    pub(super) fn index(&self, value: f32) -> u8 {
        let above = self.levels.partition_point(|&level| level < value).min(self.levels.len() - 1);
        let below = above.saturating_sub(1);
        let nearest = if value - self.levels[below] <= self.levels[above] - value { below } else { above };
        nearest as u8
    }

    /// All 256 values; the last is repeated where there are fewer.
    pub(super) fn values(&self) -> Vec<Option<f32>> {
        let last = self.levels.last().copied();
        self.levels.iter().copied().map(Some).chain(std::iter::repeat(last)).take(LEVELS).collect()
    }
}

/// Levels for more values than levels, which are sorted.
fn fitted(values: &[f32]) -> Vec<f32> {
    let mut sums = Vec::with_capacity(values.len() + 1);
    sums.push(0.0);
    values.iter().for_each(|&value| sums.push(sums[sums.len() - 1] + f64::from(value)));
    let mut levels = first_estimate(values);
    for _ in 0..ROUNDS {
        let mut start = 0;
        for k in 0..levels.len() {
            let end = match levels.get(k + 1) {
                Some(next) => {
                    let middle = levels[k] / 2.0 + next / 2.0;
                    start + values[start..].partition_point(|&value| value <= middle)
                }
                None => values.len(),
            };
            if end > start {
                levels[k] = ((sums[end] - sums[start]) / (end - start) as f64) as f32;
            }
            start = end;
        }
        levels.sort_unstable_by(f32::total_cmp);
    }
    levels.dedup();
    levels
}

/// Levels with a density that is the cube root of that of the values, which is best for many levels
/// (Panter and Dite, 1951). The density is that of all but a thousandth at each end, which may be anywhere;
/// the extreme values are levels.
fn first_estimate(values: &[f32]) -> Vec<f32> {
    let last = values.len() - 1;
    let ends = (values.len() / 1000).max(1);
    let (low, high) = (f64::from(values[ends]), f64::from(values[last - ends]));
    let width = (high - low) / BINS as f64;
    let edge = |bin: usize| low + width * bin as f64;
    let mut start = ends;
    let weights: Vec<f64> = (1..=BINS)
        .map(|bin| {
            let end = values.partition_point(|&value| f64::from(value) <= edge(bin));
            let count = end.saturating_sub(start);
            start = end;
            (count as f64).cbrt()
        })
        .collect();
    let share = weights.iter().sum::<f64>() / LEVELS as f64;
    let (mut bin, mut passed) = (0, 0.0);
    let level = |k: usize| {
        let wanted = (k as f64 + 0.5) * share;
        while bin + 1 < BINS && passed + weights[bin] < wanted {
            passed += weights[bin];
            bin += 1;
        }
        let part = if weights[bin] > 0.0 { (wanted - passed) / weights[bin] } else { 0.5 };
        (edge(bin) + width * part.clamp(0.0, 1.0)) as f32
    };
    let mut levels: Vec<f32> = (0..LEVELS).map(level).collect();
    (levels[0], levels[LEVELS - 1]) = (values[0], values[last]);
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_are_kept_exactly() {
        let values = vec![0.5, -3.0, 0.5, 7.25];
        let book = Codebook::of(values.clone());
        let table = book.values();
        assert_eq!(table.len(), LEVELS);
        values.iter().for_each(|&value| assert_eq!(table[usize::from(book.index(value))], Some(value)));
        assert_eq!(Codebook::of(vec![2.0]).index(2.0), 0);
    }

    #[test]
    fn the_table_is_nearly_the_best_for_a_uniform_distribution() {
        let values: Vec<f32> = (0..100_000).map(|k| k as f32 / 100_000.0).collect();
        let book = Codebook::of(values.clone());
        let table = book.values();
        let error = |&value: &f32| {
            let level = table[usize::from(book.index(value))].unwrap();
            let nearest = table.iter().flatten().map(|other| (other - value).abs()).fold(f32::MAX, f32::min);
            assert_eq!((level - value).abs(), nearest);
            f64::from(level - value).powi(2)
        };
        let mean = values.iter().map(error).sum::<f64>() / 1e5;
        let best = 1.0 / 12.0 / 256.0_f64.powi(2);
        assert!(mean < 1.02 * best, "{mean} {best}");
    }

    #[test]
    fn values_far_away_leave_levels_to_the_others() {
        let mut values: Vec<f32> = (0..10_000).map(|k| k as f32 / 1e6).collect();
        values.extend([-1000.0, 30.0, 1000.0]);
        let book = Codebook::of(values.clone());
        let table = book.values();
        let error = |&value: &f32| (table[usize::from(book.index(value))].unwrap() - value).abs();
        assert!(values[..10_000].iter().map(error).fold(0.0, f32::max) < 0.01 / 200.0);
        assert!(values[10_000..].iter().all(|value| error(value) < 1e-3));
    }
}
