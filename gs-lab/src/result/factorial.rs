//! Effects of a factorial design: how much a factor changes the quality on average over the other
//! factors, and how much that depends on another factor.

use super::{
    contrast::{Cell, Contrast, Judged},
    tables::Results,
};
use crate::study::Matching;

/// The name of the factor that the study's budgets are.
const BUDGET: &str = "budget";

/// What an [`Effect`] is of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum EffectOf {
    /// A level of a factor less its first level: mean over all combinations of the other factors.
    Main {
        /// The factor.
        factor: String,
        /// The level.
        level: String,
        /// The first level.
        against: String,
    },
    /// By how much the effect of a level is greater at a level of another factor than at that
    /// factor's first level.
    Interaction {
        /// The factors.
        factors: [String; 2],
        /// Their levels.
        levels: [String; 2],
        /// Their first levels.
        against: [String; 2],
    },
}

impl EffectOf {
    /// The effect in words, for figures: "start: random" or "start: random × policy: mcmc".
    pub(crate) fn label(&self) -> String {
        match self {
            Self::Main { factor, level, .. } => format!("{factor}: {level}"),
            Self::Interaction { factors, levels, .. } => {
                format!("{}: {} × {}: {}", factors[0], levels[0], factors[1], levels[1])
            }
        }
    }
}

/// An effect in a factorial design, at equal count, iterations or time. It has a value if all
/// combinations have runs; better and worse are greater and less than 0.
pub(crate) type Effect = Judged<EffectOf>;

/// A factor with the names of its levels.
struct Axis {
    factor: String,
    levels: Vec<String>,
}

impl Results<'_> {
    /// All main effects, then all two-way interactions, at equal count, iterations or time as given.
    /// The study's budgets are the last factor, if there are several. None without factors.
    pub(crate) fn effects(&self, matchings: &[Matching]) -> Vec<Effect> {
        let axes = self.axes();
        let measures = self.measures(matchings);
        let contrasts = contrasts(&axes, &self.cells());
        let all = measures.into_iter().flat_map(|measure| contrasts.iter().map(move |contrast| (measure, contrast)));
        all.map(|((matching, metric), (of, contrast))| self.judge(of.clone(), contrast, matching, metric)).collect()
    }

    fn axes(&self) -> Vec<Axis> {
        let study = &self.plan.study;
        let names = |levels: &[crate::study::Arm]| levels.iter().map(|level| level.name.clone()).collect();
        let mut axes: Vec<Axis> =
            study.factors.iter().map(|f| Axis { factor: f.name.clone(), levels: names(&f.levels) }).collect();
        if !axes.is_empty() && study.budgets.len() > 1 {
            let levels = study.budgets.iter().map(ToString::to_string).collect();
            axes.push(Axis { factor: BUDGET.to_owned(), levels });
        }
        axes
    }

    /// All cells with their levels.
    fn cells(&self) -> Vec<(Cell, Vec<usize>)> {
        let study = &self.plan.study;
        let of_budget = |(level, &budget): (usize, &u32)| {
            let arms = study.arms.iter().enumerate();
            let of_arm = move |(arm, of): (usize, &crate::study::Arm)| {
                (Cell { arm, budget }, of.levels.iter().copied().chain([level]).collect())
            };
            arms.map(of_arm).collect::<Vec<_>>()
        };
        study.budgets.iter().enumerate().flat_map(of_budget).collect()
    }
}

/// The contrasts of all main effects and two-way interactions.
fn contrasts(axes: &[Axis], cells: &[(Cell, Vec<usize>)]) -> Vec<(EffectOf, Contrast)> {
    let mut all = Vec::new();
    for (a, axis) in axes.iter().enumerate() {
        for level in 1..axis.levels.len() {
            let of = EffectOf::Main {
                factor: axis.factor.clone(),
                level: axis.levels[level].clone(),
                against: axis.levels[0].clone(),
            };
            all.push((of, weighted(cells, 1, |levels| sign(levels[a], level))));
        }
    }
    for (a, one) in axes.iter().enumerate() {
        for (b, other) in axes.iter().enumerate().skip(a + 1) {
            for (i, j) in (1..one.levels.len()).flat_map(|i| (1..other.levels.len()).map(move |j| (i, j))) {
                let of = EffectOf::Interaction {
                    factors: [one.factor.clone(), other.factor.clone()],
                    levels: [one.levels[i].clone(), other.levels[j].clone()],
                    against: [one.levels[0].clone(), other.levels[0].clone()],
                };
                all.push((of, weighted(cells, 2, |levels| sign(levels[a], i) * sign(levels[b], j))));
            }
        }
    }
    all
}

/// 1 for the level, -1 for the first one, 0 for all others.
fn sign(found: usize, level: usize) -> f64 {
    match found {
        0 => -1.0,
        found if found == level => 1.0,
        _ => 0.0,
    }
}

/// The cells that have a sign, each weighted so that the contrast is a mean over the combinations of
/// the other factors, which have `plus` cells of sign 1 each.
fn weighted(cells: &[(Cell, Vec<usize>)], plus: usize, sign: impl Fn(&[usize]) -> f64) -> Contrast {
    let signed: Vec<(Cell, f64)> =
        cells.iter().map(|(cell, levels)| (*cell, sign(levels))).filter(|(_, sign)| *sign != 0.0).collect();
    let positive = signed.iter().filter(|(_, sign)| *sign > 0.0).count();
    Contrast(signed.into_iter().map(|(cell, sign)| (cell, sign * plus as f64 / positive as f64)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_means_over_the_other_factors() {
        let axis = |factor: &str, levels: &[&str]| Axis {
            factor: factor.to_owned(),
            levels: levels.iter().map(|&level| level.to_owned()).collect(),
        };
        let axes = [axis("a", &["a0", "a1"]), axis("b", &["b0", "b1", "b2"]), axis("budget", &["10", "20"])];
        let mut cells = Vec::new();
        for (level, budget) in [10, 20].into_iter().enumerate() {
            for (a, b) in (0..2).flat_map(|a| (0..3).map(move |b| (a, b))) {
                cells.push((Cell { arm: 3 * a + b, budget }, vec![a, b, level]));
            }
        }
        // 20 dB, 1 more with a1, 0.5 b, 3 more with the larger budget, and 2 more of a1 with b2.
        let quality = |cell: &Cell| {
            let (a, b) = (cell.arm / 3, cell.arm % 3);
            let together = if (a, b) == (1, 2) { 2.0 } else { 0.0 };
            20.0 + a as f64 + 0.5 * b as f64 + f64::from(cell.budget / 20) * 3.0 + together
        };
        let value = |contrast: &Contrast| contrast.0.iter().map(|(cell, weight)| weight * quality(cell)).sum::<f64>();
        let found: Vec<(String, f64)> = contrasts(&axes, &cells)
            .iter()
            .map(|(of, contrast)| match of {
                EffectOf::Main { level, .. } => (level.clone(), value(contrast)),
                EffectOf::Interaction { levels, .. } => (levels.join(" "), value(contrast)),
            })
            .collect();
        // By hand: a1 has 1, and 2 in one of three combinations; b2 has 1, and 2 in one of two.
        let expected = [
            ("a1", 1.0 + 2.0 / 3.0),
            ("b1", 0.5),
            ("b2", 1.0 + 2.0 / 2.0),
            ("20", 3.0),
            ("a1 b1", 0.0),
            ("a1 b2", 2.0),
            ("a1 20", 0.0),
            ("b1 20", 0.0),
            ("b2 20", 0.0),
        ];
        assert_eq!(found.len(), expected.len());
        for ((name, value), (expected_name, expected)) in found.iter().zip(expected) {
            assert!(name == expected_name && (value - expected).abs() < 1e-12, "{name}: {value}");
        }
    }
}
