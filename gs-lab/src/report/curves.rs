//! The figures of a study: quality against count and time, growth over steps, differences from the
//! baseline.

use crate::statistics::mean;
use gs_core::counted;

use crate::{
    figure::{Axis, Bar, Dots, Figure, FigurePoint, Marks, Series},
    plan::Run,
    reach::Reach,
    record::Finished,
    study::Matching,
    tables::{Metric, Results},
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

/// PSNR against fitting time, on each arm's time scale: see [`Reach`].
pub(crate) fn quality_over_time(results: &Results<'_>, budget: u32) -> Figure {
    let reach = Reach::of_images(results, budget);
    let series = each_arm(results, Dots::Last, |arm| {
        let measured = |run: &Finished| run.trajectory.iter().find(|row| row.psnr.is_some()).map(|row| row.seconds);
        let firsts = results.finished(arm, budget).filter_map(|(_, end)| measured(end));
        let first = firsts.fold(0.0f64, f64::max).max(1e-4);
        let last = mean(reach.iter().filter_map(|reach| reach.seconds_of(arm)));
        if last.is_nan() || last <= first {
            return Vec::new();
        }
        let time = |i: usize| first * (last / first).powf(i as f64 / (TIMES - 1) as f64);
        let psnr = |run: &Run, end: &Finished, seconds: f64| reach[run.target].psnr_within(seconds, run, end);
        (0..TIMES).filter_map(|i| point(results, arm, budget, time(i), |run, end| psnr(run, end, time(i)))).collect()
    });
    Figure {
        name: format!("quality-over-time-{budget}"),
        title: format!("Quality against time, at most {}", counted(budget, "Gaussian")),
        x: Axis::logarithmic("time spent fitting, s"),
        y: Axis::linear("PSNR, dB"),
        marks: Marks::Lines(series),
    }
}

/// The number of Gaussians over the steps of the optimizer.
pub(crate) fn growth(results: &Results<'_>, budget: u32) -> Figure {
    let series = each_arm(results, Dots::Last, |arm| {
        let steps: Vec<u32> = results
            .finished(arm, budget)
            .next()
            .into_iter()
            .flat_map(|(_, run)| run.trajectory.iter().map(|r| r.step))
            .collect();
        let count = |run: &Finished, step: u32| {
            let before = run.trajectory.partition_point(|row| row.step <= step);
            run.trajectory.get(before.checked_sub(1)?).map(|row| f64::from(row.count))
        };
        steps
            .into_iter()
            .filter_map(|step| point(results, arm, budget, f64::from(step), |_, end| count(end, step)))
            .collect()
    });
    Figure {
        name: format!("growth-{budget}"),
        title: format!("Growth, at most {}", counted(budget, "Gaussian")),
        x: Axis::linear("step of the optimizer"),
        y: Axis::linear("Gaussians"),
        marks: Marks::Lines(series),
    }
}

/// The difference of each arm from the baseline, in PSNR.
pub(crate) fn differences(results: &Results<'_>, matching: Matching) -> Figure {
    let study = &results.plan.study;
    let baseline = study.baseline_arm();
    let mut bars = Vec::new();
    for &budget in &study.budgets {
        for arm in (0..study.arms.len()).filter(|&arm| arm != baseline) {
            let difference = results.difference(matching, Metric::Psnr, budget, arm, baseline);
            let (Some(mean), Some(interval)) = (difference.mean, difference.interval) else { continue };
            let label = format!("{}, {budget}", study.arms[arm].name);
            bars.push(Bar { style: arm, label, mean, interval, is_judged: difference.obstacle().is_none() });
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

fn each_arm(results: &Results<'_>, dots: Dots, points: impl Fn(usize) -> Vec<FigurePoint>) -> Vec<Series> {
    let arms = results.plan.study.arms.iter().enumerate();
    arms.map(|(arm, of)| Series { style: arm, name: of.name.clone(), points: points(arm), dots }).collect()
}

/// The mean over images and seeds, with the lowest and the highest seed as band.
fn point(
    results: &Results<'_>,
    arm: usize,
    budget: u32,
    x: f64,
    of: impl Fn(&Run, &Finished) -> Option<f64>,
) -> Option<FigurePoint> {
    let values: Vec<(&Run, f64)> =
        results.finished(arm, budget).filter_map(|(run, end)| Some((run, of(run, end)?))).collect();
    let of_seed = |seed: u32| {
        let values: Vec<f64> = values.iter().filter(|(run, _)| run.seed == seed).map(|v| v.1).collect();
        (values.len() == results.plan.targets.len()).then(|| mean(&values))
    };
    let seeds: Vec<f64> = results.plan.study.seeds.iter().filter_map(|&seed| of_seed(seed)).collect();
    let y = mean(&seeds);
    let (low, high) = seeds.iter().fold((y, y), |(low, high), &v| (low.min(v), high.max(v)));
    (y.is_finite() && x.is_finite()).then_some(FigurePoint { x, y, low, high })
}
