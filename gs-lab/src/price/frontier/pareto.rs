//! The frontier: rows for which no other is both quicker and at least as exact.

use super::super::noise::Noise;

/// Errors below this are due to rounding and count as equal: a four-hundredth of a display step.
const ROUNDING: f64 = 1e-5;

/// An error counts as smaller only below this share of the other.
const LESS: f64 = 0.98;

/// Which of these (seconds, largest error) lie on the frontier. A point does not if another point
/// on the frontier is at least as exact and quicker by more than the noise, or more exact and not
/// slower by more than the noise.
///
/// Only points on the frontier exclude others. Otherwise a chain of points, each within the noise
/// of the next, would leave only its most exact one.
pub(super) fn frontier_of(points: &[(f64, f64)], noise: Noise) -> Vec<bool> {
    let error = |place: usize| points[place].1.max(ROUNDING);
    let beats = |one: usize, other: usize| {
        let (time, other_time) = (points[one].0, points[other].0);
        error(one) <= error(other)
            && (time * noise.factor < other_time
                || (error(one) < LESS * error(other) && time <= other_time * noise.factor))
    };
    // In this order, no point is excluded by a later one.
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| error(a).total_cmp(&error(b)).then(points[a].0.total_cmp(&points[b].0)));
    let mut on_frontier = vec![false; points.len()];
    for place in order {
        on_frontier[place] = !(0..points.len()).any(|other| on_frontier[other] && beats(other, place));
    }
    on_frontier
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beaten_points_are_not_on_the_frontier() {
        let noise = Noise { factor: 1.05, again: 1.0 };
        let points = [
            (1.0, 1e-2),
            (2.0, 1e-3),
            (2.1, 2e-3),  // Slower and less exact than the one before.
            (2.02, 5e-4), // As quick as the second within the noise, and more exact: the second is beaten.
            (5.0, 3e-7),
            (5.1, 1e-7), // Errors of rounding are equal, times within the noise: neither beats the other.
            (9.0, 1e-8),
        ];
        assert_eq!(frontier_of(&points, noise), [true, false, false, true, true, true, false]);
        assert!(frontier_of(&[], noise).is_empty());
        // Each is within the noise of the next. Only the second excludes the third, and the first
        // excludes the second.
        let chain: Vec<(f64, f64)> = (0..6).map(|i| (10.0 * 0.96f64.powi(i), 1e-3 * 2f64.powi(i))).collect();
        assert_eq!(frontier_of(&chain, noise), [true, false, true, false, true, false]);
        let much = Noise { factor: 3.8, again: 1.0 };
        assert_eq!(frontier_of(&[(23.4, 1e-6), (6.9, 1e-2), (2.06, 1e-1)], much), [true, false, true]);
    }
}
