//! The tables of the page: the quality of each arm, and differences from the baseline.

use gs_core::counted;
use maud::{Markup, html};

use crate::{
    report::page::{
        Page,
        words::{at_equal, capital, grouped, signed},
    },
    result::{Difference, FEWEST, FEWEST_SEEDS, Judged, Metric, ResultRemark, RunQuality, Spread, Verdict},
    study::Matching,
};

impl Page<'_> {
    pub(super) fn quality(&self) -> Markup {
        let qualities = self.results.qualities();
        let images = self.results.plan.targets.len();
        let seconds = |quality: &RunQuality| {
            let arm = self.results.plan.study.arms.iter().position(|arm| arm.name == quality.arm)?;
            self.results.spread(arm, quality.budget, |run| Some(run.seconds))
        };
        html! {
            section {
                h2 { "Quality" }
                p {
                    "Mean over " (self.targets()) " of means over seeds, at the end of the runs; ± is the standard deviation of a single run over seeds. "
                    "PSNR in dB, SSIM and MS-SSIM from 0 to 1, of the pictures as they are written in 8 bits"
                    @if self.results.plan.study.is_of_scenes() { ", each a mean over the held-out views" }
                    "; size is that of all parameters as 32-bit floats. Means are over finished runs."
                }
                div.wide { table {
                    thead { tr {
                        th { "budget" } th { "arm" } th.number { "Gaussians" } th.number { "size, kB" } th.number { "PSNR, dB" } th.number { "SSIM" }
                        th.number { "MS-SSIM" } th.number { "time, " (self.results.plan.study.clock.unit()) } th.number { "runs" }
                    } }
                    tbody {
                        @for (index, quality) in qualities.iter().enumerate() {
                            @let arm = index % self.results.plan.study.arms.len();
                            tr.first[arm == 0] {
                                td { @if arm == 0 { (grouped(quality.budget)) } }
                                td { (self.swatch(arm)) (quality.arm) }
                                td.number { (spread(quality.gaussians, 0)) }
                                td.number { @if let Some(bytes) = quality.bytes { (format!("{:.0}", bytes.mean / 1e3)) } @else { "–" } }
                                td.number { (spread(quality.psnr, 2)) }
                                td.number { (spread(quality.ssim, 4)) }
                                td.number { (spread(quality.ms_ssim, 4)) }
                                td.number { (spread(seconds(quality), 2)) }
                                td.number {
                                    (quality.finished)
                                    @if quality.failed > 0 { span.verdict.worse { " (" (quality.failed) " failed)" } }
                                    @if quality.missing > 0 { span.quiet { " (" (quality.missing) " missing)" } }
                                    @if quality.images < images {
                                        br; span.verdict.worse { "on " (quality.images) " of " (images) " " (self.targets()) " only" }
                                    }
                                }
                            }
                        }
                    }
                } }
            }
        }
    }

    pub(super) fn differences(&self) -> Markup {
        let study = &self.results.plan.study;
        let baseline = study.baseline_arm();
        let others: Vec<usize> = (0..study.arms.len()).filter(|&arm| arm != baseline).collect();
        let mut parts = Vec::new();
        for &matching in &study.matchings {
            let drawn = self.figure(&format!("differences-at-equal-{}", matching.name()));
            let second = self.second_metric(matching);
            let rows: Vec<(u32, usize)> =
                study.budgets.iter().flat_map(|&budget| others.iter().map(move |&arm| (budget, arm))).collect();
            let of = |metric: Metric, (budget, arm): (u32, usize)| {
                self.results.difference(matching, metric, budget, arm, baseline)
            };
            // What is the same for all rows is said once.
            let mut remarks = rows.iter().map(|&row| remark(&of(Metric::Psnr, row).remarks));
            let first = remarks.next().flatten().filter(|_| rows.len() > 1);
            let shared = first.filter(|first| remarks.all(|other| other.as_ref() == Some(first)));
            let own =
                |difference: &Difference| remark(&difference.remarks).filter(|text| shared.as_ref() != Some(text));
            parts.push(html! {
                h3 { (capital(at_equal(matching))) }
                @if let Some(shared) = &shared { p.quiet { "For every arm: " (shared) "." } }
                div.beside {
                    (drawn)
                    (table(&["budget", "arm"], second, rows.iter().map(|&row| {
                        let psnr = of(Metric::Psnr, row);
                        let name = html! {
                            td { (grouped(row.0)) }
                            td.name { (self.swatch(row.1)) (study.arms[row.1].name) }
                        };
                        (name, own(&psnr), psnr, second.map(|metric| of(metric, row)))
                    })))
                }
            });
        }
        html! {
            section {
                h2 { "Differences from " (study.arms[baseline].name) }
                p {
                    "Differences are paired "
                    @if study.is_of_scenes() { "held-out view by view" } @else { "image by image" }
                    ". Below each mean difference is its 95 % interval; an arm is better or worse if the whole interval lies on one side of 0, "
                    "and nobody can tell if it contains 0. Hollow marks have no verdict, for the reason that is given. Every other pair of arms is in " code { "differences.csv" } "."
                    @if study.is_of_scenes() && self.results.plan.targets.len() < FEWEST {
                        " " b { "Only " (counted(self.results.plan.targets.len(), "scene")) ": verdicts about other scenes need " (FEWEST) "." }
                        " Verdicts hold for other seeds and views of these scenes."
                    }
                    @if study.seeds.len() < FEWEST_SEEDS {
                        " " b { "Only " (counted(study.seeds.len(), "seed")) ": use " (FEWEST_SEEDS) " or more." } " A difference may be due to chance."
                    }
                }
                @for part in parts { (part) }
            }
        }
    }

    /// The metric beside PSNR; others are measured at the end of runs only.
    pub(super) fn second_metric(&self, matching: Matching) -> Option<Metric> {
        Some(Metric::MsSsim).filter(|&metric| matching == Matching::Count && self.results.is_measured(metric))
    }
}

/// A table of judged values. A row has the cells of its name, a remark in a row of its own, a value in
/// PSNR, and one in the second metric.
pub(super) fn table<Of>(
    names: &[&str],
    second: Option<Metric>,
    rows: impl Iterator<Item = (Markup, Option<String>, Judged<Of>, Option<Judged<Of>>)>,
) -> Markup {
    let columns = 3 + if second.is_some() { 2 } else { 0 };
    html! {
        div.wide { table.small {
            thead { tr {
                @for name in names { th { (name) } }
                th.number { "PSNR, dB" } th { }
                @if second.is_some() { th.number { "MS-SSIM" } th { } }
            } }
            tbody {
                @for (name, remark, psnr, other) in rows {
                    tr.remarked[remark.is_some()] {
                        (name)
                        (value_cells(&psnr, 2))
                        @if let Some(other) = other { (value_cells(&other, 4)) }
                    }
                    @if let Some(text) = remark {
                        tr.remark { @for _ in 1..names.len() { td {} } td.quiet colspan=(columns) { (text) } }
                    }
                }
            }
        } }
    }
}

/// Two cells: the mean with its interval, and the verdict.
fn value_cells<Of>(judged: &Judged<Of>, digits: usize) -> Markup {
    let Judged { mean, interval, verdict, .. } = judged;
    let class = match verdict {
        Verdict::Better => "verdict better",
        Verdict::Worse => "verdict worse",
        Verdict::CannotTell | Verdict::None => "verdict",
    };
    html! {
        td.number {
            @if let Some(mean) = mean { (signed(*mean, digits)) } @else { "–" }
            @if let Some(interval) = interval {
                br; span.quiet { (signed(interval.low, digits)) " to " (signed(interval.high, digits)) }
            }
        }
        td {
            span class=(class) { (verdict.words()) }
        }
    }
}

/// The remarks on a value, for a table row of their own. Those about the whole study are mentioned
/// once for all rows.
pub(super) fn remark(remarks: &[ResultRemark]) -> Option<String> {
    let words: Vec<String> =
        remarks.iter().filter(|remark| !remark.is_of_study()).map(ResultRemark::to_string).collect();
    (!words.is_empty()).then(|| words.join("; "))
}

fn spread(value: Option<Spread>, digits: usize) -> Markup {
    html! {
        @if let Some(Spread { mean, over_seeds }) = value {
            (format!("{mean:.digits$}"))
            @if let Some(sd) = over_seeds { span.quiet { (format!(" ± {sd:.digits$}")) } }
        } @else { "–" }
    }
}
