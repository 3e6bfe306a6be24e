//! The last part of the page: settings of the arms, failed runs, and the method.

use crate::result::{CONFIDENCE, FEWEST, RESAMPLES};
use maud::{Markup, html};

use crate::{
    report::page::{
        Page,
        words::{capital, grouped},
    },
    result::{EQUAL_COUNT, FEWEST_SEEDS},
    run::RunOutcome,
    study::{Arm, Clock, Run, StudyTarget, VERSION},
};

impl Page<'_> {
    pub(super) fn arms(&self) -> Markup {
        let plan = self.results.plan;
        let of_arm = |arm: usize| plan.runs.iter().rev().find(|run| run.arm == arm);
        let all = |run: &Run| run.settings.to_toml().unwrap_or_default();
        let common = plan.study.settings.to_string();
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
                    @if let Some(keys) = keys(arm) { pre { (keys) } }
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

    pub(super) fn failures(&self) -> Markup {
        let plan = self.results.plan;
        let failed: Vec<(&Run, &str)> = self
            .results
            .rows()
            .filter_map(|(run, record)| match &record?.outcome {
                RunOutcome::Failed { error } => Some((run, error.as_str())),
                RunOutcome::Finished(_) => None,
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

    pub(super) fn method(&self) -> Markup {
        let plan = self.results.plan;
        let is_of_scenes = plan.study.is_of_scenes();
        let one = if is_of_scenes { "a scene" } else { "an image" };
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
                    li { "Every arm was " @if is_of_scenes { "trained on every scene" } @else { "fitted to every image" }
                        " at every budget from every seed with the same rasterizer. Each run is a row of "
                        code { "runs.csv" } "; " code { "runs/" } " has a file for each address, with its settings; a run always ends in the same scene, bit for bit." }
                    @if is_of_scenes {
                        li { "Differences are taken held-out view by held-out view. Views of one scene are related, and so are those of one run; "
                            "intervals therefore come from a two-level bootstrap, which draws groups of views as a whole before it draws views in them. "
                            @if plan.targets.len() < FEWEST {
                                "The groups are the runs of each scene from its seeds: with fewer than " (FEWEST) " scenes nothing can be said about "
                                "other scenes, so the scenes are fixed, and verdicts hold for other seeds and views of these. "
                            } @else {
                                "The groups are the scenes, of which each view has its mean over seeds: verdicts hold for other scenes of the same kind. "
                            }
                            "Drawing views as well makes the intervals a little wider than necessary." }
                    }
                    li { @if !is_of_scenes {
                            "Differences are taken image by image (after averaging over seeds), or seed by seed if there is one image only. "
                        }
                        "Intervals come from "
                        (grouped(RESAMPLES as u32)) " bootstrap resamples"
                        @if !is_of_scenes { " of at least " (FEWEST) " pairs" }
                        ", with percentiles expanded for small samples "
                        "(Hesterberg 2015), for a confidence of " (format!("{:.0}", 100.0 * CONFIDENCE)) " %. Of comparisons without a true difference, "
                        "about one in twenty is reported as a difference." }
                    li { "Equal count: the ends of the runs. Arms whose counts on " (one) " differ by more than "
                        (format!("{:.0}", 100.0 * EQUAL_COUNT)) " %, run by run, are not judged. Equal iterations: PSNR at the last step that all arms of "
                        "the study have reached on " (one) ", interpolated between measurements (about twenty a run)." }
                    li { "Equal time: an arm's time on " (one) " is the median over its runs, and each run is rescaled to that time, so that "
                        "disturbances of single runs do not matter. Arms are compared when the study's fastest has ended; a slower one is then judged before the "
                        "end of its schedule. There is no verdict if runs were timed on different backends, or with different numbers of runs side by side. "
                        "Measuring is not part of the time."
                        @if plan.study.clock == Clock::Cpu {
                            " Times are CPU time of the process, which did one run at a time, so other programs on the machine change them little."
                        } }
                    li { "Failed runs are left out: arms are compared over the pairs of which both runs finished, and not at all if " (one) " "
                        "has no such pair. A study should have " (FEWEST_SEEDS) " seeds or more." }
                    li { "Times are those of this machine: " (backends.iter().map(|b| b.as_str()).collect::<Vec<_>>().join(", "))
                        @if jobs > 1 { ", with up to " (jobs) " runs side by side, which slows all of them" } "." }
                    li { "Results are of version " code { (VERSION) } " on " (plan.machine.name) ". In builds from a checkout, a digest of the sources that "
                        "results depend on follows the +. Runs of other versions or machines are never reused." }
                    @if !plan.study.factors.is_empty() {
                        li { "A main effect is the difference that a level of a factor makes to its first level, on average over all combinations of the "
                            "other factors. An interaction is the difference between such an effect at a level of another factor and at that factor's first "
                            "level. Their intervals are those of the same sum of runs on each " (plan.study.target_word()) " and seed." }
                    }
                    li { (capital(self.targets())) ": "
                        (plan.targets.iter().map(StudyTarget::describe).collect::<Vec<_>>().join(", ")) "." }
                }
            }
        }
    }
}

/// What an arm sets, as in the study's file.
fn keys(arm: &Arm) -> Option<String> {
    let mut keys = toml::Table::try_from(arm).ok()?;
    ["name", "about"].iter().for_each(|key| _ = keys.remove(*key));
    Some(keys.to_string()).filter(|text| !text.is_empty())
}
