//! Axes of a figure: range, ticks and labels.

use std::ops::Range;

use super::Scale;

impl Scale {
    /// Position of a value on the axis; `None` where it has none.
    pub(super) fn place(self, value: f64) -> Option<f64> {
        match self {
            Self::Linear => Some(value),
            Self::Logarithmic => (value > 0.0).then(|| value.log10()),
        }
        .filter(|place| place.is_finite())
    }

    /// Ticks in a range of positions. A logarithmic axis has the decimal logarithms of round
    /// values.
    pub(super) fn ticks(self, range: &Range<f64>) -> Vec<f64> {
        match self {
            Self::Linear => ticks(range, 7),
            Self::Logarithmic => {
                let decades = range.end - range.start;
                let steps: &[f64] = if decades > 3.0 {
                    &[1.0]
                } else if decades > 0.7 {
                    &[1.0, 2.0, 5.0]
                } else {
                    &[1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]
                };
                // With very many decades, only every second, third, … has a tick.
                let stride = (decades / 8.0).ceil().max(1.0) as usize;
                let first = range.start.floor() as i32;
                let each = (first..=range.end.ceil() as i32).step_by(stride);
                let all = each.flat_map(|d| steps.iter().map(move |s| s.log10() + f64::from(d)));
                all.filter(|place| range.contains(place)).collect()
            }
        }
    }

    pub(super) fn label(self, place: f64, digits: usize) -> String {
        match self {
            Self::Linear => label(place, digits),
            Self::Logarithmic => human(10f64.powf(place)),
        }
    }
}

/// The range of the values with a margin; never empty.
pub(super) fn range(values: impl Iterator<Item = f64>, room: f64) -> Range<f64> {
    let (low, high) = values.filter(|v| v.is_finite()).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    let room = if high > low { room * (high - low) } else { 0.5 * high.abs().max(0.1) };
    low - room..high + room
}

/// About `count` round values in a range.
pub(super) fn ticks(range: &Range<f64>, count: usize) -> Vec<f64> {
    let step = step(range, count);
    let (first, last) = ((range.start / step).ceil() as i64, (range.end / step).floor() as i64);
    (first..=last).map(|i| i as f64 * step).collect()
}

fn step(range: &Range<f64>, count: usize) -> f64 {
    let rough = (range.end - range.start) / count as f64;
    let decade = 10f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|s| s * decade).into_iter().find(|&s| s >= rough).unwrap_or(decade)
}

/// Decimals that distinguish the ticks.
pub(super) fn digits(ticks: &[f64]) -> usize {
    let step = ticks.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    if step.is_finite() { (-(step * 1.001).log10().floor()).clamp(0.0, 9.0) as usize } else { 1 }
}

pub(super) fn label(value: f64, digits: usize) -> String {
    if value.abs() >= 1e7 || (value != 0.0 && digits > 5) {
        return with_exponent(value);
    }
    let text = grouped(&format!("{value:.digits$}"));
    // Writes -0 as 0.
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') { text.replace('-', "") } else { text }
}

/// A number with three significant digits as text: "0", "0.002", "9,000"; beyond that "10⁻⁵" and
/// "2.5·10⁹".
fn human(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(0.9999e-4..0.9999e7).contains(&size) {
        return with_exponent(value);
    }
    let digits = if size == 0.0 { 0 } else { (2.0 - (size * 1.0001).log10().floor()).clamp(0.0, 9.0) as usize };
    trimmed(grouped(&format!("{value:.digits$}")))
}

/// "10⁻⁵", "2.5·10⁹".
fn with_exponent(value: f64) -> String {
    let text = format!("{value:.1e}");
    let Some((factor, exponent)) = text.split_once('e') else { return text };
    let raised = |digit: char| match digit {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        // The code points of 4 to 9 are contiguous.
        _ => digit.to_digit(10).and_then(|n| char::from_u32('⁰' as u32 + n)).unwrap_or(digit),
    };
    let power: String = exponent.chars().map(raised).collect();
    match trimmed(factor.to_owned()).as_str() {
        "1" => format!("10{power}"),
        "-1" => format!("-10{power}"),
        factor => format!("{factor}·10{power}"),
    }
}

/// Inserts a comma before each group of three digits in front of the decimal point.
pub(crate) fn grouped(text: &str) -> String {
    let (whole, rest) = text.find('.').map_or((text, ""), |point| text.split_at(point));
    let (sign, digits) = whole.strip_prefix('-').map_or(("", whole), |digits| ("-", digits));
    let mut written = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            written.push(',');
        }
        written.push(digit);
    }
    format!("{sign}{written}{rest}")
}

fn trimmed(text: String) -> String {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_labels_short() {
        assert_eq!(ticks(&(-0.3..1.1), 7).len(), 7);
        assert_eq!((label(-0.0001, 2), label(0.25, 2), digits(&[0.0, 0.05, 0.1])), ("0.00".into(), "0.25".into(), 2));
        assert_eq!(
            (label(2.5e9, 0), label(1e-7, 7), label(0.0, 7)),
            ("2.5·10⁹".into(), "10⁻⁷".into(), "0.0000000".into())
        );
        let log = Scale::Logarithmic;
        let labels = |range: Range<f64>| log.ticks(&range).into_iter().map(|t| log.label(t, 0)).collect::<Vec<_>>();
        assert_eq!(labels(-1.0..1.0)[1..5], ["0.2", "0.5", "1", "2"]);
        assert_eq!(labels(-5.1..-0.9), ["10⁻⁵", "0.0001", "0.001", "0.01", "0.1"]);
        assert_eq!(label(12_000.0, 0), "12,000");
        assert!(labels(-30.0..30.0).len() <= 9);
    }

    #[test]
    fn numbers_are_written_as_people_write_them() {
        for (value, expected) in [
            (0.0, "0"),
            (1e-3, "0.001"),
            (5e-4, "0.0005"),
            (0.25, "0.25"),
            (9000.0, "9,000"),
            (1_234_567.0, "1,234,567"),
            (2e-5, "2·10⁻⁵"),
            (1e-10, "10⁻¹⁰"),
            (4.6e8, "4.6·10⁸"),
            (-1500.0, "-1,500"),
        ] {
            assert_eq!(human(value), expected);
        }
    }
}
