//! The page of the experiments: the paper's claims compared with measurements.

use gs_core::counted;
use gs_io::png_bytes;
use maud::{Markup, PreEscaped, html};

use super::{Chapter, Experiment};
use crate::{
    error::Error,
    report::{Picture, Table, claims, html},
};

/// Tables with more rows are folded.
const MOST_OPEN_ROWS: usize = 14;

/// The page of one experiment, or of all of them, as HTML in a single file. `backend` is what computed,
/// in words.
///
/// # Errors
/// [`Error::Picture`] where a figure cannot be drawn.
pub fn page(
    chapters: &[Chapter],
    only: Option<&'static Experiment>,
    is_quick: bool,
    backend: &str,
) -> Result<String, Error> {
    let sections = chapters.iter().map(section).collect::<Result<Vec<_>, _>>()?;
    let body = html! {
        (head(chapters, only, is_quick, backend))
        main {
            @for section in sections { (section) }
            @if only.is_none() { (elsewhere()) }
        }
    };
    Ok(html::page("The paper's experiments, measured", &body))
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
                    @for Chapter { experiment, findings, .. } in chapters {
                        @for (index, claim) in findings.claims.iter().enumerate() {
                            tr.first[index == 0] {
                                @if index == 0 {
                                    th rowspan=(findings.claims.len()) { a href={ "#" (experiment.name) } { (experiment.title) } }
                                }
                                td { (claim.statement) }
                                td { (claims::badge(claim.verdict())) }
                            }
                        }
                    }
                }
            } }
        }
    }
}

fn section(Chapter { experiment, findings, excerpts }: &Chapter) -> Result<Markup, Error> {
    Ok(html! {
        section id=(experiment.name) {
            h2 { (experiment.title) " " span.quiet.small { (experiment.section) } }
            p.quiet { (findings.method) }
            @for claim in &findings.claims { (claims::card(claim, "The paper")) }
            div.figures { @for chart in &findings.charts { (html::figure(chart)) } }
            div.pictures { @for picture in &findings.pictures { (shown(picture)) } }
            @for table in findings.tables.iter().filter(|table| !table.rows.is_empty()) { (table_of(table)) }
            @for (study, html) in excerpts {
                details { summary { "Tables, curves and pictures of the study " code { (study) } } (PreEscaped(html)) }
            }
        }
    })
}

/// Pictures that consist of several are shown wider.
fn shown(Picture { caption, image, .. }: &Picture) -> Markup {
    let is_broad = image.width() > image.height();
    html! {
        figure.broad[is_broad] {
            img src=(html::data_uri("png", &png_bytes(image))) alt=(caption);
            figcaption { (caption) }
        }
    }
}

fn table_of(table: &Table) -> Markup {
    let rows = html! {
        div.wide { table.numbers {
            thead { tr { @for column in &table.columns { th { (column) } } } }
            tbody { @for row in &table.rows { tr { @for cell in row { td { (cell) } } } } }
        } }
    };
    html! {
        @if table.rows.len() > MOST_OPEN_ROWS {
            details { summary { (table.title) " (" (counted(table.rows.len(), "row")) ")" } (rows) }
        } @else {
            h3 { (table.title) }
            (rows)
        }
    }
}

/// Claims that records have: section, name, claim, and where it was measured.
const ELSEWHERE: [[&str; 4]; 2] = [
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
        report::Findings,
        report::figure::{Axis, Figure, Marks, Series},
        result::{Circumstance, Claim, Number},
    };

    fn chapter() -> Chapter {
        let drawn = Figure {
            name: "loss".to_owned(),
            title: "Loss".to_owned(),
            x: Axis::linear("step"),
            y: Axis::linear("loss"),
            marks: Marks::lines(vec![Series::line("one", vec![(0.0, 1.0), (1.0, 2.0)])]),
        };
        let claim = Claim {
            name: "c".to_owned(),
            statement: "a < b & c".to_owned(),
            section: "§1".to_owned(),
            circumstances: vec![Circumstance::counted("held < of", [true, false])],
            measured: "1 > 0".to_owned(),
            numbers: vec![Number::new("n", 1.0, "dB")],
        };
        Chapter {
            experiment: &EXPERIMENTS[4],
            findings: Findings {
                method: "m".to_owned(),
                claims: vec![claim],
                charts: vec![drawn],
                tables: vec![Table {
                    name: "t",
                    title: "T".to_owned(),
                    columns: vec!["n"],
                    rows: (0..20u32).map(|i| vec![i.into()]).collect(),
                }],
                pictures: vec![],
            },
            excerpts: vec![("edges".to_owned(), "<p>a table</p>".to_owned())],
        }
    }

    #[test]
    fn the_page_stands_alone_and_sets_statement_beside_measurement() {
        let whole = page(&[chapter()], None, true, "cpu").unwrap();
        for part in [
            "a &lt; b &amp; c",
            "1 &gt; 0",
            "◐ partly",
            "held &lt; of: 1 of 2",
            "<svg",
            "20 rows",
            "Memory and storage",
            "Quick form",
            "<p>a table</p>",
        ] {
            assert!(whole.contains(part), "{part}");
        }
        let outside = whole.replace("http://www.w3.org/2000/svg", "");
        assert!(!outside.contains("http") && !outside.contains("<script") && !outside.contains("url("), "no network");
        assert!(!page(&[chapter()], Some(&EXPERIMENTS[4]), true, "cpu").unwrap().contains("Memory and storage"));
    }
}
