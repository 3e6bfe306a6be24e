//! The figures of a study: quality against count, quality and count over steps and time, differences
//! from the baseline, and the effects of factors.

use crate::result::mean;
use gs_core::counted;

use super::figure::{Axis, Bar, Dots, Figure, FigurePoint, Marks, Series};
use crate::{
    result::{Metric, Reach, Results},
    run::Finished,
    study::{Matching, Run},
};

/// Points of a curve over time.
const TIMES: usize = 48;

/// PSNR against the number of Gaussians at the end, one point per budget.
pub(crate) fn quality_over_count(results: &Results<'_>) -> Figure {
    let budgets = &results.plan.study.budgets;
    let series = each_arm(results, Dots::All, |arm| {
        budgets
            .iter()
            .filter_map(|&budget| {
                let count = results.spread(arm, budget, |run| Some(f64::from(run.gaussians)))?.mean;
                point(results, arm, budget, count, |_, end| Some(end.psnr))
            })
            .collect()
    });
    Figure {
        name: "quality-over-count".to_owned(),
        title: "Quality against count".to_owned(),
        x: Axis::logarithmic("Gaussians at the end"),
        y: Axis::linear("PSNR, dB"),
        marks: Marks::Lines(series),
    }
}

/// What a curve shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quantity {
    Psnr,
    Count,
}

/// What a curve is drawn against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Along {
    Steps,
    Time,
}

/// The four figures of how quality and count develop in the runs of a budget.
pub(crate) fn developments(results: &Results<'_>, budget: u32) -> impl Iterator<Item = Figure> {
    let all = [
        ("quality-over-time", Quantity::Psnr, Along::Time),
        ("quality-over-steps", Quantity::Psnr, Along::Steps),
        ("growth", Quantity::Count, Along::Steps),
        ("growth-over-time", Quantity::Count, Along::Time),
    ];
    all.into_iter().map(move |(name, quantity, along)| development(results, budget, name, quantity, along))
}

/// Quality or count against the steps of the optimizer, or against training time on each arm's time
/// scale: see [`Reach`].
fn development(results: &Results<'_>, budget: u32, name: &str, quantity: Quantity, along: Along) -> Figure {
    let reach = Reach::of_targets(results, budget);
    let series = each_arm(results, Dots::Last, |arm| {
        let places = match along {
            Along::Steps => steps(results, arm, budget),
            Along::Time => times(results, arm, budget, &reach),
        };
        let value = |run: &Run, end: &Finished, place: f64| match (quantity, along) {
            (Quantity::Psnr, Along::Steps) => end.psnr_after(place as u32, None),
            (Quantity::Psnr, Along::Time) => reach[run.target].psnr_within(place, run.arm, end, None),
            (Quantity::Count, Along::Steps) => end.count_at(place, |row| f64::from(row.step)),
            (Quantity::Count, Along::Time) => reach[run.target].count_within(place, run.arm, end),
        };
        let points = places.into_iter();
        points.filter_map(|place| point(results, arm, budget, place, |run, end| value(run, end, place))).collect()
    });
    let (what, y) = match quantity {
        Quantity::Psnr => ("Quality", Axis::linear("PSNR, dB")),
        Quantity::Count => ("Growth", Axis::linear("Gaussians")),
    };
    let (against, x) = match along {
        Along::Steps => ("steps", Axis::linear("step of the optimizer")),
        Along::Time => ("time", Axis::logarithmic(format!("training time, {}", results.plan.study.clock.unit()))),
    };
    Figure {
        name: format!("{name}-{budget}"),
        title: format!("{what} against {against}, at most {}", counted(budget, "Gaussian")),
        x,
        y,
        marks: Marks::Lines(series),
    }
}

/// The steps of an arm's rows.
fn steps(results: &Results<'_>, arm: usize, budget: u32) -> Vec<f64> {
    let first = results.finished(arm, budget).next().into_iter();
    first.flat_map(|(_, run)| run.trajectory.iter().map(|row| f64::from(row.step))).collect()
}

/// Times from the first measurement to the end of an arm's runs, s.
fn times(results: &Results<'_>, arm: usize, budget: u32, reach: &[Reach]) -> Vec<f64> {
    let measured = |run: &Finished| run.trajectory.iter().find(|row| row.psnr.is_some()).map(|row| row.seconds);
    let firsts = results.finished(arm, budget).filter_map(|(_, end)| measured(end));
    let first = firsts.fold(0.0f64, f64::max).max(1e-4);
    let last = mean(reach.iter().filter_map(|reach| reach.seconds_of(arm)));
    if last.is_nan() || last <= first {
        return Vec::new();
    }
    (0..TIMES).map(|i| first * (last / first).powf(i as f64 / (TIMES - 1) as f64)).collect()
}

/// The difference of each arm from the baseline, in PSNR.
pub(crate) fn differences(results: &Results<'_>, matching: Matching) -> Figure {
    let study = &results.plan.study;
    let baseline = study.baseline_arm();
    let mut bars = Vec::new();
    for &budget in &study.budgets {
        for arm in (0..study.arms.len()).filter(|&arm| arm != baseline) {
            let difference = results.difference(matching, Metric::Psnr, budget, arm, baseline);
            let Some(mean) = difference.mean else { continue };
            let (interval, is_judged) = (difference.interval, difference.obstacle().is_none());
            let label = format!("{}, {budget}", study.arms[arm].name);
            bars.push(Bar { style: arm, label, mean, interval, is_judged });
        }
    }
    Figure {
        name: format!("differences-at-equal-{}", matching.name()),
        title: format!("PSNR less that of {}, at equal {}", study.arms[baseline].name, matching.name()),
        x: Axis::linear("difference in PSNR, dB: mean and 95 % interval"),
        y: Axis::linear(""),
        marks: Marks::Intervals(bars),
    }
}

/// The effects of the study's factors on PSNR.
pub(crate) fn effects(results: &Results<'_>, matching: Matching) -> Figure {
    let effects = results.effects(&[matching]);
    let of_psnr = effects.iter().filter(|effect| effect.metric == Metric::Psnr);
    let bars = of_psnr.enumerate().filter_map(|(style, effect)| {
        let (mean, interval) = (effect.mean?, effect.interval);
        Some(Bar { style, label: effect.of.label(), mean, interval, is_judged: effect.obstacle().is_none() })
    });
    Figure {
        name: format!("effects-at-equal-{}", matching.name()),
        title: format!("Effects on PSNR, at equal {}", matching.name()),
        x: Axis::linear("effect on PSNR, dB: mean and 95 % interval"),
        y: Axis::linear(""),
        marks: Marks::Intervals(bars.collect()),
    }
}

fn each_arm(results: &Results<'_>, dots: Dots, points: impl Fn(usize) -> Vec<FigurePoint>) -> Vec<Series> {
    let arms = results.plan.study.arms.iter().enumerate();
    arms.map(|(arm, of)| Series { style: arm, name: of.name.clone(), points: points(arm), dots }).collect()
}

/// The mean over images or scenes and seeds, with the lowest and the highest seed as band.
fn point(
    results: &Results<'_>,
    arm: usize,
    budget: u32,
    x: f64,
    of: impl Fn(&Run, &Finished) -> Option<f64>,
) -> Option<FigurePoint> {
    let values: Vec<(&Run, f64)> =
        results.finished(arm, budget).filter_map(|(run, end)| Some((run, of(run, end)?))).collect();
    // The runs are ordered by seed.
    let of_seeds = values.chunk_by(|a, b| a.0.seed == b.0.seed);
    let whole = of_seeds.filter(|of_seed| of_seed.len() == results.plan.targets.len());
    let seeds: Vec<f64> = whole.map(|of_seed| mean(of_seed.iter().map(|value| value.1))).collect();
    let y = mean(&seeds);
    let (low, high) = seeds.iter().fold((y, y), |(low, high), &v| (low.min(v), high.max(v)));
    (y.is_finite() && x.is_finite()).then_some(FigurePoint { x, y, low, high })
}
