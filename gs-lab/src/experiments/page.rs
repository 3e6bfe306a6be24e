//! The page of the experiments: the paper's claims compared with measurements.

use maud::{Markup, html};

use super::{Chapter, Experiment};
use crate::{
    report::{
        claims::{badge, card},
        html,
    },
    run::PAGE,
};

/// The page of one experiment, or of all of them, as HTML. `backend` is what computed, in words. It links to
/// the reports of the studies, which are in folders of their names beside it.
pub fn page(chapters: &[Chapter], only: Option<&'static Experiment>, is_quick: bool, backend: &str) -> String {
    let body = html! {
        (head(chapters, only, is_quick, backend))
        main {
            @for chapter in chapters { (section(chapter)) }
            @if only.is_none() { (elsewhere()) }
        }
    };
    html::page("The paper's experiments, measured", &body)
}

fn head(chapters: &[Chapter], only: Option<&Experiment>, is_quick: bool, backend: &str) -> Markup {
    let quick = if is_quick { " --quick" } else { "" };
    let only = only.map_or_else(String::new, |only| format!(" --only {}", only.name));
    html! {
        header {
            h1 { "The paper’s experiments, measured" }
            p.question {
                "What " cite { "Analysis of Gaussian Splatting and implementation of 2D" } " says, in other words, beside what "
                code { "gs paper" (quick) (only) } " measured. Verdicts are computed from the numbers. PSNR is that of a picture rounded "
                "to 8 bits, against its target before rounding."
            }
            p.quiet.small { "gs " (env!("CARGO_PKG_VERSION")) " · " (backend) }
            @if is_quick {
                p.note { "Quick form: fewer seeds and steps, so numbers differ from those of the full form." }
            }
            div.wide { table {
                thead { tr { th { "experiment" } th { "the paper says" } th { "verdict" } } }
                tbody {
                    @for Chapter { experiment, claims, .. } in chapters {
                        @for (index, claim) in claims.iter().enumerate() {
                            tr.first[index == 0] {
                                @if index == 0 {
                                    th rowspan=(claims.len()) { a href={ "#" (experiment.name) } { (experiment.title) } }
                                }
                                td { (claim.statement) }
                                td { (badge(claim.verdict())) }
                            }
                        }
                    }
                }
            } }
        }
    }
}

fn section(Chapter { experiment, methods, claims }: &Chapter) -> Markup {
    html! {
        section id=(experiment.name) {
            h2 { (experiment.title) " " span.quiet.small { (experiment.section) } }
            p.quiet { (methods.join(" ")) }
            @for claim in claims { (card(claim, "The paper")) }
            p { "Tables, curves and pictures:"
                @for study in experiment.studies { " " a href={ (study) "/" (PAGE) } { (study) } }
            }
        }
    }
}

/// Claims that records have: section, name, claim, and where it was measured.
const ELSEWHERE: [[&str; 4]; 3] = [
    [
        "§3.4.2",
        "Singular covariances.",
        "When the optimizer drives a scale to near zero, the loss becomes NaN. A minimum scale of 1 px and an ε in the \
         determinant cure it.",
        "The guards of this program cannot be switched off. An earlier program without guards measured it: \
         benchmarks/2026-11-23-xeon-2-cores/paper.md.",
    ],
    [
        "§5.3",
        "Memory and storage.",
        "Trained scenes of millions of Gaussians take gigabytes on disk and more than 20 GB of memory during training.",
        "Two records in benchmarks/ have it: formats.md (bytes per Gaussian on disk in every format) and memory.md (peak \
         memory in training by Gaussians, tile entries and pixels).",
    ],
    [
        "§5.4, §2.3.1",
        "Sorting artefacts.",
        "Sorting by one depth per Gaussian and tile can make colours pop where Gaussians intersect or tiles meet. It becomes \
         negligible as Gaussians converge to the size of pixels.",
        "gs popping measures it in any scene. Two records in benchmarks/ have scenes whose popping is known: 2026-11-21-epyc-2-cores/popping.md \
         and 2026-11-23-xeon-2-cores/paper.md. Colours pop where Gaussians intersect, tiles leave no trace, and with Gaussians of 1 px \
         nothing jumps visibly.",
    ],
];

fn elsewhere() -> Markup {
    html! {
        section id="elsewhere" {
            h2 { "Measured elsewhere" }
            @for [section, name, claim, measured] in ELSEWHERE {
                div.claim {
                    div {
                        h3 { "The paper says " span.quiet { (section) } }
                        p { b { (name) } " " (claim) }
                    }
                    div {
                        h3 { "Measured " span.badge { "– not here" } }
                        p { (measured) }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        experiments::EXPERIMENTS,
        result::{Circumstance, Claim, Number},
    };

    fn chapter() -> Chapter {
        let claim = Claim {
            name: "c".to_owned(),
            statement: "a < b & c".to_owned(),
            section: "§1".to_owned(),
            circumstances: vec![Circumstance::counted("held < of", [true, false])],
            measured: "1 > 0".to_owned(),
            numbers: vec![Number { what: "n".to_owned(), value: 1.0, unit: "dB".to_owned() }],
        };
        Chapter { experiment: &EXPERIMENTS[4], methods: vec!["How?".to_owned()], claims: vec![claim] }
    }

    #[test]
    fn the_page_sets_statement_beside_measurement() {
        let whole = page(&[chapter()], None, true, "cpu");
        for part in [
            "a &lt; b &amp; c",
            "1 &gt; 0",
            "◐ partly",
            "held &lt; of: 1 of 2",
            "How?",
            "Memory and storage",
            "Quick form",
            "<a href=\"edges/report.html\">",
        ] {
            assert!(whole.contains(part), "{part}");
        }
        assert!(!whole.contains("http") && !whole.contains("<script") && !whole.contains("url("), "no network");
        assert!(!page(&[chapter()], Some(&EXPERIMENTS[4]), true, "cpu").contains("Memory and storage"));
    }
}
