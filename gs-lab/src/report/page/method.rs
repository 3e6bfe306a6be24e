//! The last part of the page: settings of the arms, failed runs, and the method.

use maud::{Markup, html};

use crate::{
    report::page::{Page, words::capital},
    result::{EQUAL_COUNT, FEWEST},
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
        let side_by_side = self.results.records.iter().flatten().filter_map(|record| record.outcome.finished());
        let (jobs, backends) = side_by_side.fold((1, Vec::new()), |(jobs, mut backends), run| {
            if !backends.contains(&run.backend.as_str()) {
                backends.push(&run.backend);
            }
            (run.side_by_side.max(jobs), backends)
        });
        let clock = if plan.study.clock == Clock::Cpu { "CPU time of the process" } else { "wall time" };
        html! {
            section {
                h2 { "How this was done" }
                ul {
                    li { "Equal count: arms are compared at the ends of their runs, if their numbers of Gaussians differ by at most "
                        (format!("{:.0}", 100.0 * EQUAL_COUNT)) " %." }
                    li { "Equal iterations: arms are compared at the last step that all of them have reached." }
                    li { "Equal time: arms are compared after the time that the study's fastest arm takes." }
                    @if plan.study.is_of_scenes() {
                        li { "Verdicts hold for " @if plan.targets.len() < FEWEST {
                            "other seeds and views of these scenes, as there are fewer than " (FEWEST)
                        } @else { "other scenes of the same kind" } "." }
                    }
                    li { "Times: " (clock) ", by " (backends.join(", "))
                        @if jobs > 1 { ", with up to " (jobs) " runs side by side, which slows all of them" } "." }
                    li { "Version: " code { (VERSION) } " on " (plan.machine.name) "." }
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
