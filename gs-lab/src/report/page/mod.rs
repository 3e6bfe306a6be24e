//! The page: first the winners, then the numbers, then the method.

mod effects;
mod figures;
mod method;
mod numbers;
mod winners;
mod words;

use maud::{Markup, html};

use super::{claims, figure::Figure, html};
use crate::{
    report::{page::words::listed, pictures::Multiples},
    result::Results,
    run::RunOutcome,
    study::VERSION,
};

pub(crate) use winners::headline;

/// The content of the page.
pub(crate) struct Page<'a> {
    pub(crate) results: &'a Results<'a>,
    pub(crate) command: &'a str,
    pub(crate) figures: &'a [Figure],
    pub(crate) multiples: &'a [Multiples],
    /// The budget of the pictures.
    pub(crate) pictured: u32,
}

impl Page<'_> {
    /// The page as HTML.
    pub(crate) fn html(&self) -> String {
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
                (self.claims())
                (self.quality())
                (self.differences())
                (self.effects())
                (self.curves())
                (self.pictures())
                (self.arms())
                (self.failures())
                (self.method())
            }
        };
        html::page(&format!("Study: {}", study.name), &body)
    }

    fn claims(&self) -> Markup {
        let claims = self.results.claims();
        html! {
            @if !claims.is_empty() {
                section {
                    h2 { "Claims" }
                    p {
                        "Each verdict is computed from the runs: a claim is confirmed if all its conditions hold in all cases, and refuted if none "
                        "holds in any. All numbers are in " code { "claims.csv" } "."
                    }
                    @for claim in &claims { (claims::card(claim, "The study")) }
                }
            }
        }
    }

    fn facts(&self) -> Markup {
        let plan = self.results.plan;
        let study = &plan.study;
        let ended = self.results.records.iter().flatten();
        let done = ended.filter(|record| matches!(record.outcome, RunOutcome::Finished(_))).count();
        html! {
            dl.facts {
                div { dt { "Runs" } dd { (done) " of " (plan.runs.len()) " finished" } }
                div { dt { "Arms" } dd { (study.arms.len()) } }
                div { dt { (words::capital(self.targets())) } dd { (plan.targets.len()) } }
                div { dt { "Budgets" } dd { (listed(&study.budgets)) } }
                div { dt { "Seeds" } dd { (listed(&study.seeds)) } }
                div { dt { "Computed by" } dd { "gs " (VERSION) ", " (plan.machine.name) } }
            }
            pre.command { "$ " (self.command) }
        }
    }

    /// "images" or "scenes".
    fn targets(&self) -> &'static str {
        if self.results.plan.study.is_of_scenes() { "scenes" } else { "images" }
    }

    /// The colour of an arm, shown before its name.
    fn swatch(&self, arm: usize) -> Markup {
        html::swatch(arm)
    }
}
