//! The page of `gs paper`: one HTML file that needs nothing beside it, in light and dark, readable at a laptop's width.

use std::fmt::Write as _;

use gs_core::counted;
use gs_train::experiments::{Circumstance, Claim, ELSEWHERE, Experiment, Extent, Picture, Table, Verdict};

use crate::{paper::Chapter, report::chart};

/// Rows of a table that are shown at once; longer ones are folded.
const MOST_OPEN_ROWS: usize = 14;

/// How the page came to be.
pub(super) struct Setting<'a> {
    pub(super) extent: Extent,
    pub(super) only: Option<Experiment>,
    /// The backend, in words.
    pub(super) backend: &'a str,
}

/// The page as text.
pub(super) fn page(chapters: &[Chapter], setting: &Setting<'_>) -> String {
    let (light, dark) = chart::curve_colors();
    let style = STYLE.replace("/*light*/", &light).replace("/*dark*/", &dark);
    let mut body = String::new();
    head(&mut body, chapters, setting);
    for chapter in chapters {
        section(&mut body, chapter);
    }
    if setting.only.is_none() {
        elsewhere(&mut body);
    }
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, \
         initial-scale=1\">\n<title>The paper's experiments, measured</title>\n<style>{style}</style>\n</head>\n<body>\n<main>\n{body}\
         </main>\n</body>\n</html>\n"
    )
}

/// Adds to the page; a string can always be written to.
macro_rules! add {
    ($page:expr, $($text:tt)*) => {{
        let written = write!($page, $($text)*);
        debug_assert!(written.is_ok());
    }};
}

fn head(page: &mut String, chapters: &[Chapter], setting: &Setting<'_>) {
    let quick = if setting.extent == Extent::Quick { " --quick" } else { "" };
    let only = setting.only.map_or_else(String::new, |only| format!(" --only {only}"));
    add!(
        page,
        "<h1>The paper’s experiments, measured</h1>\n<p class=\"lead\">What <cite>Analysis of Gaussian Splatting and implementation \
         of 2D</cite> says, in other words, beside what <code>gs paper{quick}{only}</code> measured. Verdicts are computed from the \
         numbers. PSNR is that of a picture rounded to 8 bits, against its target before rounding.</p>\n<p class=\"small\">gs {} · {}</p>\n",
        env!("CARGO_PKG_VERSION"),
        escaped(setting.backend)
    );
    if setting.extent == Extent::Quick {
        add!(
            page,
            "<p class=\"note\">Quick form: fewer seeds and steps than the whole, so numbers differ from its.</p>\n"
        );
    }
    add!(
        page,
        "<div class=\"wide\"><table class=\"overview\">\n<thead><tr><th>experiment</th><th>the paper says</th><th>verdict</th></tr></thead>\n"
    );
    for Chapter { experiment, findings, .. } in chapters {
        for (i, claim) in findings.claims.iter().enumerate() {
            let first = match i {
                0 => format!(
                    "<th rowspan=\"{}\"><a href=\"#{experiment}\">{}</a></th>",
                    findings.claims.len(),
                    experiment.title()
                ),
                _ => String::new(),
            };
            add!(page, "<tr>{first}<td>{}</td><td>{}</td></tr>\n", escaped(claim.statement), badge(claim.verdict()));
        }
    }
    add!(page, "</table></div>\n");
}

fn section(page: &mut String, chapter: &Chapter) {
    let Chapter { experiment, findings, figures } = chapter;
    add!(
        page,
        "<section id=\"{experiment}\">\n<h2>{} <span class=\"where\">{}</span></h2>\n<p class=\"method\">{}</p>\n",
        experiment.title(),
        experiment.section(),
        escaped(&findings.method)
    );
    for claim in &findings.claims {
        claim_card(page, claim);
    }
    add!(page, "<div class=\"charts\">\n");
    for (drawn, svg) in findings.charts.iter().zip(&figures.charts) {
        let title = escaped(&drawn.title);
        add!(page, "<figure><figcaption>{title}</figcaption>{}</figure>\n", chart::themed(svg));
    }
    add!(page, "</div>\n<div class=\"pictures\">\n");
    for (picture, uri) in findings.pictures.iter().zip(&figures.pictures) {
        let caption = escaped(&picture.caption);
        let class = if is_wide(picture) { " class=\"broad\"" } else { "" };
        add!(page, "<figure{class}><img src=\"{uri}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>\n");
    }
    add!(page, "</div>\n");
    for shown in findings.tables.iter().filter(|table| !table.rows.is_empty()) {
        table(page, shown);
    }
    add!(page, "</section>\n");
}

/// Whether a picture is of several side by side, and has to be larger to be seen.
fn is_wide(picture: &Picture) -> bool {
    picture.image.width() > picture.image.height()
}

fn claim_card(page: &mut String, claim: &Claim) {
    let circumstances: String = claim.circumstances.iter().map(circumstance).collect();
    add!(
        page,
        "<div class=\"claim\"><div><h3>The paper says <span class=\"where\">{}</span></h3><p>{}</p></div><div><h3>Measured here \
         {}</h3><ul>{circumstances}</ul><p>{}</p></div></div>\n",
        escaped(claim.section),
        escaped(claim.statement),
        badge(claim.verdict()),
        escaped(&claim.measured)
    );
}

/// A line of the list from which a verdict follows.
fn circumstance(circumstance: &Circumstance) -> String {
    let verdict = circumstance.verdict();
    let text = escaped(&circumstance.to_string());
    format!("<li><span class=\"{verdict}\" title=\"{verdict}\">{}</span>{text}</li>", sign(verdict))
}

/// A verdict that needs no colour to be told.
fn badge(verdict: Verdict) -> String {
    format!("<span class=\"badge {verdict}\">{} {verdict}</span>", sign(verdict))
}

fn sign(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Confirmed => "✓",
        Verdict::Partly => "◐",
        Verdict::Refuted => "✗",
    }
}

fn table(page: &mut String, table: &Table) {
    let title = escaped(&table.title);
    let fold = table.rows.len() > MOST_OPEN_ROWS;
    match fold {
        true => add!(page, "<details><summary>{title} ({})</summary>", counted(table.rows.len(), "row")),
        false => add!(page, "<h4>{title}</h4>"),
    }
    add!(page, "<div class=\"wide\"><table><thead><tr>");
    for column in &table.columns {
        add!(page, "<th>{}</th>", escaped(column));
    }
    add!(page, "</tr></thead>\n");
    for row in &table.rows {
        add!(page, "<tr>");
        for cell in row {
            add!(page, "<td>{}</td>", escaped(&cell.to_string()));
        }
        add!(page, "</tr>\n");
    }
    add!(page, "</table></div>{}\n", if fold { "</details>" } else { "" });
}

fn elsewhere(page: &mut String) {
    add!(page, "<section id=\"elsewhere\">\n<h2>Measured elsewhere</h2>\n");
    for elsewhere in ELSEWHERE {
        add!(
            page,
            "<div class=\"claim\"><div><h3>The paper says <span class=\"where\">{}</span></h3><p><b>{}.</b> {}</p></div><div><h3>Measured \
             <span class=\"badge\">– not here</span></h3><p>{}</p></div></div>\n",
            elsewhere.section,
            elsewhere.title,
            escaped(elsewhere.statement),
            escaped(elsewhere.by)
        );
    }
    add!(page, "</section>\n");
}

/// Text that no browser takes for markup.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

const STYLE: &str = "
:root{color-scheme:light dark;--page:#f6f6f4;--surface:#ffffff;--ink:#1b1d22;--soft:#5c616b;--line:#d9dade;--link:#0b5fae;
--yes:#005f8c;--part:#8a5a00;--no:#a33a00;/*light*/}
@media(prefers-color-scheme:dark){:root{--page:#14161a;--surface:#1c1f25;--ink:#e8e8e6;--soft:#a2a7b1;--line:#363b45;--link:#7cb8ee;
--yes:#6fbfe8;--part:#e9b44c;--no:#f08a5a;/*dark*/}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--ink);font:16px/1.5 system-ui,sans-serif}
main{max-width:1180px;margin:0 auto;padding:24px 24px 64px}
h1{font-size:30px;line-height:1.2;margin:16px 0 8px}
h2{font-size:23px;margin:48px 0 8px;padding-top:16px;border-top:2px solid var(--line)}
h3{font-size:13px;font-weight:600;color:var(--soft);margin:0 0 4px}
h4,summary{font-size:15px;font-weight:600;margin:24px 0 6px}
summary{cursor:pointer}
p,li{overflow-wrap:anywhere}
p{margin:0 0 8px}
a{color:var(--link)}
code{font:14px ui-monospace,monospace;background:var(--surface);border:1px solid var(--line);border-radius:4px;padding:0 4px}
.lead{font-size:18px;max-width:75ch}
.small,.where{color:var(--soft);font-size:13px;font-weight:400}
.method{color:var(--soft);max-width:95ch}
.note{background:var(--surface);border-left:4px solid var(--part);padding:8px 12px}
.claim{display:grid;grid-template-columns:2fr 3fr;gap:24px;background:var(--surface);border:1px solid var(--line);border-radius:8px;
padding:14px 18px;margin:10px 0}
.claim p{margin:0}
.badge{white-space:nowrap;font-size:13px;font-weight:600;border:1px solid currentColor;border-radius:10px;padding:0 8px;margin-left:4px;color:var(--soft)}
.confirmed{color:var(--yes)}
.partly{color:var(--part)}
.refuted{color:var(--no)}
.claim ul{list-style:none;margin:0 0 6px;padding:0}
.claim li{padding-left:22px;text-indent:-22px}
.claim li span{display:inline-block;width:22px;text-indent:0;font-weight:600}
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,500px),1fr));gap:16px;margin:18px 0}
.pictures{display:flex;flex-wrap:wrap;gap:16px;margin:18px 0}
figure{margin:0;background:var(--surface);border:1px solid var(--line);border-radius:8px;padding:12px}
.charts figure{max-width:760px}
.charts figcaption{font-weight:600;font-size:15px}
.pictures figure{width:213px}
.pictures img{width:100%;aspect-ratio:1;display:block;margin-bottom:6px}
.pictures .broad{width:642px;max-width:100%}
.pictures .broad img{aspect-ratio:auto}
.pictures figcaption{font-size:13px;color:var(--soft)}
svg{width:100%;height:auto;display:block}
.wide{overflow-x:auto}
table{border-collapse:collapse;background:var(--surface);font-size:14px;font-variant-numeric:tabular-nums}
th,td{border:1px solid var(--line);padding:4px 10px;text-align:right;vertical-align:top}
th{font-weight:600}
th:first-child,td:first-child,.overview td,.overview th{text-align:left}
thead th{color:var(--soft)}
.overview{margin-top:16px;width:100%}
@media(max-width:760px){.claim,.charts{grid-template-columns:minmax(0,1fr)}main{padding:12px 12px 48px}.claim{padding:12px}
.overview th,.overview td{padding:4px 6px}}
";

#[cfg(test)]
mod tests {
    use gs_train::experiments::{Axis, Chart, Findings, Number, Series};

    use super::*;
    use crate::paper::files::Figures;

    fn chapter() -> Chapter {
        let drawn = Chart {
            name: "loss",
            title: "Loss".to_owned(),
            x: Axis::linear("step"),
            y: Axis::linear("loss"),
            series: vec![Series::line("one", vec![(0.0, 1.0), (1.0, 2.0)])],
        };
        let claim = Claim {
            name: "c",
            statement: "a < b & c",
            section: "§1",
            circumstances: vec![Circumstance::counted("held < of", [true, false])],
            measured: "1 > 0".to_owned(),
            numbers: vec![Number::new("n", 1.0, "dB")],
        };
        let svg = chart::svg(&drawn).unwrap();
        Chapter {
            experiment: Experiment::Edges,
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
            figures: Figures { charts: vec![svg], pictures: vec![] },
        }
    }

    #[test]
    fn the_page_stands_alone_and_sets_statement_beside_measurement() {
        let setting = |only| Setting { extent: Extent::Quick, only, backend: "cpu" };
        let whole = page(&[chapter()], &setting(None));
        for part in [
            "a &lt; b &amp; c",
            "1 &gt; 0",
            "◐ partly",
            "held &lt; of: 1 of 2",
            "<svg",
            "20 rows",
            "Memory and storage",
            "Quick form",
        ] {
            assert!(whole.contains(part), "{part}");
        }
        let outside = whole.replace("http://www.w3.org/2000/svg", "");
        assert!(!outside.contains("http") && !outside.contains("<script") && !outside.contains("url("), "no network");
        assert!(!page(&[chapter()], &setting(Some(Experiment::Edges))).contains("Memory and storage"));
    }
}
