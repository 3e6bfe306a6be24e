//! The table of several images.

use std::path::Path;

use gs_core::{counted, metrics::mean};

use super::{Row, shown};
use crate::terminal::output;

const COLUMNS: [&str; 7] = ["image", "size, px", "bytes", "bits/px", "Gaussians", "PSNR, dB", "time, s"];

/// The table, with a line of totals: sums, bits per pixel of all, the mean of PSNRs that are finite,
/// and the time that passed.
pub(super) fn table(rows: &[(&Path, Row)], elapsed: f64) -> String {
    let mut lines = vec![COLUMNS.map(str::to_owned).to_vec()];
    lines.extend(rows.iter().map(|(file, row)| cells(shown(file), row)));
    lines.push(totals(rows, elapsed));
    output::in_columns(&lines)
}

fn cells(name: String, row: &Row) -> Vec<String> {
    let (width, height) = row.size;
    vec![
        name,
        format!("{width}x{height}"),
        row.bytes.to_string(),
        format!("{:.3}", row.bpp()),
        row.gaussians.to_string(),
        decibels(row.psnr),
        format!("{:.2}", row.seconds),
    ]
}

fn totals(rows: &[(&Path, Row)], elapsed: f64) -> Vec<String> {
    let pixels: f64 = rows.iter().map(|(_, row)| row.pixels()).sum();
    let bytes: u64 = rows.iter().map(|(_, row)| row.bytes).sum();
    let psnrs: Vec<f64> = rows.iter().map(|(_, row)| row.psnr).filter(|psnr| psnr.is_finite()).collect();
    let bpp = if pixels > 0.0 { bytes as f64 * 8.0 / pixels } else { 0.0 };
    vec![
        counted(rows.len(), "image"),
        format!("{:.2} M", pixels / 1e6),
        bytes.to_string(),
        format!("{bpp:.3}"),
        rows.iter().map(|(_, row)| row.gaussians).sum::<usize>().to_string(),
        if psnrs.is_empty() { "–".to_owned() } else { format!("mean {:.2}", mean(psnrs)) },
        format!("{elapsed:.2}"),
    ]
}

/// A PSNR with two digits.
pub(super) fn decibels(psnr: f64) -> String {
    if psnr.is_finite() { format!("{psnr:.2}") } else { "infinite".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_summed() {
        let row = |bytes, psnr| Row { size: (100, 80), bytes, gaussians: 50, psnr, seconds: 1.0 };
        let rows = [(Path::new("long/a.png"), row(1000, 30.0)), (Path::new("b.png"), row(3000, f64::INFINITY))];
        let text = table(&rows, 1.25);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines.iter().all(|line| line.chars().count() == lines[0].chars().count()), "{text}");
        let words = |line: &str| line.split("  ").map(str::trim).filter(|w| !w.is_empty()).map(str::to_owned).collect();
        let [second, last]: [Vec<String>; 2] = [words(lines[2]), words(lines[3])];
        assert_eq!(second, ["b.png", "100x80", "3000", "3.000", "50", "infinite", "1.00"]);
        assert_eq!(last, ["2 images", "0.02 M", "4000", "2.000", "100", "mean 30.00", "1.25"]);
    }
}
