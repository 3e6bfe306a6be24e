//! Exports a frontier as text table, CSV and figure. The JSON form is its serialisation.

use std::fmt::Write;

use gs_core::{counted, profile::Quantiles};

use super::{Frontier, Measured, Role};
use crate::report::figure::{Axis, Dots, Figure, FigurePoint, Marks, Series};

/// Smaller errors are drawn at this value; they are due to rounding.
const LEAST_ERROR: f64 = 1e-8;

/// A CSV table of all rows, with times in seconds; `changes` are separated by semicolons. Times of
/// a backend whose ratio is below `noise` do not differ.
pub fn to_csv(frontier: &Frontier) -> String {
    let mut csv = String::from(
        "backend,machine,role,changes,seconds,seconds_low,seconds_high,rounds,compared_with_default,max_error,mean_error,psnr_db,\
         share_visible,on_frontier,noise\n",
    );
    for row in &frontier.rows {
        let Quantiles { low, median, high } = row.times();
        let changes = row.changes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
        let Measured { backend, machine, error, .. } = row;
        let _ = writeln!(
            csv,
            "{backend},\"{machine}\",{},\"{changes}\",{median},{low},{high},{},{},{},{},{},{},{},{}",
            role_name(row.role),
            row.seconds.len(),
            row.comparison.words(),
            error.max,
            error.mean,
            error.psnr(),
            error.share_visible,
            row.on_frontier,
            frontier.noise_of(backend).factor
        );
    }
    csv
}

/// A text table for each backend, quickest first; `*` marks rows on its frontier.
pub fn to_text(frontier: &Frontier) -> String {
    let mut text = String::new();
    let widest = frontier.rows.iter().map(|row| row.name().chars().count()).max().unwrap_or(0).max(8);
    for backend in &frontier.noise {
        let own = || frontier.rows.iter().filter(|row| row.backend == backend.backend);
        let default = own().find(|row| row.role == Role::Default);
        let usual = default.map_or(f64::NAN, |row| row.times().median);
        let machine = default.map_or(backend.backend.as_str(), |row| row.machine.as_str());
        let _ = writeln!(
            text,
            "{machine}: times that differ by less than {:.1} % count as equal (the default measured again: {:+.1} %)\n",
            100.0 * (backend.noise.factor - 1.0),
            100.0 * (backend.noise.again - 1.0)
        );
        let _ = writeln!(
            text,
            "  {:<widest$}{:>9}{:>9}{:>9}{:>8}  {:<14}{:>10}{:>10}{:>8}{:>10}",
            "settings", "ms", "10 %", "90 %", "x", "than default", "max error", "mean", "PSNR", "> 1/255"
        );
        for row in own() {
            let Quantiles { low, median, high } = row.times().times(1e3);
            let _ = writeln!(
                text,
                "{} {:<widest$}{median:>9.3}{low:>9.3}{high:>9.3}{:>8.2}  {:<14}{:>10.1e}{:>10.1e}{:>8.1}{:>8.2} %",
                if row.on_frontier { "*" } else { " " },
                row.name(),
                1e-3 * median / usual,
                row.comparison.words(),
                row.error.max,
                row.error.mean,
                row.error.psnr(),
                100.0 * row.error.share_visible
            );
        }
        for refused in frontier.refused.iter().filter(|refused| refused.backend == backend.backend) {
            let _ = writeln!(text, "  {}: not supported ({})", refused.what, refused.why);
        }
        text.push('\n');
    }
    let _ = write!(
        text,
        "*: on the frontier: no other settings of the backend are both quicker and as exact. x: time divided by the default's. Errors are \
         maxima over all channels and pixels of {}, against the 64-bit oracle, which computed {} and the worst pixel of each picture. A \
         rendering within {:.0e} of the oracle locates the worst pixels.",
        counted(frontier.views, "view"),
        counted(frontier.sampled, "pixel"),
        frontier.uncertainty
    );
    text
}

/// A figure of the largest error against time, both logarithmic: the frontier of each backend as a
/// line, all other settings as points, the default and 3DGS marked.
pub fn figure(frontier: &Frontier, title: &str) -> Figure {
    let point = |row: &Measured| {
        let (x, y) = (1e3 * row.times().median, row.error.max.max(LEAST_ERROR));
        FigurePoint { x, y, low: y, high: y }
    };
    let mut series = Vec::new();
    let mut style = 0;
    for backend in frontier.noise.iter().map(|noise| &noise.backend) {
        let own = || frontier.rows.iter().filter(|row| row.backend == *backend);
        let mut add = |name: String, points: Vec<FigurePoint>, dots: Dots| {
            if !points.is_empty() {
                series.push(Series { style, name, points, dots });
            }
            style += 1;
        };
        let steps: Vec<FigurePoint> = own().filter(|row| row.on_frontier).map(point).collect();
        add(format!("{backend}: best trade-offs"), steps, Dots::All);
        let others = own().filter(|row| !row.on_frontier && row.role != Role::Again).map(point).collect();
        add(format!("{backend}: other settings"), others, Dots::Alone);
        for (role, name) in [(Role::Default, "default"), (Role::ThreeDgs, "as in 3DGS")] {
            add(format!("{backend}: {name}"), own().filter(|row| row.role == role).map(point).collect(), Dots::Alone);
        }
    }
    Figure {
        name: "frontier".to_owned(),
        title: title.to_owned(),
        x: Axis::logarithmic("time of a view, ms"),
        y: Axis::logarithmic("largest error of a pixel"),
        marks: Marks::Lines(series),
    }
}

fn role_name(role: Role) -> &'static str {
    match role {
        Role::Default => "default",
        Role::Again => "again",
        Role::ThreeDgs => "3dgs",
        Role::Tightest => "tightest",
        Role::Alone => "alone",
        Role::Together => "together",
    }
}
