//! The claims of a study, judged by its runs.

use std::collections::BTreeMap;

use super::{
    claim::{self, Circumstance, Claim, Number},
    statistics::{FEWEST, Interval, bootstrap_interval, mean, median},
    tables::Results,
};
use crate::{
    run::{Finished, RunOutcome},
    study::{ArmSettings, Choice, Column, Join, Other, Per, Quantity, Run, StatedClaim},
};

/// A budget, an image and a seed, by their indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Case {
    budget: usize,
    target: usize,
    seed: usize,
}

/// What cases that belong together have in common.
type Key = [Option<usize>; 3];

impl Results<'_> {
    /// The study's claims, judged by the runs that have ended.
    pub(crate) fn claims(&self) -> Vec<Claim> {
        self.plan.study.claims.iter().map(|claim| self.judged(claim)).collect()
    }

    fn judged(&self, claim: &StatedClaim) -> Claim {
        let circumstance = |condition: &Quantity| {
            let holding = self.holding(condition);
            Circumstance::counted(&condition.what, holding.into_values())
        };
        let numbers: Vec<Vec<Number>> = claim.numbers.iter().map(|number| self.numbers(number)).collect();
        let words: Vec<String> = numbers.iter().filter(|of| !of.is_empty()).map(|of| in_words(of)).collect();
        let words = if words.is_empty() { String::new() } else { words.join("; ") + ". " };
        Claim {
            name: claim.name.clone(),
            statement: claim.statement.clone(),
            section: claim.section.clone(),
            circumstances: claim.circumstances.iter().map(circumstance).collect(),
            measured: words + &claim.note,
            numbers: numbers.concat(),
        }
    }

    /// Whether a condition holds, for each group of cases that it is about.
    fn holding(&self, condition: &Quantity) -> BTreeMap<Key, bool> {
        let allowed = |value: &f64| condition.allows(*value);
        let holds = |values: Vec<f64>| match condition.join {
            Join::Every => values.iter().all(allowed),
            Join::Some => values.iter().any(allowed),
            Join::Interval => interval(&values).is_some_and(|i| allowed(&i.low) && allowed(&i.high)),
            join => allowed(&joined(join, &values)),
        };
        let mut holding: BTreeMap<Key, bool> =
            self.groups(condition).into_iter().map(|(key, of)| (key, holds(of))).collect();
        for other in condition.and.iter().map(|other| self.holding(other)) {
            holding.iter_mut().for_each(|(key, holds)| *holds &= other.get(key).copied().unwrap_or(false));
        }
        for other in condition.given.iter().map(|other| self.holding(other)) {
            holding.retain(|key, _| other.get(key).copied().unwrap_or(false));
        }
        holding
    }

    /// A number of a claim, with the ends of its interval if it has one; nothing without runs.
    fn numbers(&self, number: &Quantity) -> Vec<Number> {
        let values: Vec<f64> = self.groups(number).into_values().map(|values| joined(number.join, &values)).collect();
        let named = |what: String, value: f64| Number { what, value, unit: number.unit.clone() };
        let value = joined(number.take, &values);
        if values.is_empty() || value.is_nan() {
            return Vec::new();
        }
        let interval = if number.take == Join::Interval { interval(&values) } else { None };
        let ends = interval.map(|interval| [("from", interval.low), ("to", interval.high)]);
        let ends = ends.into_iter().flatten().map(|(end, value)| named(format!("its 95 % interval, {end}"), value));
        std::iter::once(named(number.what.clone(), value)).chain(ends).collect()
    }

    /// The values of the cases that belong together. Cases that lack a run are left out; a run that
    /// failed has NaN.
    fn groups(&self, quantity: &Quantity) -> BTreeMap<Key, Vec<f64>> {
        let study = &self.plan.study;
        let mut groups: BTreeMap<Key, Vec<f64>> = BTreeMap::new();
        for (seed, target) in
            (0..study.seeds.len()).flat_map(|seed| (0..study.images.len()).map(move |target| (seed, target)))
        {
            if !quantity.images.is_empty() && !quantity.images.contains(&study.images[target]) {
                continue;
            }
            for case in (0..study.budgets.len()).map(|budget| Case { budget, target, seed }) {
                let Some(value) = self.value(quantity, case) else { continue };
                let key = match quantity.per {
                    Per::Run => [Some(case.budget), Some(target), Some(seed)],
                    Per::Image => [Some(case.budget), Some(target), None],
                    Per::Seed => [Some(case.budget), None, Some(seed)],
                    Per::Study => [None; 3],
                };
                groups.entry(key).or_default().push(value);
            }
        }
        groups
    }

    /// The value in a case; `None` where a run is missing.
    fn value(&self, quantity: &Quantity, case: Case) -> Option<f64> {
        let value = self.column(&quantity.arm, quantity.of, quantity.at, case)?;
        let other = |other: &Other| {
            let own = std::slice::from_ref(&quantity.arm);
            let arms = if other.arms.is_empty() { own } else { &other.arms };
            let (of, at) = (other.of.unwrap_or(quantity.of), other.at.or(quantity.at));
            let values = arms.iter().map(|arm| self.column(arm, of, at, case));
            values.collect::<Option<Vec<f64>>>().map(|values| joined(Join::Highest, &values))
        };
        let value = match &quantity.less {
            // Equal values differ by 0, even if both are infinite.
            Some(less) => match other(less)? {
                less if less == value => 0.0,
                less => value - less,
            },
            None => value,
        };
        Some(match &quantity.over {
            Some(over) => value / other(over)?,
            None => value,
        })
    }

    /// A column of the run of an arm or a choice in a case; NaN where the run does not have it, and
    /// `None` where there is no run.
    fn column(&self, arm: &str, of: Column, at: Option<f64>, case: Case) -> Option<f64> {
        let study = &self.plan.study;
        let index = match study.choices.iter().find(|choice| choice.name == arm) {
            Some(choice) => {
                let place = self.chosen(choice, case)?;
                if of == Column::Place {
                    return Some(place as f64);
                }
                let Some(place) = place.checked_sub(1) else { return Some(f64::NAN) };
                study.arms.iter().position(|arm| arm.name == choice.among[place])?
            }
            None => study.arms.iter().position(|known| known.name == arm)?,
        };
        let (run, outcome) = self.outcome(index, case)?;
        Some(match (of, outcome) {
            (Column::Failed, outcome) => f64::from(u8::from(outcome.finished().is_none())),
            (_, RunOutcome::Failed { .. }) => f64::NAN,
            (of, RunOutcome::Finished(end)) => of_run(of, at, run, end),
        })
    }

    /// The place of the chosen arm in the list of a choice, counted from 1; 0 if no arm meets its
    /// bound, and `None` where a run is missing.
    fn chosen(&self, choice: &Choice, case: Case) -> Option<usize> {
        let study = &self.plan.study;
        let target = match &choice.image {
            Some(image) => study.images.iter().position(|known| known == image)?,
            None => case.target,
        };
        let values = choice.among.iter().map(|arm| self.column(arm, choice.of, None, Case { target, ..case }));
        let values = values.collect::<Option<Vec<f64>>>()?;
        Some(values.iter().rposition(|&value| value >= choice.at_least).map_or(0, |index| index + 1))
    }

    fn outcome(&self, arm: usize, case: Case) -> Option<(&Run, &RunOutcome)> {
        let study = &self.plan.study;
        let place = (case.seed * study.budgets.len() + case.budget) * self.plan.targets.len() + case.target;
        let index = place * study.arms.len() + arm;
        Some((&self.plan.runs[index], &self.records[index].as_ref()?.outcome))
    }
}

/// The interval of the mean of values, of which it needs as many as that of a difference between arms.
fn interval(values: &[f64]) -> Option<Interval> {
    if values.len() < FEWEST { None } else { bootstrap_interval(values) }
}

/// A number in words, with its interval if it has one.
fn in_words(number: &[Number]) -> String {
    match number {
        [number, low, high] => {
            let [low, high] = [low, high].map(|end| claim::in_words(end.value));
            format!("{number} (95 % interval {low} to {high})")
        }
        numbers => numbers.iter().map(Number::to_string).collect(),
    }
}

/// Values as one; NaN of none and, except for a sum, where one is NaN.
fn joined(join: Join, values: &[f64]) -> f64 {
    let fold = |pick: fn(f64, f64) -> f64| match values.iter().any(|value| value.is_nan()) {
        true => f64::NAN,
        false => values.iter().copied().reduce(pick).unwrap_or(f64::NAN),
    };
    match join {
        Join::Mean | Join::Interval | Join::Every | Join::Some => mean(values),
        Join::Median => median(values),
        Join::Lowest => fold(f64::min),
        Join::Highest => fold(f64::max),
        Join::Sum => values.iter().sum(),
    }
}

/// A column of a finished run; NaN where the run does not have it.
fn of_run(of: Column, at: Option<f64>, run: &Run, end: &Finished) -> f64 {
    let rows = &end.trajectory;
    let row = at.and_then(|share| {
        let step = share * f64::from(end.iterations);
        let after = rows.partition_point(|row| f64::from(row.step) <= step);
        rows.get(after.saturating_sub(1))
    });
    let grows = |index: usize| rows[index].count > rows[index - 1].count;
    match of {
        Column::Gaussians => f64::from(row.map_or(end.gaussians, |row| row.count)),
        Column::Psnr => row.map_or(Some(end.psnr), |row| end.psnr_after(row.step, None)).unwrap_or(f64::NAN),
        Column::Ssim => end.ssim,
        Column::Loss => row.map(|row| row.loss).or(end.loss).map_or(f64::NAN, f64::from),
        Column::LnLoss => of_run(Column::Loss, at, run, end).ln(),
        Column::StepAtBudget => {
            rows.iter().find(|row| row.count >= run.budget).map_or(end.iterations, |row| row.step).into()
        }
        Column::LastGrowth => (1..rows.len()).rev().find(|&i| grows(i)).map_or(0, |i| rows[i].step).into(),
        Column::SlopeChange => match &run.settings {
            ArmSettings::Image(settings) => mean(slope_changes(end, settings.rounds.every / 2)),
            ArmSettings::Scene(_) => f64::NAN,
        },
        Column::Failed => 0.0,
        _ => end.measured.get(&of).copied().unwrap_or(f64::NAN),
    }
}

/// For each round of growth the slope of ln loss per 100 steps over the rows of `window` steps after
/// it, less that over the rows of as many steps before it. A row has the loss before its step, so
/// that of the round's own row is the last before the round.
fn slope_changes(end: &Finished, window: u32) -> Vec<f64> {
    let rows = &end.trajectory;
    let slope = |from: u32, to: u32| {
        let mut within = rows.iter().filter(|row| (from..=to).contains(&row.step));
        let (first, last) = (within.next()?, within.next_back()?);
        let fall = f64::from(last.loss).ln() - f64::from(first.loss).ln();
        Some(100.0 * fall / f64::from(last.step - first.step))
    };
    let rounds = rows.windows(2).filter(|pair| pair[1].count > pair[0].count).map(|pair| pair[1].step);
    let change = |step: u32| Some(slope(step + 1, step + window)? - slope(step.saturating_sub(window), step)?);
    rounds.filter_map(change).collect()
}
