//! The files of `gs paper`: tables and curves as CSV, charts as PNG and SVG, pictures as PNG.

use std::{fmt::Write as _, fs, path::Path};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use gs_io::{write_atomically, write_png};
use gs_train::experiments::{Chart, Experiment, Findings, Picture, Table};

use crate::{
    failure::Failure,
    fit::folder::OutputFolder,
    paper::Chapter,
    report::{chart, ellipses},
};

/// What the page shows of an experiment's figures, in the order of its findings.
pub(crate) struct Figures {
    /// The charts as SVG.
    pub(super) charts: Vec<String>,
    /// The pictures as data URIs.
    pub(super) pictures: Vec<String>,
}

/// Writes an experiment's tables, charts and pictures into a folder of its own.
///
/// # Errors
/// Where a file cannot be written or a chart not be drawn.
pub(super) fn write_experiment(
    folder: &OutputFolder,
    experiment: Experiment,
    findings: &Findings,
) -> Result<Figures, Failure> {
    write_findings(&OutputFolder::prepare(&folder.file(experiment.name()), "--output")?, findings)
}

/// Writes tables, charts and pictures.
///
/// # Errors
/// Where a file cannot be written or a chart not be drawn.
pub(crate) fn write_findings(folder: &OutputFolder, findings: &Findings) -> Result<Figures, Failure> {
    for table in &findings.tables {
        write_text(&folder.file(&format!("{}.csv", table.name)), &table_csv(table))?;
    }
    let charts = findings.charts.iter().map(|chart| write_chart(folder, chart)).collect::<Result<_, _>>()?;
    let pictures = findings.pictures.iter().map(|picture| write_picture(folder, picture)).collect::<Result<_, _>>()?;
    Ok(Figures { charts, pictures })
}

/// Writes all claims with their verdicts, one row for each circumstance, with how often it holds, and one for each number.
///
/// # Errors
/// Where the file cannot be written.
pub(super) fn write_claims(folder: &OutputFolder, chapters: &[Chapter]) -> Result<(), Failure> {
    let mut csv = "experiment,claim,section,verdict,number,value,unit\n".to_owned();
    for Chapter { experiment, findings, .. } in chapters {
        for claim in &findings.claims {
            let verdict = claim.verdict().to_string();
            let mut add = |what: &str, value: &str, unit: &str| {
                add_row(&mut csv, [experiment.name(), claim.name, claim.section, &verdict, what, value, unit]);
            };
            for circumstance in &claim.circumstances {
                add(&circumstance.what, &circumstance.held.to_string(), &format!("of {}", circumstance.of));
            }
            for number in &claim.numbers {
                add(&number.what, &number.value.to_string(), number.unit);
            }
        }
    }
    write_text(&folder.file("claims.csv"), &csv)
}

/// Writes a text file, whole or not at all.
///
/// # Errors
/// Where it cannot be written.
pub(super) fn write_text(file: &Path, text: &str) -> Result<(), Failure> {
    write_atomically(file, |out| out.write_all(text.as_bytes())).map_err(Failure::from)
}

fn write_chart(folder: &OutputFolder, drawn: &Chart) -> Result<String, Failure> {
    let failed = |error: String| Failure::failed(error).at(drawn.name);
    let mut csv = format!("series,{},{}\n", quoted(drawn.x.label), quoted(drawn.y.label));
    for series in &drawn.series {
        for (x, y) in &series.points {
            add_row(&mut csv, [series.label.as_str(), &x.to_string(), &y.to_string()]);
        }
    }
    let name = |extension: &str| folder.file(&format!("{}-chart.{extension}", drawn.name));
    write_text(&name("csv"), &csv)?;
    write_png(name("png"), &chart::picture(drawn).map_err(failed)?)?;
    let svg = chart::svg(drawn).map_err(failed)?;
    write_text(&name("svg"), &svg)?;
    Ok(svg)
}

/// Writes a picture and returns it as a data URI.
fn write_picture(folder: &OutputFolder, picture: &Picture) -> Result<String, Failure> {
    let file = folder.file(&format!("{}.png", picture.name));
    let mut image = picture.image.clone();
    if let Some((scene, canvas)) = &picture.ellipses {
        ellipses::draw(&mut image, scene, canvas);
    }
    write_png(&file, &image)?;
    let bytes = fs::read(&file).map_err(|error| Failure::failed(error).at(file.display()))?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
}

fn table_csv(table: &Table) -> String {
    let mut csv = String::new();
    add_row(&mut csv, table.columns.iter().copied());
    for row in &table.rows {
        add_row(&mut csv, row.iter().map(ToString::to_string));
    }
    csv
}

fn add_row<T: AsRef<str>>(csv: &mut String, cells: impl IntoIterator<Item = T>) {
    let cells: Vec<String> = cells.into_iter().map(|cell| quoted(cell.as_ref())).collect();
    let written = writeln!(csv, "{}", cells.join(","));
    debug_assert!(written.is_ok(), "a string can always be written to");
}

/// A cell as RFC 4180 has it.
fn quoted(cell: &str) -> String {
    match cell.contains([',', '"', '\n']) {
        true => format!("\"{}\"", cell.replace('"', "\"\"")),
        false => cell.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_quoted_where_they_must_be() {
        let table = Table {
            name: "t",
            title: String::new(),
            columns: vec!["a, px", "b"],
            rows: vec![vec!["x \"y\"".into(), 3u32.into()]],
        };
        assert_eq!(table_csv(&table), "\"a, px\",b\n\"x \"\"y\"\"\",3\n");
    }
}
