//! The first part of the page: the winning arm at each budget.

use gs_core::counted;
use maud::{Markup, html};

use crate::{
    report::{
        page::{Page, words::at_equal},
        standings::{Standing, standings},
    },
    result::Results,
};

/// A standing as a line of text.
pub(crate) fn headline(results: &Results<'_>, standing: &Standing) -> String {
    let Standing { matching, budget, leader, next, indistinguishable, not_judged } = standing;
    let ahead = next.map_or_else(String::new, |next| format!(", {:.2} dB ahead", leader.1 - next));
    let name = &results.plan.study.arms[leader.0].name;
    let budget = counted(*budget, "Gaussian");
    let mut text = format!("{budget}, {}: {name} leads with {:.2} dB{ahead}", at_equal(*matching), leader.1);
    if !indistinguishable.is_empty() {
        text += &format!("; can't be distinguished from it: {}", names(results, indistinguishable));
    }
    for (why, arms) in not_judged {
        match arms.len() == results.plan.study.arms.len() - 1 && not_judged.len() == 1 {
            true => text += &format!("; no verdict, because {why}"),
            false => text += &format!("; no verdict on {}, because {why}", names(results, arms)),
        }
    }
    text
}

fn names(results: &Results<'_>, arms: &[usize]) -> String {
    arms.iter().map(|&arm| results.plan.study.arms[arm].name.as_str()).collect::<Vec<_>>().join(", ")
}

impl Page<'_> {
    pub(super) fn winners(&self) -> Markup {
        html! {
            section {
                h2 { "Which arm wins, and where" }
                p {
                    "The arm with the highest mean PSNR. It wins if it is shown to be better than every other arm. Arms that it cannot be "
                    "distinguished from are listed, and arms without a verdict, with the reason."
                }
                ul { @for standing in standings(self.results) { li { (headline(self.results, &standing)) } } }
            }
        }
    }
}
