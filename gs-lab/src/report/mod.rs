//! The report of a study: one HTML page without network access, and its figures as SVG and PNG.

mod curves;
pub mod figure;
pub(crate) mod html;
mod page;
mod pictures;
mod standings;

use std::fs;

use rayon::prelude::*;

use crate::{
    error::Error,
    report::page::Page,
    result::Results,
    run::{PAGE, PLOTS, StudyFolder},
};

/// Writes `report.html` and `plots/`. The page shows `command` as the way it was made.
///
/// # Errors
/// [`Error::Io`] and [`Error::Path`] for files, [`Error::Picture`] where something cannot be drawn.
pub fn write(results: &Results<'_>, folder: &StudyFolder, command: &str) -> Result<(), Error> {
    let study = &results.plan.study;
    let mut figures = vec![curves::quality_over_count(results)];
    let of_budget = |&budget: &u32| curves::developments(results, budget).collect::<Vec<_>>();
    let of_budgets: Vec<Vec<_>> = study.budgets.par_iter().map(of_budget).collect();
    figures.extend(of_budgets.into_iter().flatten());
    figures.extend(study.matchings.iter().map(|&matching| curves::differences(results, matching)));
    if !study.factors.is_empty() {
        figures.extend(study.matchings.iter().map(|&matching| curves::effects(results, matching)));
    }
    let folder = folder.lock_results()?;
    let plots = folder.file(PLOTS);
    fs::create_dir_all(&plots).map_err(|source| Error::Path { path: plots, source })?;
    folder.claim(
        figures.iter().flat_map(|figure| ["svg", "png"].map(|kind| format!("{PLOTS}/{}.{kind}", figure.name))),
    )?;
    for figure in &figures {
        folder.write(&format!("{PLOTS}/{}.svg", figure.name), &figure.svg_file()?)?;
        gs_io::write_png(folder.file_to_write(&format!("{PLOTS}/{}.png", figure.name)), &figure.image()?)?;
    }
    let most = study.budgets.iter().copied().max().unwrap_or(0);
    let multiples = pictures::multiples(results, most, |run, index| folder.picture(run, index))?;
    let page = Page { results, command, figures: &figures, multiples: &multiples, pictured: most };
    folder.write(PAGE, &page.html()?)
}

/// The leading arm at each budget, at equal count, iterations and time, one line each.
pub fn headlines(results: &Results<'_>) -> Vec<String> {
    standings::standings(results).iter().map(|standing| page::headline(results, standing)).collect()
}
