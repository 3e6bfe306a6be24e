//! The report of a study: one HTML page without network access, and its figures as SVG.

pub(crate) mod claims;
mod curves;
pub(crate) mod figure;
pub(crate) mod html;
mod page;
mod pictures;
mod standings;
mod table;

use std::fs;

use rayon::prelude::*;

pub use self::figure::{curve, ellipses};
pub(crate) use self::table::{Cell, Table};
pub use crate::result::significant;
use crate::{
    error::Error,
    report::{
        figure::{Axis, Figure, Marks, Series},
        page::Page,
    },
    result::{Results, write_tables},
    run::{PAGE, PLOTS, StudyFolder},
};

/// A chart of lines through (x, y), by rising x, as an SVG file. Its horizontal axis is logarithmic.
pub fn line_chart(
    title: &str,
    [x, y]: [&str; 2],
    lines: impl IntoIterator<Item = (&'static str, Vec<(f64, f64)>)>,
) -> String {
    let lines = lines.into_iter().map(|(name, points)| Series::line(name, points));
    let (name, title) = ("chart".to_owned(), title.to_owned());
    Figure { name, title, x: Axis::logarithmic(x), y: Axis::linear(y), marks: Marks::lines(lines.collect()) }.svg_file()
}

/// Writes the tables, `report.html` and `plots/`. The page shows `command` as the way it was made.
///
/// # Errors
/// [`Error::Io`] and [`Error::Path`] for files, [`Error::Picture`] where something cannot be drawn.
pub fn write(results: &Results<'_>, folder: &StudyFolder, command: &str) -> Result<(), Error> {
    write_tables(results, folder)?;
    let figures = figures(results);
    let output = folder.lock_results()?;
    let plots = folder.file(PLOTS);
    fs::create_dir_all(&plots).map_err(|source| Error::Path { path: plots, source })?;
    let file = |figure: &Figure| format!("{PLOTS}/{}.svg", figure.name);
    output.claim(figures.iter().map(file))?;
    figures.iter().try_for_each(|figure| output.write(&file(figure), figure.svg_file()))?;
    let pictured = results.plan.study.budgets.iter().copied().max().unwrap_or(0);
    let multiples = pictures::multiples(results, pictured, |run, index| folder.picture(run, index))?;
    let page = Page { results, command, figures: &figures, multiples: &multiples, pictured };
    Ok(output.write(PAGE, page.html())?)
}

fn figures(results: &Results<'_>) -> Vec<Figure> {
    let study = &results.plan.study;
    let mut figures = vec![curves::quality_over_count(results)];
    let of_budget = |&budget: &u32| curves::developments(results, budget).collect::<Vec<_>>();
    let of_budgets: Vec<Vec<_>> = study.budgets.par_iter().map(of_budget).collect();
    figures.extend(of_budgets.into_iter().flatten());
    figures.extend(study.matchings.iter().map(|&matching| curves::differences(results, matching)));
    if !study.factors.is_empty() {
        figures.extend(study.matchings.iter().map(|&matching| curves::effects(results, matching)));
    }
    figures
}

/// The leading arm at each budget, at equal count, iterations and time, and the verdict on each
/// claim, one line each.
pub fn headlines(results: &Results<'_>) -> Vec<String> {
    let claims = results.claims().into_iter().map(|claim| format!("claim {}: {}", claim.name, claim.verdict()));
    standings::standings(results).iter().map(|standing| page::headline(results, standing)).chain(claims).collect()
}
