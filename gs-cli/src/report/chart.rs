//! The charts of the paper's experiments, drawn as the figures of studies are: as a PNG's pixels or as SVG, both from one drawing.
//!
//! Every other line is dashed, so that lines on top of each other are seen, too. In the SVG that goes into a page, every colour is a
//! variable of the page's style, so that it follows the reader's light or dark theme.

use gs_core::Image;
use gs_study::figure::{self, COLORS, Dots, Figure, GRID, INK, Marks, Point};
use gs_train::experiments::{Axis, Chart, Mark, Series, Spread};
use plotters::style::{RGBColor, WHITE};

/// The chart as pixels.
///
/// # Errors
/// What the drawing library reports, in words.
pub(crate) fn picture(chart: &Chart) -> Result<Image, String> {
    drawn(chart).image().map_err(|error| error.to_string())
}

/// The chart as an SVG file's text.
///
/// # Errors
/// What the drawing library reports, in words.
pub(crate) fn svg(chart: &Chart) -> Result<String, String> {
    drawn(chart).svg_file().map_err(|error| error.to_string())
}

/// An SVG of [`svg`] for a page whose style defines `--ink`, `--line`, `--surface` and `--curve-0` to `--curve-6`, and says how wide it is.
pub(crate) fn themed(svg: &str) -> String {
    let hex = |RGBColor(r, g, b): RGBColor| format!("#{r:02X}{g:02X}{b:02X}");
    let surroundings = [(INK, "ink"), (GRID, "line"), (WHITE, "surface")].map(|(color, name)| (color, name.to_owned()));
    let curves = COLORS.into_iter().enumerate().map(|(i, color)| (color, format!("curve-{i}")));
    let text = surroundings
        .into_iter()
        .chain(curves)
        .fold(svg.to_owned(), |text, (color, name)| text.replace(&hex(color), &format!("var(--{name})")));
    // The view box keeps the proportions.
    match (text.find("width=\""), text.find("viewBox=")) {
        (Some(size), Some(view)) if size < view => format!("{}{}", &text[..size], &text[view..]),
        _ => text,
    }
}

/// The style's colours of the curves on a light and on a dark page, as declarations of CSS variables.
pub(crate) fn curve_colors() -> (String, String) {
    let declare = |color: fn(RGBColor) -> [u8; 3]| {
        let each = COLORS.into_iter().map(color).enumerate();
        each.map(|(i, [r, g, b])| format!("--curve-{i}:#{r:02X}{g:02X}{b:02X};")).collect::<String>()
    };
    // On dark, halfway to white for what is dark itself.
    let lighter = |RGBColor(r, g, b): RGBColor| {
        let luma = 0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b);
        [r, g, b].map(|v| if luma < 140.0 { v + (255 - v) / 3 } else { v })
    };
    (declare(|RGBColor(r, g, b)| [r, g, b]), declare(lighter))
}

/// The title is left to the page, or to the file's name.
fn drawn(chart: &Chart) -> Figure {
    let axis = |axis: Axis| match axis.spread {
        Spread::Linear => figure::Axis::linear(axis.label),
        Spread::Logarithmic => figure::Axis::logarithmic(axis.label),
    };
    let line = |(index, series): (usize, &Series)| figure::Series {
        // Styles from the number of colours on are dashed.
        style: index % COLORS.len() + COLORS.len() * (index % 2),
        name: series.label.clone(),
        points: series.points.iter().map(|&(x, y)| Point { x, y, low: y, high: y }).collect(),
        dots: if series.mark == Mark::Dotted { Dots::All } else { Dots::Last },
    };
    let lines = chart.series.iter().enumerate().map(line).collect();
    Figure {
        name: chart.name.to_owned(),
        title: String::new(),
        x: axis(chart.x),
        y: axis(chart.y),
        marks: Marks::Lines(lines),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_axes_and_legend_are_there_in_both_forms() {
        let falling = (1..200).map(|x| (f64::from(x), 0.3 / f64::from(x))).collect();
        let rising = (1..200).map(|x| (f64::from(x), f64::from(x) * 1e-3)).collect();
        let series = vec![Series::line("falling", falling), Series::dotted("rising <&>", rising)];
        let (x, y) = (Axis::linear("step"), Axis::logarithmic("loss, px²"));
        let chart = Chart { name: "test", title: "a test".to_owned(), x, y, series };
        let drawn = picture(&chart).unwrap();
        let count = |RGBColor(r, g, b): RGBColor| {
            let wanted = [r, g, b].map(|v| f32::from(v) / 255.0);
            drawn.pixels().iter().filter(|p| p.iter().zip(wanted).all(|(v, w)| (v - w).abs() < 0.02)).count()
        };
        assert!(count(COLORS[0]) > 300 && count(COLORS[1]) > 300 && count(COLORS[2]) == 0);
        let text = svg(&chart).unwrap();
        for word in ["falling", "rising &lt;&amp;&gt;", "step", "loss, px²", "#0072B2"] {
            assert!(text.contains(word), "{word} in {text}");
        }
        let themed = themed(&text);
        for part in ["var(--curve-0)", "var(--ink)", "var(--line)", "var(--surface)", "<svg viewBox=\"0 0 640 420\""] {
            assert!(themed.contains(part), "{part} in {}", &themed[..300]);
        }
        assert!(!themed.contains("#0072B2"));
    }
}
