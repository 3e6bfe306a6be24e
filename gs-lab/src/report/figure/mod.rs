//! Figures, drawn as SVG and as pixels by the same code: lines with bands, or intervals. Studies,
//! the paper's experiments and frontiers all use this type; [`curve`] and [`ellipses`] show a
//! single fit.
//!
//! Colours are the palette of Okabe and Ito, which can be distinguished with any kind of colour vision.
//! Lines beyond the seventh are dashed, and markers differ in shape. Ink and grid have one colour
//! each, so that a page can replace them in its dark theme. The font is embedded (Hack, MIT
//! licence), so that pictures are the same on every machine.

mod axis;
pub mod curve;
mod draw;
pub mod ellipses;
mod surface;

use std::sync::Once;

pub(crate) use self::axis::grouped;

use crate::result::Interval;
use gs_core::Image;
use plotters::{
    prelude::*,
    style::{FontStyle, register_font},
};

use self::{draw::Drawing, surface::Surface};

use crate::error::Error;

/// Colour of text and axes.
pub(crate) const INK: RGBColor = RGBColor(40, 40, 40);
/// Colour of the grid.
pub(crate) const GRID: RGBColor = RGBColor(221, 221, 221);

/// Colours of the lines. *Source:* Okabe and Ito 2008, "Color universal design", without black.
pub(crate) const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(148, 130, 0),
];

/// The family under which [`embed_font`] registers the font.
pub(crate) const FONT: &str = "sans-serif";

/// Width and height of a figure, px.
const WIDTH: u32 = 640;
const HEIGHT: u32 = 420;
/// Scale of the pixel image, for sharp text.
const SHARPNESS: u32 = 2;

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

    /// A line with a marker at each point, for few points.
    pub(crate) fn dotted(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { dots: Dots::All, ..Self::line(name, points) }
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

/// The background of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Paper {
    White,
    /// Transparent, for use in a page.
    Clear,
}

/// The colour of a [`Series::style`].
pub(crate) fn color(style: usize) -> RGBColor {
    COLORS[style % COLORS.len()]
}

/// Registers [`FONT`] with the drawing library, once.
pub(crate) fn embed_font() {
    static ONCE: Once = Once::new();
    // If the font cannot be read, drawing the first text fails.
    ONCE.call_once(|| drop(register_font(FONT, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR)));
}

impl Figure {
    /// The lines; empty for a figure of intervals.
    pub(crate) fn lines(&self) -> &[Series] {
        match &self.marks {
            Marks::Lines(series) => series,
            Marks::Intervals(_) => &[],
        }
    }

    /// SVG for use in a page, without title and background.
    ///
    /// # Errors
    /// [`Error::Picture`] with what the drawing library reports.
    pub(crate) fn inline_svg(&self) -> Result<String, Error> {
        self.svg(Paper::Clear)
    }

    /// The figure as an SVG file.
    ///
    /// # Errors
    /// [`Error::Picture`] with what the drawing library reports.
    pub(crate) fn svg_file(&self) -> Result<String, Error> {
        self.svg(Paper::White)
    }

    /// The figure as pixels.
    ///
    /// # Errors
    /// [`Error::Picture`] with what the drawing library reports.
    pub(crate) fn image(&self) -> Result<Image, Error> {
        let (width, height) = (WIDTH * SHARPNESS, self.height() * SHARPNESS);
        let mut bytes = vec![255; 3 * (width * height) as usize];
        let surface = Surface::Pixels(BitMapBackend::with_buffer(&mut bytes, (width, height)));
        self.draw(surface, Paper::White, SHARPNESS)?;
        let pixels = bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
        Image::from_pixels(width, height, pixels).map_err(|error| self.failed(error.to_string()))
    }

    fn svg(&self, paper: Paper) -> Result<String, Error> {
        let mut text = String::new();
        self.draw(Surface::Svg(SVGBackend::with_string(&mut text, (WIDTH, self.height()))), paper, 1)?;
        // The corners of noisy lines must not reach beyond them.
        Ok(joined_lines(&text).replacen("<svg ", "<svg stroke-linejoin=\"round\" ", 1))
    }

    fn failed(&self, message: String) -> Error {
        Error::Picture { name: self.name.clone(), message }
    }

    fn height(&self) -> u32 {
        match &self.marks {
            Marks::Lines(..) => HEIGHT,
            Marks::Intervals(bars) => 110 + 22 * bars.len().max(1) as u32,
        }
    }

    fn draw(&self, surface: Surface<'_>, paper: Paper, zoom: u32) -> Result<(), Error> {
        embed_font();
        let size = (WIDTH * zoom, self.height() * zoom);
        let mut drawing = Drawing { surface, size, paper, zoom };
        let drawn = match &self.marks {
            Marks::Lines(series) => drawing.lines(self, series),
            Marks::Intervals(bars) => drawing.intervals(self, bars),
        };
        drawn.and_then(|()| drawing.surface.finish()).map_err(|message| self.failed(message))
    }
}

/// The SVG with each line as a path, and consecutive lines of one style, such as the dashes of a
/// curve, as a single one, which makes reports smaller.
fn joined_lines(svg: &str) -> String {
    let mut joined = String::with_capacity(svg.len());
    let mut style = None;
    for element in svg.lines() {
        let line = element.strip_prefix("<polyline ").and_then(|rest| rest.strip_suffix(" \"/>"));
        let line = line.and_then(|line| line.split_once(" points=\""));
        if style.is_some() && style != line.map(|(style, _)| style) {
            joined.push_str("\"/>\n");
        }
        match line {
            Some((of_line, points)) => {
                if style != Some(of_line) {
                    joined.extend(["<path ", of_line, " d=\""]);
                }
                joined.extend(["M", points]);
            }
            None => joined.extend([element, "\n"]),
        }
        style = line.map(|(style, _)| style);
    }
    joined
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
        let svg = figure.inline_svg().unwrap();
        assert!(figure.svg_file().unwrap().contains("A title") && !svg.contains("A title"));
        assert!(!svg.contains("<polyline"), "the lines of the drawing library are not recognized");
        for expected in ["time, s", "PSNR, dB", "&lt;arm8&gt;", "#0072B2", "#282828"] {
            assert!(svg.contains(expected), "{expected}");
        }
        assert!(figure.svg_file().unwrap().contains("#FFFFFF") && !svg.contains("#FFFFFF"));
        let blue = [0.0, 114.0 / 255.0, 178.0 / 255.0];
        let image = figure.image().unwrap();
        let near = |p: &&[f32; 3]| p.iter().zip(blue).all(|(a, b)| (a - b).abs() < 0.02);
        assert!(image.pixels().iter().filter(near).count() > 200);
    }

    #[test]
    fn lines_of_one_style_are_one_path() {
        let line = |stroke: &str, points: &str| format!("<polyline stroke=\"{stroke}\" points=\"{points} \"/>\n");
        let dashes = [line("red", "0,0 6,0"), line("red", "10,0 16,0"), line("blue", "0,1 6,1")].concat();
        let expected =
            "<svg>\n<path stroke=\"red\" d=\"M0,0 6,0M10,0 16,0\"/>\n<path stroke=\"blue\" d=\"M0,1 6,1\"/>\n</svg>\n";
        assert_eq!(joined_lines(&format!("<svg>\n{dashes}</svg>\n")), expected);
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
                    drawn.image().unwrap_or_else(|error| panic!("{points:?}: {error}"));
                }
            }
        }
        figure(Marks::Intervals(vec![])).image().unwrap();
    }
}
