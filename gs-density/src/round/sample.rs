//! Normalised scores, and random draws in proportion to weights.

use rand::RngExt;

use crate::observation::Rng;

/// Draws `count` of these (index, weight) pairs without replacement, in proportion to their
/// weights, and returns their indices in ascending order. Pairs whose weight is not positive and
/// finite are never drawn.
///
/// *Source:* Efraimidis and Spirakis 2006: the largest u^(1/w), for u uniform in 0..1.
pub(crate) fn sample(weighted: impl IntoIterator<Item = (u32, f64)>, count: usize, rng: &mut Rng) -> Vec<u32> {
    // One number is drawn for each pair, whatever its weight.
    let mut keys: Vec<(f64, u32)> = weighted
        .into_iter()
        .map(|(index, weight)| (-rng.random_range(f64::MIN_POSITIVE..1.0).ln() / weight, weight, index))
        .filter(|&(_, weight, _)| weight > 0.0 && weight.is_finite())
        .map(|(key, _, index)| (key, index))
        .collect();
    if count < keys.len() {
        keys.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        keys.truncate(count);
    }
    let mut drawn: Vec<u32> = keys.into_iter().map(|(_, index)| index).collect();
    drawn.sort_unstable();
    drawn
}

/// Adds `weight` times these values, divided by the (lower) median of the positive ones, to `sums`.
pub(crate) fn add_normalised(sums: &mut [f64], weight: f32, value: impl Fn(usize) -> f32) {
    let mut positive: Vec<f32> = (0..sums.len()).map(&value).filter(|v| *v > 0.0 && v.is_finite()).collect();
    if positive.is_empty() {
        return;
    }
    let middle = (positive.len() - 1) / 2;
    let (_, &mut median, _) = positive.select_nth_unstable_by(middle, f32::total_cmp);
    for (index, sum) in sums.iter_mut().enumerate() {
        let v = value(index);
        if v > 0.0 && v.is_finite() {
            *sum += f64::from(weight) * f64::from(v) / f64::from(median);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_follow_the_weights() {
        let weights = [(0, 1.0), (1, 3.0), (2, 0.0), (3, f64::NAN), (4, 4.0), (5, f64::INFINITY)];
        let mut times = [0; 6];
        let mut rng = Rng::new(7, 1);
        for _ in 0..8000 {
            for index in sample(weights, 1, &mut rng) {
                times[index as usize] += 1;
            }
        }
        for (index, expected) in [(0, 1000), (1, 3000), (2, 0), (3, 0), (4, 4000), (5, 0)] {
            let found: i32 = times[index];
            assert!((found - expected).abs() < 150, "{index}: {found} of {expected}");
        }
        assert_eq!(sample(weights, 2, &mut rng).len(), 2);
        assert_eq!(sample(weights, 9, &mut rng), [0, 1, 4]);
    }

    #[test]
    fn values_are_in_units_of_their_median() {
        let values = [8.0, 0.0, 2.0, -1.0, f32::NAN, 4.0, 16.0];
        let mut sums = vec![1.0; 7];
        add_normalised(&mut sums, 3.0, |index| values[index]);
        assert_eq!(sums, [7.0, 1.0, 2.5, 1.0, 1.0, 4.0, 13.0]);
        add_normalised(&mut sums, 3.0, |_| 0.0);
        assert_eq!(sums[0], 7.0);
    }
}
