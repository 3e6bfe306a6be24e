//! A claim with its verdict, which follows from conditions that are counted over many cases.

use std::fmt;

use gs_core::counted;

use super::export::csv_row;

/// Significant digits of a number in a sentence.
const DIGITS: usize = 4;

/// A claim, with what was measured.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Claim {
    /// Short name, in kebab-case, unique within a study or an experiment.
    pub(crate) name: String,
    /// What is claimed.
    pub(crate) statement: String,
    /// Where it is claimed, such as sections of a paper.
    pub(crate) section: String,
    /// The conditions that the verdict is computed from.
    pub(crate) circumstances: Vec<Circumstance>,
    /// The measurement in words and numbers.
    pub(crate) measured: String,
    /// The numbers behind the claim.
    pub(crate) numbers: Vec<Number>,
}

impl Claim {
    /// The verdict that follows from the circumstances.
    pub(crate) fn verdict(&self) -> ClaimVerdict {
        ClaimVerdict::of(&self.circumstances)
    }
}

/// A condition of a claim, counted over all cases: seeds, angles, targets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Circumstance {
    /// The condition, such as "600 Gaussians are reached".
    pub(crate) what: String,
    /// Number of cases in which the circumstance holds.
    pub(crate) held: usize,
    /// Number of cases. Without any case the condition does not hold.
    pub(crate) of: usize,
}

impl Circumstance {
    /// A condition counted over many cases.
    pub(crate) fn counted(what: impl Into<String>, each: impl IntoIterator<Item = bool>) -> Self {
        let (held, of) = each.into_iter().fold((0, 0), |(held, of), holds| (held + usize::from(holds), of + 1));
        Self { what: what.into(), held, of }
    }

    /// The verdict: confirmed if the circumstance holds in all cases, refuted if in none.
    pub(crate) fn verdict(&self) -> ClaimVerdict {
        match self.held {
            0 => ClaimVerdict::Refuted,
            held if held == self.of => ClaimVerdict::Confirmed,
            _ => ClaimVerdict::Partly,
        }
    }
}

impl fmt::Display for Circumstance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.of {
            1 => f.write_str(&self.what),
            of => write!(f, "{}: {} of {of}", self.what, self.held),
        }
    }
}

gs_core::choices! {
    /// The verdict on a claim.
    pub(crate) enum ClaimVerdict {
        /// All circumstances hold in all cases.
        Confirmed = "confirmed",
        /// Some circumstances hold, or hold in some cases.
        Partly = "partly",
        /// No circumstance holds in any case.
        Refuted = "refuted",
    }
}

impl ClaimVerdict {
    /// The verdict that follows from the circumstances. Without circumstances nothing is confirmed.
    pub(crate) fn of(circumstances: &[Circumstance]) -> Self {
        let all = |verdict| circumstances.iter().all(|circumstance| circumstance.verdict() == verdict);
        if all(Self::Refuted) {
            Self::Refuted
        } else if all(Self::Confirmed) {
            Self::Confirmed
        } else {
            Self::Partly
        }
    }
}

/// A measured number.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Number {
    /// What was measured.
    pub(crate) what: String,
    /// The value.
    pub(crate) value: f64,
    /// The unit, such as "dB"; empty for a pure number.
    pub(crate) unit: String,
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        write!(f, "{}: {}{unit}", self.what, in_words(self.value))
    }
}

/// A whole number as it is, any other with [`DIGITS`].
pub(super) fn in_words(value: f64) -> String {
    let is_whole = value.fract() == 0.0 && value.abs() < 1e6;
    if is_whole { format!("{value}") } else { significant(value, DIGITS) }
}

/// "3 claims: 2 confirmed, 1 partly".
pub(crate) fn verdicts<'a>(claims: impl IntoIterator<Item = &'a Claim>) -> String {
    let verdicts: Vec<_> = claims.into_iter().map(Claim::verdict).collect();
    let of =
        ClaimVerdict::ALL.into_iter().map(|verdict| (verdicts.iter().filter(|&&of| of == verdict).count(), verdict));
    let words: Vec<String> = of.filter(|(n, _)| *n > 0).map(|(n, verdict)| format!("{n} {verdict}")).collect();
    format!("{}: {}", counted(verdicts.len(), "claim"), words.join(", "))
}

/// All claims of some experiments or studies with their verdicts as CSV: a row for each circumstance,
/// with how often it holds, and one for each number.
pub(crate) fn claims_csv<'a>(groups: impl IntoIterator<Item = (&'a str, &'a [Claim])>) -> String {
    let mut csv = "experiment,claim,section,verdict,number,value,unit\n".to_owned();
    for (experiment, claim) in
        groups.into_iter().flat_map(|(name, claims)| claims.iter().map(move |claim| (name, claim)))
    {
        let verdict = claim.verdict().to_string();
        let circumstances = claim.circumstances.iter();
        let circumstances = circumstances.map(|c| (&c.what, c.held.to_string(), format!("of {}", c.of)));
        let numbers = claim.numbers.iter().map(|number| (&number.what, number.value.to_string(), number.unit.clone()));
        for (what, value, unit) in circumstances.chain(numbers) {
            csv += &csv_row([experiment, &claim.name, &claim.section, &verdict, what, &value, &unit]);
        }
    }
    csv
}

/// A number with `digits` significant digits, in plain notation where that is short and as a power
/// of ten otherwise.
pub fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let exponent = value.abs().log10().floor() as i32;
    match exponent {
        -4..=5 => format!("{value:.*}", (digits as i32 - 1 - exponent).max(0) as usize),
        _ => format!("{value:.*e}", digits.saturating_sub(1)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_is_what_its_circumstances_come_to() {
        let counted = |held: usize, of: usize| Circumstance::counted("c", (0..of).map(|i| i < held));
        let cases = [
            (vec![counted(3, 3), counted(1, 1)], ClaimVerdict::Confirmed),
            (vec![counted(3, 3), counted(0, 1)], ClaimVerdict::Partly),
            (vec![counted(1, 3)], ClaimVerdict::Partly),
            (vec![counted(0, 3), counted(0, 0)], ClaimVerdict::Refuted),
            (vec![counted(3, 3), counted(0, 0)], ClaimVerdict::Partly),
            (vec![], ClaimVerdict::Refuted),
        ];
        for (circumstances, expected) in cases {
            assert_eq!(ClaimVerdict::of(&circumstances), expected, "{circumstances:?}");
        }
        assert_eq!(counted(1, 3).to_string(), "c: 1 of 3");
    }
}
