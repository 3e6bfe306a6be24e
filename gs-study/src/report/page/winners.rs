//! The first part of the page: which arm wins, and where.

use maud::{Markup, html};

use crate::{
    report::{
        at_equal,
        page::{Page, words::grouped},
        standings::{Standing, standings},
    },
    study::Matching,
    tables::Results,
};

/// What a standing says, in a line.
pub(crate) fn headline(results: &Results<'_>, standing: &Standing) -> String {
    let Standing { matching, budget, leader, next, not_told_apart, not_compared } = standing;
    let ahead = next.map_or_else(String::new, |next| format!(", {:.2} dB ahead", leader.1 - next));
    let name = &results.plan.study.arms[leader.0].name;
    let mut text = format!("{budget} Gaussians, {}: {name} leads with {:.2} dB{ahead}", at_equal(*matching), leader.1);
    if !not_told_apart.is_empty() {
        text += &format!("; can't be told from it: {}", names(results, not_told_apart));
    }
    for (why, arms) in not_compared {
        text += &format!("; not comparable, {why}: {}", names(results, arms));
    }
    text
}

fn names(results: &Results<'_>, arms: &[usize]) -> String {
    arms.iter().map(|&arm| results.plan.study.arms[arm].name.as_str()).collect::<Vec<_>>().join(", ")
}

impl Page<'_> {
    pub(super) fn winners(&self) -> Markup {
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
                    "told from, or compared with, are named."
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
        let Standing { leader, next, not_told_apart, not_compared, .. } = standing;
        html! {
            (self.swatch(leader.0)) b { (self.results.plan.study.arms[leader.0].name) } " "
            span.number { (format!("{:.2} dB", leader.1)) }
            @if let (Some(next), true, true) = (next, not_told_apart.is_empty(), not_compared.is_empty()) {
                br; span.verdict.better { "wins" } span.quiet { (format!(" by {:.2} dB", leader.1 - next)) }
            }
            @if !not_told_apart.is_empty() {
                br; span.verdict { "can't be told from " } (names(self.results, not_told_apart))
            }
            @for (why, arms) in not_compared {
                br; span.quiet { (why) ": " (names(self.results, arms)) }
            }
        }
    }
}
