//! Axes of a figure: the span of the values, round ticks and short labels.

use std::ops::Range;

use plotters::{
    coord::{
        ranged1d::{DefaultFormatting, KeyPointHint},
        types::RangedCoordf64,
    },
    prelude::Ranged,
};

use crate::figure::Scale;

/// A linear axis with its ticks where they are wanted. Logarithmic axes are linear ones of logarithms.
pub(super) struct Ticked {
    axis: RangedCoordf64,
    ticks: Vec<f64>,
}

impl Ticked {
    pub(super) fn new(range: Range<f64>, ticks: Vec<f64>) -> Self {
        Self { axis: range.into(), ticks }
    }
}

impl Ranged for Ticked {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.axis.map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.axis.range()
    }
}

impl Scale {
    /// Where a value stands on the axis; nothing where it stands nowhere.
    pub(super) fn place(self, value: f64) -> Option<f64> {
        match self {
            Self::Linear => Some(value),
            Self::Logarithmic => (value > 0.0).then(|| value.log10()),
        }
        .filter(|place| place.is_finite())
    }

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
                // Of very many decades every second, third, ….
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
            Self::Logarithmic => {
                let value = 10f64.powf(place);
                if !(1e-3..1e6).contains(&value) {
                    return short_exponent(value);
                }
                let digits = (1.0 - value.log10().floor()).clamp(0.0, 9.0) as usize;
                trimmed(format!("{value:.digits$}"))
            }
        }
    }
}

/// The span of the values with some room around them; never empty.
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

/// Digits behind the point that tell ticks apart.
pub(super) fn digits(ticks: &[f64]) -> usize {
    let step = ticks.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    if step.is_finite() { (-(step * 1.001).log10().floor()).clamp(0.0, 9.0) as usize } else { 1 }
}

pub(super) fn label(value: f64, digits: usize) -> String {
    if value.abs() >= 1e7 || (value != 0.0 && digits > 5) {
        return short_exponent(value);
    }
    let text = format!("{value:.digits$}");
    // -0 is 0.
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') { text.replace('-', "") } else { text }
}

/// "1e-5", "2.5e9".
fn short_exponent(value: f64) -> String {
    let text = format!("{value:.1e}");
    text.replacen(".0e", "e", 1)
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
            ("2.5e9".into(), "1e-7".into(), "0.0000000".into())
        );
        let log = Scale::Logarithmic;
        let labels = |range: Range<f64>| log.ticks(&range).into_iter().map(|t| log.label(t, 0)).collect::<Vec<_>>();
        assert_eq!(labels(-1.0..1.0)[1..5], ["0.2", "0.5", "1", "2"]);
        assert_eq!(labels(-5.1..-0.9), ["1e-5", "1e-4", "0.001", "0.01", "0.1"]);
        assert!(labels(-30.0..30.0).len() <= 9);
    }
}
