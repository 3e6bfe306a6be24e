//! Claims on a page: what is claimed beside what was measured.

use maud::{Markup, html};

use crate::result::{Circumstance, Claim, ClaimVerdict};

/// A claim with its conditions, its verdict and its numbers. `who` claims it, such as "The paper".
pub(crate) fn card(claim: &Claim, who: &str) -> Markup {
    html! {
        div.claim {
            div {
                h3 { (who) " says " span.quiet { (claim.section) } }
                p { (claim.statement) }
            }
            div {
                h3 { "Measured here " (badge(claim.verdict())) }
                ul { @for circumstance in &claim.circumstances { (line(circumstance)) } }
                p { (claim.measured) }
            }
        }
    }
}

/// A condition of the verdict as a list item.
fn line(circumstance: &Circumstance) -> Markup {
    let verdict = circumstance.verdict();
    html! { li { span class=(verdict) title=(verdict) { (sign(verdict)) } (circumstance) } }
}

/// A verdict with a sign, so that it does not depend on colour.
pub(crate) fn badge(verdict: ClaimVerdict) -> Markup {
    html! { span class={ "badge " (verdict) } { (sign(verdict)) " " (verdict) } }
}

fn sign(verdict: ClaimVerdict) -> &'static str {
    match verdict {
        ClaimVerdict::Confirmed => "✓",
        ClaimVerdict::Partly => "◐",
        ClaimVerdict::Refuted => "✗",
    }
}
