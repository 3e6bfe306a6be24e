//! Counts in messages.

use std::fmt::Display;

/// A count with its noun, in the singular for one: "1 Gaussian", "0 Gaussians", "9000 Gaussians".
///
/// The noun is one whose plural ends in -s.
pub fn counted<N: Display + PartialEq + From<u8>>(count: N, noun: &str) -> String {
    let ending = if count == N::from(1) { "" } else { "s" };
    format!("{count} {noun}{ending}")
}

/// A time in the unit that suits it, in whole minutes rounded up: "12 s", "3 min", "2 h 05 min".
pub fn duration(seconds: f64) -> String {
    let seconds = seconds.round() as u64;
    let minutes = seconds.div_ceil(60);
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{minutes} min"),
        _ => format!("{} h {:02} min", minutes / 60, minutes % 60),
    }
}

/// A count with its noun and verb: "1 Gaussian is", "2 Gaussians are".
pub(crate) fn there_are(count: usize, noun: &str) -> String {
    format!("{} {}", counted(count, noun), if count == 1 { "is" } else { "are" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_is_singular() {
        assert_eq!(counted(1u32, "Gaussian"), "1 Gaussian");
        assert_eq!(counted(0usize, "step"), "0 steps");
        assert_eq!(counted(21u64, "held-out view"), "21 held-out views");
    }

    #[test]
    fn durations_have_a_suitable_unit() {
        assert_eq!(
            ["3 s", "2 min", "3 min", "2 h 05 min", "2 h 06 min"],
            [3.2, 119.9, 121.0, 7500.0, 7501.0].map(duration)
        );
    }
}
