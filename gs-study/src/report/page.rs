//! The page: what the study found first, then the numbers, then how it was done.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::{
    error::Error,
    plan::{Run, VERSION},
    record::Outcome,
    report::{
        at_equal, figure,
        figure::{Figure, color},
        pictures::{FULL_SCALE, Multiples},
        standings::{Standing, standings},
    },
    statistics::{CONFIDENCE, FEWEST, RESAMPLES, Verdict},
    study::Matching,
    tables::{Difference, EQUAL_COUNT, Metric, Quality, Results, Spread},
};

const STYLE: &str = include_str!("style.css");

/// All that stands on the page.
pub(crate) struct Page<'a> {
    pub(crate) results: &'a Results<'a>,
    pub(crate) command: &'a str,
    pub(crate) figures: &'a [Figure],
    pub(crate) multiples: &'a [Multiples],
    /// The budget whose pictures are shown.
    pub(crate) pictured: u32,
}

/// What a standing says, in a line.
pub(crate) fn headline(results: &Results<'_>, standing: &Standing) -> String {
    let name = |arm: usize| results.plan.study.arms[arm].name.as_str();
    let names = |arms: &[usize]| arms.iter().map(|&arm| name(arm)).collect::<Vec<_>>().join(", ");
    let Standing { matching, budget, leader, next, not_told_apart, not_compared } = standing;
    let ahead = next.map_or_else(String::new, |next| format!(", {:.2} dB ahead", leader.1 - next));
    let told: Vec<usize> = not_told_apart.iter().copied().filter(|arm| !not_compared.contains(arm)).collect();
    let mut text =
        format!("{budget} Gaussians, {}: {} leads with {:.2} dB{ahead}", at_equal(*matching), name(leader.0), leader.1);
    if !told.is_empty() {
        text += &format!("; can't be told from it: {}", names(&told));
    }
    if !not_compared.is_empty() {
        text += &format!("; not comparable, since counts differ: {}", names(not_compared));
    }
    text
}

impl Page<'_> {
    /// The page as HTML.
    pub(crate) fn html(&self) -> Result<String, Error> {
        let study = &self.results.plan.study;
        let body = html! {
            header {
                p.kind { "Study" }
                h1 { (study.name) }
                p.question { (study.question) }
                (self.facts())
            }
            main {
                (self.winners())
                (self.quality())
                (self.differences()?)
                (self.curves()?)
                (self.pictures())
                (self.arms())
                (self.failures())
                (self.method())
            }
        };
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { "Study: " (study.name) }
                    style { (PreEscaped(STYLE)) }
                }
                body { (body) }
            }
        };
        Ok(page.into_string())
    }

    fn facts(&self) -> Markup {
        let plan = self.results.plan;
        let study = &plan.study;
        let ended = self.results.records.iter().flatten();
        let done = ended.filter(|record| matches!(record.outcome, Outcome::Finished(_))).count();
        html! {
            dl.facts {
                div { dt { "Runs" } dd { (done) " of " (plan.runs.len()) " finished" } }
                div { dt { "Arms" } dd { (study.arms.len()) } }
                div { dt { "Images" } dd { (plan.targets.len()) } }
                div { dt { "Budgets" } dd { (listed(&study.budgets)) } }
                div { dt { "Seeds" } dd { (listed(&study.seeds)) } }
                div { dt { "Computed by" } dd { "gs " (VERSION) ", " (plan.machine) } }
            }
            pre.command { "$ " (self.command) }
        }
    }

    fn winners(&self) -> Markup {
        let study = &self.results.plan.study;
        let standings = standings(self.results);
        let cell = |matching: Matching, budget: u32| {
            let found = standings.iter().find(|standing| (standing.matching, standing.budget) == (matching, budget));
            html! {
                td {
                    @if let Some(standing) = found { (self.winner(standing)) } @else { span.quiet { "no runs yet" } }
                }
            }
        };
        html! {
            section {
                h2 { "Which arm wins, and where" }
                p {
                    "The arm with the highest mean PSNR. It wins where it is shown to be better than every other; those that it cannot be "
                    "told from are named."
                }
                div.wide { table.winners {
                    thead { tr { th { } @for budget in &study.budgets { th { (grouped(*budget)) " Gaussians" } } } }
                    tbody {
                        @for &matching in &study.matchings {
                            tr { th { (at_equal(matching)) } @for &budget in &study.budgets { (cell(matching, budget)) } }
                        }
                    }
                } }
            }
        }
    }

    fn winner(&self, standing: &Standing) -> Markup {
        let name = |arm: &usize| self.results.plan.study.arms[*arm].name.as_str();
        let told: Vec<&usize> =
            standing.not_told_apart.iter().filter(|arm| !standing.not_compared.contains(arm)).collect();
        html! {
            (self.swatch(standing.leader.0)) b { (name(&standing.leader.0)) } " "
            span.number { (format!("{:.2} dB", standing.leader.1)) }
            @if standing.not_told_apart.is_empty() && standing.next.is_some() {
                br; span.verdict.better { "wins" }
                @if let Some(next) = standing.next { span.quiet { (format!(" by {:.2} dB", standing.leader.1 - next)) } }
            }
            @if !told.is_empty() {
                br; span.verdict { "can't be told from " }
                (told.iter().map(|arm| name(arm)).collect::<Vec<_>>().join(", "))
            }
            @if !standing.not_compared.is_empty() {
                br; span.quiet {
                    "counts differ: "
                    (standing.not_compared.iter().map(name).collect::<Vec<_>>().join(", "))
                }
            }
        }
    }

    fn quality(&self) -> Markup {
        let qualities = self.results.qualities();
        let seconds = |quality: &Quality| {
            let arm = self.results.plan.study.arms.iter().position(|arm| arm.name == quality.arm)?;
            self.results.spread(arm, quality.budget, |run| Some(run.seconds))
        };
        html! {
            section {
                h2 { "Quality" }
                p {
                    "Mean over images of means over seeds, at the end of the fits; ± is the standard deviation of a single run over seeds. "
                    "PSNR in dB, SSIM and MS-SSIM from 0 to 1, time in seconds as measured."
                }
                div.wide { table {
                    thead { tr {
                        th { "budget" } th { "arm" } th.number { "Gaussians" } th.number { "PSNR, dB" } th.number { "SSIM" }
                        th.number { "MS-SSIM" } th.number { "time, s" } th.number { "runs" }
                    } }
                    tbody {
                        @for (index, quality) in qualities.iter().enumerate() {
                            @let arm = index % self.results.plan.study.arms.len();
                            tr.first[arm == 0] {
                                td { @if arm == 0 { (grouped(quality.budget)) } }
                                td { (self.swatch(arm)) (quality.arm) }
                                td.number { (spread(quality.gaussians, 0)) }
                                td.number { (spread(quality.psnr, 2)) }
                                td.number { (spread(quality.ssim, 4)) }
                                td.number { (spread(quality.ms_ssim, 4)) }
                                td.number { (spread(seconds(quality), 2)) }
                                td.number {
                                    (quality.finished)
                                    @if quality.failed > 0 { span.verdict.worse { " (" (quality.failed) " failed)" } }
                                    @if quality.missing > 0 { span.quiet { " (" (quality.missing) " missing)" } }
                                }
                            }
                        }
                    }
                } }
            }
        }
    }

    fn differences(&self) -> Result<Markup, Error> {
        let study = &self.results.plan.study;
        let baseline = study.baseline_arm();
        let others: Vec<usize> = (0..study.arms.len()).filter(|&arm| arm != baseline).collect();
        let mut parts = Vec::new();
        for &matching in &study.matchings {
            let drawn = match figure(self.figures, &format!("differences-at-equal-{}", matching.name())) {
                Some(figure) => figure.inline_svg()?,
                None => String::new(),
            };
            // At the ends of fits there are more measures than PSNR.
            let second = (matching == Matching::Count && self.has_ms_ssim()).then_some(Metric::MsSsim);
            let rows: Vec<(u32, usize)> =
                study.budgets.iter().flat_map(|&budget| others.iter().map(move |&arm| (budget, arm))).collect();
            let of = |metric: Metric, (budget, arm): (u32, usize)| {
                self.results.difference(matching, metric, budget, arm, baseline)
            };
            parts.push(html! {
                h3 { (capital(at_equal(matching))) }
                div.beside {
                    figure { (PreEscaped(drawn)) }
                    div.wide { table.small {
                        thead { tr {
                            th { "budget" } th { "arm" } th.number { "PSNR, dB" } th { }
                            @if second.is_some() { th.number { "MS-SSIM" } th { } }
                        } }
                        tbody {
                            @for &row in &rows {
                                tr {
                                    td { (grouped(row.0)) }
                                    td.name { (self.swatch(row.1)) (study.arms[row.1].name) }
                                    (difference_cells(&of(Metric::Psnr, row), 2, Remarks::Shown))
                                    @if let Some(metric) = second { (difference_cells(&of(metric, row), 4, Remarks::Hidden)) }
                                }
                            }
                        }
                    } }
                }
            });
        }
        Ok(html! {
            section {
                h2 { "Differences from " (study.arms[baseline].name) }
                p {
                    "Paired: each image with itself. Under each mean difference is its 95 % interval; an arm is better or worse where the whole of it lies "
                    "on one side of 0. "
                    "Hollow marks are not judged. Every other pair of arms is in " code { "differences.csv" } "."
                }
                @for part in parts { (part) }
            }
        })
    }

    fn has_ms_ssim(&self) -> bool {
        let mut finished = self.results.records.iter().flatten().filter_map(|record| record.outcome.finished());
        finished.any(|run| run.ms_ssim.is_some())
    }

    fn curves(&self) -> Result<Markup, Error> {
        let mut drawn = Vec::new();
        for figure in self.figures.iter().filter(|figure| !figure.name.starts_with("differences")) {
            drawn.push(figure.inline_svg()?);
        }
        Ok(html! {
            section {
                h2 { "Curves" }
                p {
                    "Lines are means over images and seeds; bands go from the lowest to the highest seed, each a mean over the images. "
                    "The same as SVG and PNG: " code { "plots/" } "."
                }
                div.figures { @for svg in drawn { figure { (PreEscaped(svg)) } } }
            }
        })
    }

    fn pictures(&self) -> Markup {
        let side =
            |window: [u32; 4]| format!("{}×{} px at column {}, row {}", window[2], window[3], window[0], window[1]);
        html! {
            section {
                h2 { "Pictures" }
                p {
                    "At most " (grouped(self.pictured)) " Gaussians, seed " (self.results.plan.study.seeds[0]) ": the part of each image in which the "
                    "arms differ the most, and below it the largest absolute error of a channel, from black (0) to pale yellow ("
                    (FULL_SCALE) " of full scale and more). PSNR is that of the whole image."
                }
                @for multiples in self.multiples {
                    h3 { (multiples.image) " " span.quiet { (side(multiples.window)) } }
                    div.multiples {
                        figure {
                            img src=(multiples.target) alt={ (multiples.image) ", the image itself" };
                            figcaption { "image" }
                        }
                        @for multiple in &multiples.arms {
                            @let name = &self.results.plan.study.arms[multiple.arm].name;
                            figure {
                                img src=(multiple.reconstruction) alt={ (multiples.image) " by " (name) };
                                img src=(multiple.error_map) alt={ "error of " (name) };
                                figcaption { (self.swatch(multiple.arm)) (name) br; span.quiet { (format!("{:.2} dB", multiple.psnr)) } }
                            }
                        }
                    }
                }
            }
        }
    }

    fn arms(&self) -> Markup {
        let plan = self.results.plan;
        let of_arm = |arm: usize| plan.runs.iter().rev().find(|run| run.arm == arm);
        let all = |run: &Run| toml::to_string(&run.settings).unwrap_or_default();
        let common = toml::to_string(&plan.study.settings).unwrap_or_default();
        html! {
            section {
                h2 { "Arms" }
                p {
                    "All start from the preset " code { (plan.study.preset) }
                    @if let Some(iterations) = plan.study.iterations { " in " (iterations) " iterations" }
                    @if common.is_empty() { "." } @else { ", with:" }
                }
                @if !common.is_empty() { pre { (common) } }
                @for (index, arm) in plan.study.arms.iter().enumerate() {
                    h3 { (self.swatch(index)) (arm.name) }
                    p { (arm.about) }
                    @if let Some(preset) = arm.preset { p { "Preset " code { (preset) } "." } }
                    @if let Some(iterations) = arm.iterations { p { (iterations) " iterations." } }
                    @if let Some(policy) = &arm.policy { p { "Policy " code { (policy) } "." } }
                    @if let Some(own) = &arm.own_policy { p { "A policy of its own: " code { (own.fingerprint) } "." } }
                    @if !arm.settings.is_empty() { pre { (toml::to_string(&arm.settings).unwrap_or_default()) } }
                    @if let Some(run) = of_arm(index) {
                        details {
                            summary { "all settings of row " (run.row) " (" (plan.describe(run)) ")" }
                            pre { (all(run)) }
                        }
                    }
                }
            }
        }
    }

    fn failures(&self) -> Markup {
        let plan = self.results.plan;
        let failed: Vec<(&Run, &str)> = self
            .results
            .rows()
            .filter_map(|(run, record)| match &record?.outcome {
                Outcome::Failed { error } => Some((run, error.as_str())),
                Outcome::Finished(_) => None,
            })
            .collect();
        html! {
            @if !failed.is_empty() {
                section {
                    h2 { "Runs that failed" }
                    div.wide { table {
                        thead { tr { th { "row" } th { "run" } th { "error" } } }
                        tbody { @for (run, error) in failed { tr { td { (run.row) } td { (plan.describe(run)) } td { (error) } } } }
                    } }
                }
            }
        }
    }

    fn method(&self) -> Markup {
        let plan = self.results.plan;
        let side_by_side = self.results.records.iter().flatten().filter_map(|record| record.outcome.finished());
        let (jobs, backends) = side_by_side.fold((1, Vec::new()), |(jobs, mut backends), run| {
            if !backends.contains(&&run.backend) {
                backends.push(&run.backend);
            }
            (run.side_by_side.max(jobs), backends)
        });
        html! {
            section {
                h2 { "How this was done" }
                ul {
                    li { "Every arm fitted every image at every budget from every seed with the same rasterizer. Each run is a row of "
                        code { "runs.csv" } "; " code { "gs study replay DIR ROW" } " does it again and ends in the same scene, bit for bit." }
                    li { "A difference is taken image by image (mean over seeds first) where there are several images, else seed by seed. Its interval: "
                        (grouped(RESAMPLES as u32)) " bootstrap resamples of these pairs, of which there must be " (FEWEST) " at least; their means, and percentiles expanded for small samples "
                        "(Hesterberg 2015), for a confidence of " (format!("{:.0}", 100.0 * CONFIDENCE)) " %. With several comparisons, one in twenty "
                        "may be called a difference where there is none." }
                    li { "Equal count: the ends of the fits; arms whose mean counts differ by more than " (format!("{:.0}", 100.0 * EQUAL_COUNT))
                        " % are not judged. Equal iterations and equal time: PSNR at the last step, or second, that all runs of the pair on an image "
                        "have reached, interpolated between measurements (about twenty a fit). Measuring is not part of the time." }
                    li { "Times are those of this machine: " (backends.iter().map(|b| b.as_str()).collect::<Vec<_>>().join(", "))
                        @if jobs > 1 { ", with up to " (jobs) " runs side by side, which slows all of them" } "." }
                    li { "Images: " (plan.targets.iter().map(|t| format!("{} ({}×{} px)", t.name, t.image.width(), t.image.height())).collect::<Vec<_>>().join(", ")) "." }
                }
            }
        }
    }

    /// The colour of an arm, before its name.
    fn swatch(&self, arm: usize) -> Markup {
        let plotters::style::RGBColor(r, g, b) = color(arm);
        html! { span.swatch style=(format!("background:#{r:02X}{g:02X}{b:02X}")) {} }
    }
}

/// Whether a cell says why there is no verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Remarks {
    Shown,
    /// The cell beside it does.
    Hidden,
}

/// Two cells: the difference with its interval, and the verdict.
fn difference_cells(difference: &Difference, digits: usize, remarks: Remarks) -> Markup {
    let class = match difference.verdict {
        Verdict::Better => "verdict better",
        Verdict::Worse => "verdict worse",
        Verdict::CannotTell => "verdict",
    };
    html! {
        td.number {
            @if let Some(mean) = difference.mean { (signed(mean, digits)) } @else { "–" }
            @if let Some(interval) = difference.interval {
                br; span.quiet { (signed(interval.low, digits)) " to " (signed(interval.high, digits)) }
            }
        }
        td {
            span class=(class) { (difference.verdict.words()) }
            @if let (Some(remark), Remarks::Shown) = (&difference.remark, remarks) { br; span.quiet { (remark) } }
        }
    }
}

fn spread(value: Option<Spread>, digits: usize) -> Markup {
    html! {
        @if let Some(Spread { mean, over_seeds }) = value {
            (format!("{mean:.digits$}"))
            @if let Some(sd) = over_seeds { span.quiet { (format!(" ± {sd:.digits$}")) } }
        } @else { "–" }
    }
}

fn listed(values: &[u32]) -> String {
    values.iter().map(|&value| grouped(value)).collect::<Vec<_>>().join(", ")
}

/// A number with a comma before each three digits.
fn grouped(value: u32) -> String {
    let digits = value.to_string();
    let lead = digits.len() % 3;
    let groups = digits.as_bytes()[lead..].chunks(3).map(|group| String::from_utf8_lossy(group).into_owned());
    let parts: Vec<String> = (lead > 0).then(|| digits[..lead].to_owned()).into_iter().chain(groups).collect();
    parts.join(",")
}

/// A number with its sign, with a minus as wide as a plus.
fn signed(value: f64, digits: usize) -> String {
    format!("{value:+.digits$}").replace('-', "−")
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_by_thousands() {
        assert_eq!([0, 999, 1000, 9000, 1_234_567].map(grouped), ["0", "999", "1,000", "9,000", "1,234,567"]);
        assert_eq!(capital("at equal count"), "At equal count");
    }
}
