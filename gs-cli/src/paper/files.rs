//! The files of `gs paper`: tables and curves as CSV, charts as PNG and SVG, pictures as PNG.

use std::{fmt::Write as _, fs};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use gs_io::write_png;
use gs_train::experiments::{Chart, Experiment, Findings, Picture, Table};

use crate::{
    failure::Failure,
    output_folder::OutputFolder,
    paper::Chapter,
    report::{chart, ellipses},
};

/// The page.
pub(super) const PAGE: &str = "index.html";
/// The table of claims.
pub(super) const CLAIMS: &str = "claims.csv";

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
    folder.make(experiment.name())?;
    write_findings(folder, &format!("{}/", experiment.name()), findings)
}

/// Writes tables, charts and pictures, all of whose names in the folder begin with `part`.
///
/// # Errors
/// Where a file is in the way or cannot be written, or a chart cannot be drawn.
pub(crate) fn write_findings(folder: &OutputFolder, part: &str, findings: &Findings) -> Result<Figures, Failure> {
    let Findings { tables, charts, pictures, .. } = findings;
    let of_tables = tables.iter().map(|table| table_name(part, table));
    let of_parameterization =
        charts.iter().flat_map(|chart| ["csv", "png", "svg"].map(|kind| chart_name(part, chart, kind)));
    let of_pictures = pictures.iter().map(|picture| picture_name(part, picture));
    folder.claim(of_tables.chain(of_parameterization).chain(of_pictures))?;
    for table in tables {
        folder.write_text(&table_name(part, table), &table_csv(table))?;
    }
    let charts = charts.iter().map(|chart| write_chart(folder, part, chart)).collect::<Result<_, _>>()?;
    let pictures = pictures.iter().map(|picture| write_picture(folder, part, picture)).collect::<Result<_, _>>()?;
    Ok(Figures { charts, pictures })
}

fn table_name(part: &str, table: &Table) -> String {
    format!("{part}{}.csv", table.name)
}

fn chart_name(part: &str, chart: &Chart, kind: &str) -> String {
    format!("{part}{}-chart.{kind}", chart.name)
}

fn picture_name(part: &str, picture: &Picture) -> String {
    format!("{part}{}.png", picture.name)
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
    folder.write_text(CLAIMS, &csv)
}

fn write_chart(folder: &OutputFolder, part: &str, drawn: &Chart) -> Result<String, Failure> {
    let failed = |error: String| Failure::failed(error).at(drawn.name);
    let mut csv = format!("series,{},{}\n", quoted(drawn.x.label), quoted(drawn.y.label));
    for series in &drawn.series {
        for (x, y) in &series.points {
            add_row(&mut csv, [series.label.as_str(), &x.to_string(), &y.to_string()]);
        }
    }
    folder.write_text(&chart_name(part, drawn, "csv"), &csv)?;
    write_png(folder.file(&chart_name(part, drawn, "png")), &chart::picture(drawn).map_err(failed)?)?;
    let svg = chart::svg(drawn).map_err(failed)?;
    folder.write_text(&chart_name(part, drawn, "svg"), &svg)?;
    Ok(svg)
}

/// Writes a picture and returns it as a data URI.
fn write_picture(folder: &OutputFolder, part: &str, picture: &Picture) -> Result<String, Failure> {
    let file = folder.file(&picture_name(part, picture));
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
