//! The tables of a study for a text: Markdown, and LaTeX with the package booktabs.

use std::fmt::Write;

use super::{
    contrast::Judged,
    statistics::mean,
    tables::{Metric, Results, Spread},
};
use crate::{run::Finished, study::Matching};

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TextTable {
    caption: String,
    /// Names of the columns; the first column has names, the others numbers.
    header: Vec<String>,
    rows: Vec<Vec<Cell>>,
}

/// A cell.
#[derive(Debug, Clone, PartialEq)]
struct Cell {
    text: String,
    is_best: bool,
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self { text, is_best: false }
    }
}

/// The text of a number, and its value.
type Number = (String, Option<f64>);

impl TextTable {
    /// A table whose best number in each column is emphasised. A row is a name and
    /// numbers; more is better, and columns without values have no best.
    fn with_best(caption: String, header: Vec<String>, rows: Vec<(String, Vec<Number>)>) -> Self {
        // Numbers that print alike are equally good.
        let best = |column: usize| {
            let valued = rows.iter().filter_map(|(_, cells)| Some((&cells[column].0, cells[column].1?)));
            valued.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(text, _)| text.clone())
        };
        let best: Vec<Option<String>> = (1..header.len()).map(|column| best(column - 1)).collect();
        let cell = |(column, (text, value)): (usize, &Number)| Cell {
            text: text.clone(),
            is_best: rows.len() > 1 && value.is_some() && best[column].as_ref() == Some(text),
        };
        let row = |(name, cells): &(String, Vec<Number>)| {
            std::iter::once(name.clone().into()).chain(cells.iter().enumerate().map(cell)).collect()
        };
        Self { caption, header, rows: rows.iter().map(row).collect() }
    }

    /// The table in Markdown, with its caption above.
    fn markdown(&self) -> String {
        let escaped = |text: &str| text.replace('|', "\\|");
        let line = |cells: &mut dyn Iterator<Item = String>| format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "));
        let mut text = format!("**{}**\n\n", self.caption);
        text += &line(&mut self.header.iter().map(|name| escaped(name)));
        text += &line(&mut (0..self.header.len()).map(|i| if i == 0 { "---" } else { "---:" }.to_owned()));
        for row in &self.rows {
            text += &line(&mut row.iter().map(|cell| match cell.is_best {
                true => format!("**{}**", escaped(&cell.text)),
                false => escaped(&cell.text),
            }));
        }
        text
    }

    /// The table in LaTeX: a `table` with a `tabular` of booktabs.
    fn latex(&self) -> String {
        let line =
            |cells: &mut dyn Iterator<Item = String>| format!("{} \\\\\n", cells.collect::<Vec<_>>().join(" & "));
        let columns = "r".repeat(self.header.len() - 1);
        let mut text = format!("\\begin{{table}}\n\\centering\n\\begin{{tabular}}{{l{columns}}}\n\\toprule\n");
        text += &line(&mut self.header.iter().map(|name| latex(name)));
        text += "\\midrule\n";
        for row in &self.rows {
            text += &line(&mut row.iter().map(|cell| match cell.is_best {
                true => format!("\\textbf{{{}}}", latex(&cell.text)),
                false => latex(&cell.text),
            }));
        }
        let _ = writeln!(text, "\\bottomrule\n\\end{{tabular}}\n\\caption{{{}}}\n\\end{{table}}", latex(&self.caption));
        text
    }
}

/// A text with the characters that LaTeX reserves escaped, and signs in math.
fn latex(text: &str) -> String {
    let mut escaped = String::new();
    for letter in text.chars() {
        match letter {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => escaped.extend(['\\', letter]),
            '\\' => escaped += "\\textbackslash{}",
            '~' => escaped += "\\textasciitilde{}",
            '^' => escaped += "\\textasciicircum{}",
            '±' => escaped += "$\\pm$",
            '−' => escaped += "$-$",
            other => escaped.push(other),
        }
    }
    escaped
}

/// All tables of a study as one Markdown and one LaTeX text.
pub(crate) fn texts(results: &Results<'_>) -> (String, String) {
    let tables = tables(results);
    let markdown: Vec<String> = tables.iter().map(TextTable::markdown).collect();
    let latex: Vec<String> = tables.iter().map(TextTable::latex).collect();
    (markdown.join("\n"), format!("% Needs \\usepackage{{booktabs}}.\n\n{}", latex.join("\n")))
}

/// The quality of each arm, the metrics on each image or scene, and the differences from the baseline,
/// at each budget. Times are left out, so that the tables depend on no clock.
fn tables(results: &Results<'_>) -> Vec<TextTable> {
    let metrics: Vec<Metric> = Metric::ALL.into_iter().filter(|&metric| results.is_measured(metric)).collect();
    let mut tables = Vec::new();
    for &budget in &results.plan.study.budgets {
        tables.push(quality(results, budget, &metrics));
        if results.plan.targets.len() > 1 {
            tables.extend(metrics.iter().map(|&metric| of_targets(results, budget, metric)));
        }
        tables.extend(differences(results, budget));
    }
    tables
}

fn quality(results: &Results<'_>, budget: u32, metrics: &[Metric]) -> TextTable {
    let study = &results.plan.study;
    let spread = |spread: Option<Spread>, digits: usize| match spread {
        None => ("–".to_owned(), None),
        Some(Spread { mean, over_seeds: None }) => (format!("{mean:.digits$}"), Some(mean)),
        Some(Spread { mean, over_seeds: Some(sd) }) => (format!("{mean:.digits$} ± {sd:.digits$}"), Some(mean)),
    };
    let row = |arm: usize| {
        let of = |metric: Metric| spread(results.spread(arm, budget, |run| metric.of(run)), digits(metric));
        let count = spread(results.spread(arm, budget, |run| Some(f64::from(run.gaussians))), 0);
        let cells = std::iter::once((count.0, None)).chain(metrics.iter().map(|&metric| of(metric)));
        (study.arms[arm].name.clone(), cells.collect())
    };
    let header = ["arm", "Gaussians"].into_iter().chain(metrics.iter().map(|&metric| title(metric)));
    let caption = format!(
        "{}: quality with at most {budget} Gaussians. Mean over {} {} and {} seeds; ± is the standard deviation of a run over seeds.",
        study.name,
        results.plan.targets.len(),
        plural(results),
        study.seeds.len(),
    );
    TextTable::with_best(caption, header.map(str::to_owned).collect(), (0..study.arms.len()).map(row).collect())
}

/// A metric on each image or scene.
fn of_targets(results: &Results<'_>, budget: u32, metric: Metric) -> TextTable {
    let plan = results.plan;
    let mean_of = |arm: usize, target: usize| {
        let runs = results.finished(arm, budget).filter(|(run, _)| run.target == target);
        let value = mean(runs.filter_map(|(_, end): (_, &Finished)| metric.of(end)));
        let digits = digits(metric);
        if value.is_nan() { ("–".to_owned(), None) } else { (format!("{value:.digits$}"), Some(value)) }
    };
    let row = |arm: usize| {
        let cells = (0..plan.targets.len()).map(|target| mean_of(arm, target)).collect();
        (plan.study.arms[arm].name.clone(), cells)
    };
    let names = plan.targets.iter().map(|target| target.name.clone());
    let caption = format!(
        "{}: {} of each {} with at most {budget} Gaussians, mean over {} seeds.",
        plan.study.name,
        title(metric),
        plan.study.target_word(),
        plan.study.seeds.len(),
    );
    TextTable::with_best(
        caption,
        std::iter::once("arm".to_owned()).chain(names).collect(),
        (0..plan.study.arms.len()).map(row).collect(),
    )
}

/// The differences from the baseline in PSNR, after equal iterations and at equal count.
fn differences(results: &Results<'_>, budget: u32) -> Vec<TextTable> {
    let study = &results.plan.study;
    let baseline = study.baseline_arm();
    let others: Vec<usize> = (0..study.arms.len()).filter(|&arm| arm != baseline).collect();
    let matchings = study.matchings.iter().filter(|matching| **matching != Matching::Time);
    let table = |&matching: &Matching| {
        let row = |&arm: &usize| {
            let Judged { of, mean, interval, verdict, .. } =
                results.difference(matching, Metric::Psnr, budget, arm, baseline);
            let signed = |value: f64| format!("{value:+.2}").replace('-', "−");
            let mean = mean.map_or_else(|| "–".to_owned(), signed);
            let interval = interval.map(|i| format!("{} to {}", signed(i.low), signed(i.high)));
            let cells = [of.arm, mean, interval.unwrap_or_else(|| "–".to_owned()), verdict.words().to_owned()];
            cells.map(Cell::from).to_vec()
        };
        TextTable {
            caption: format!(
                "{}: PSNR less that of {}, at equal {}, with at most {budget} Gaussians.",
                study.name,
                study.arms[baseline].name,
                matching.name(),
            ),
            header: ["arm", "difference, dB", "95 % interval", "verdict"].map(str::to_owned).to_vec(),
            rows: others.iter().map(row).collect(),
        }
    };
    if others.is_empty() { Vec::new() } else { matchings.map(table).collect() }
}

const fn digits(metric: Metric) -> usize {
    match metric {
        Metric::Psnr => 2,
        Metric::Ssim | Metric::MsSsim => 4,
    }
}

const fn title(metric: Metric) -> &'static str {
    match metric {
        Metric::Psnr => "PSNR, dB",
        Metric::Ssim => "SSIM",
        Metric::MsSsim => "MS-SSIM",
    }
}

fn plural(results: &Results<'_>) -> String {
    let word = results.plan.study.target_word();
    if results.plan.targets.len() == 1 { word.to_owned() } else { format!("{word}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> TextTable {
        let row = |name: &str, psnr: f64| (name.to_owned(), vec![(format!("{psnr:.2} ± 0.10"), Some(psnr))]);
        let rows = vec![row("a_b", 30.0), row("c|d", 31.004), row("e", 31.001)];
        TextTable::with_best("50 % of it".to_owned(), ["arm", "PSNR, dB"].map(str::to_owned).to_vec(), rows)
    }

    #[test]
    fn the_best_of_a_column_is_bold_in_markdown() {
        let text = table().markdown();
        let expected = "**50 % of it**\n\n| arm | PSNR, dB |\n| --- | ---: |\n| a_b | 30.00 ± 0.10 |\n";
        assert!(text.starts_with(expected), "{text}");
        assert!(text.contains("| c\\|d | **31.00 ± 0.10** |\n| e | **31.00 ± 0.10** |"), "{text}");
    }

    #[test]
    fn latex_has_rules_and_escaped_names() {
        let text = table().latex();
        for part in [
            "\\begin{tabular}{lr}\n\\toprule",
            "a\\_b & 30.00 $\\pm$ 0.10 \\\\",
            "\\textbf{31.00",
            "\\caption{50 \\% of",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}
