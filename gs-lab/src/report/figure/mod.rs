//! Figures, drawn as SVG: lines with bands, or intervals. Studies, frontiers and camera flights all
//! use this type; [`curve`] and [`ellipses`] show a single fit.
//!
//! Colours are the palette of Okabe and Ito, which can be distinguished with any kind of colour vision.
//! Lines beyond the seventh are dashed, and markers differ in shape. Ink and grid have one colour
//! each, so that a page can replace them in its dark theme.

mod axis;
pub mod curve;
mod draw;
pub mod ellipses;

pub(crate) use self::axis::grouped;

use crate::result::Interval;

/// Red, green and blue, 0 to 255.
pub(crate) type Rgb = [u8; 3];

/// Colour of text and axes.
pub(crate) const INK: Rgb = [40, 40, 40];
/// Colour of the grid.
pub(crate) const GRID: Rgb = [221, 221, 221];

/// Colours of the lines. *Source:* Okabe and Ito 2008, "Color universal design", without black.
pub(crate) const COLORS: [Rgb; 7] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [230, 159, 0], [86, 180, 233], [148, 130, 0]];

/// Width and height of a figure, px.
const WIDTH: u32 = 640;
const HEIGHT: u32 = 420;

/// A figure, ready to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Figure {
    /// File name without extension.
    pub(crate) name: String,
    /// The title above the figure; in a page, the caption.
    pub(crate) title: String,
    /// The horizontal axis.
    pub(crate) x: Axis,
    /// The vertical axis; unused by [`Marks::Intervals`], which has names there.
    pub(crate) y: Axis,
    /// What is drawn.
    pub(crate) marks: Marks,
}

/// An axis of a figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Axis {
    /// Quantity and unit.
    pub(crate) label: String,
    /// Linear or logarithmic.
    pub(crate) scale: Scale,
}

impl Axis {
    /// A linear axis.
    pub(crate) fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear }
    }

    /// A logarithmic axis; values that are not positive are left out.
    pub(crate) fn logarithmic(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Logarithmic }
    }
}

/// The scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scale {
    /// Equal steps are equal differences.
    Linear,
    /// Equal steps are equal ratios.
    Logarithmic,
}

/// The content of a figure.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Marks {
    /// Lines, each with a band.
    Lines(Vec<Series>),
    /// Means with intervals, one below the other.
    Intervals(Vec<Bar>),
}

impl Marks {
    /// Lines in the order of the legend. Every other line is dashed, so that lines on top of each
    /// other remain visible.
    pub(crate) fn lines(series: Vec<Series>) -> Self {
        let styled = |(index, series): (usize, Series)| {
            let style = index % COLORS.len() + COLORS.len() * (index % 2);
            Series { style, ..series }
        };
        Self::Lines(series.into_iter().enumerate().map(styled).collect())
    }
}

/// Which points of a line have a marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dots {
    /// Every point.
    All,
    /// The last point.
    Last,
    /// Every point, without a line between them.
    Alone,
}

/// A line with a band.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Series {
    /// Index of the line's colour and marker.
    pub(crate) style: usize,
    /// Name of the line in the legend.
    pub(crate) name: String,
    /// Points of the line, by rising x. Points that are not finite are left out.
    pub(crate) points: Vec<FigurePoint>,
    /// Which points have a marker.
    pub(crate) dots: Dots,
}

impl Series {
    /// A line through (x, y), by rising x.
    pub(crate) fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        let points = points.into_iter().map(|(x, y)| FigurePoint { x, y, low: y, high: y }).collect();
        Self { style: 0, name: name.into(), points, dots: Dots::Last }
    }
}

/// A point of a line and of its band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FigurePoint {
    /// Horizontal position.
    pub(crate) x: f64,
    /// The line's value.
    pub(crate) y: f64,
    /// The band's lower edge.
    pub(crate) low: f64,
    /// The band's upper edge.
    pub(crate) high: f64,
}

/// A mean with its interval.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bar {
    /// Style of the bar, as [`Series::style`].
    pub(crate) style: usize,
    /// The bar's label: what the mean is of.
    pub(crate) label: String,
    /// The mean.
    pub(crate) mean: f64,
    /// The interval of the mean, if there are enough runs for one.
    pub(crate) interval: Option<Interval>,
    /// Whether a verdict rests on the mean; the bar is drawn hollow otherwise.
    pub(crate) is_judged: bool,
}

/// The colour of a [`Series::style`], as CSS writes it.
pub(crate) fn color(style: usize) -> String {
    hex(COLORS[style % COLORS.len()])
}

/// A colour as CSS writes it.
pub(crate) fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

impl Figure {
    /// SVG for use in a page, without title and background.
    pub(crate) fn inline_svg(&self) -> String {
        draw::svg(self, true)
    }

    /// The figure as an SVG file.
    pub(crate) fn svg_file(&self) -> String {
        draw::svg(self, false)
    }

    fn height(&self) -> u32 {
        match &self.marks {
            Marks::Lines(..) => HEIGHT,
            Marks::Intervals(bars) => 110 + 22 * bars.len().max(1) as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(marks: Marks) -> Figure {
        let (x, y) = (Axis::logarithmic("time, s"), Axis::linear("PSNR, dB"));
        Figure { name: "f".to_owned(), title: "A title".to_owned(), x, y, marks }
    }

    #[test]
    fn lines_are_drawn_in_their_colours_with_axes_and_units() {
        let points = |from: f64| {
            let x = (1..50).map(f64::from);
            x.map(move |x| FigurePoint { x, y: from + x, low: from, high: from + 2.0 * x }).collect()
        };
        let one = |style: usize| {
            let name = format!("<arm{style}>");
            Series { style, name, points: points(style as f64), dots: Dots::Last }
        };
        let figure = figure(Marks::Lines((0..9).map(one).collect()));
        let svg = figure.inline_svg();
        assert!(figure.svg_file().contains("A title") && !svg.contains("A title"));
        assert_eq!(svg.matches("stroke-dasharray").count(), 2 * 2, "the eighth and the ninth, with their legends");
        for expected in ["time, s", "PSNR, dB", "&lt;arm8&gt;", "#0072B2", "#282828"] {
            assert!(svg.contains(expected), "{expected}");
        }
        assert!(figure.svg_file().contains("#FFFFFF") && !svg.contains("#FFFFFF"));
    }

    #[test]
    fn any_numbers_make_a_figure() {
        let point = |x, y| FigurePoint { x, y, low: y, high: y };
        let lines = [
            vec![],
            vec![point(1.0, 2.0)],
            vec![point(0.0, 1e9), point(1e-9, 1e9)],
            vec![point(0.0, 0.0), point(f64::NAN, 1.0)],
            vec![point(-1.0, -2.0), point(3.0, f64::INFINITY)],
            vec![point(1e-30, 1e30), point(1e30, 1e-30)],
        ];
        for points in lines {
            for x in [Scale::Linear, Scale::Logarithmic] {
                for y in [Scale::Linear, Scale::Logarithmic] {
                    let line = Series { style: 0, name: String::new(), points: points.clone(), dots: Dots::All };
                    let mut drawn = figure(Marks::Lines(vec![line]));
                    (drawn.x.scale, drawn.y.scale) = (x, y);
                    let svg = drawn.svg_file();
                    assert!(
                        svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"),
                        "{points:?}: {svg}"
                    );
                }
            }
        }
        assert!(!figure(Marks::Intervals(vec![])).svg_file().contains("NaN"));
    }
}
