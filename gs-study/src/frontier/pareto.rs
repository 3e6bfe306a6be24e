//! The frontier: what nothing else is both quicker and at least as exact as.

use super::Noise;

/// Errors below this are roundings, of which less is not better: a four-hundredth of a display step.
const ROUNDING: f64 = 1e-5;

/// An error must be less than this part of another to be less.
const LESS: f64 = 0.98;

/// Which of these (seconds, largest error) lie on the frontier. One does not where another is no less exact and quicker by more than the noise,
/// or more exact and not slower by more than the noise.
pub fn frontier_of(points: &[(f64, f64)], noise: Noise) -> Vec<bool> {
    let error = |e: f64| e.max(ROUNDING);
    let beats = |&(t, e): &(f64, f64), &(other_t, other_e): &(f64, f64)| {
        let (e, other_e) = (error(e), error(other_e));
        e <= other_e && (t * noise.factor < other_t || (e < LESS * other_e && t <= other_t * noise.factor))
    };
    points.iter().map(|point| !points.iter().any(|other| beats(other, point))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_beaten_is_not_on_the_frontier() {
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
    }
}
