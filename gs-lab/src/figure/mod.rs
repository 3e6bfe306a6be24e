//! A figure, drawn as SVG and as pixels by the same code: lines with bands, or intervals. The figures of studies, of the paper's
//! experiments and of frontiers are all of this one kind; [`curve`] and [`ellipses`] draw over pictures and steps of a single fit.
//!
//! Colours are those of Okabe and Ito, which people with any kind of colour vision tell apart; lines beyond the seventh are dashed, and
//! each has a mark of its own shape. Ink and grid have one colour each, so that a page can replace them in the dark. The lettering is an
//! embedded font (Hack, MIT licence), so that a picture is the same on a machine that has none.

mod axis;
pub mod curve;
mod draw;
pub mod ellipses;

use std::sync::Once;

pub(crate) use self::axis::grouped;
pub use self::axis::human;

use crate::statistics::Interval;
use gs_core::Image;
use plotters::{
    coord::Shift,
    prelude::*,
    style::{FontStyle, register_font},
};

use crate::error::Error;

/// What text and axes are drawn in.
pub(crate) const INK: RGBColor = RGBColor(40, 40, 40);
/// What the grid is drawn in.
pub(crate) const GRID: RGBColor = RGBColor(221, 221, 221);

/// Okabe and Ito 2008, "Color universal design", without black.
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

/// Size of a figure, px.
const WIDTH: u32 = 640;
const HEIGHT: u32 = 420;
/// Enlargement of the picture in pixels.
const SHARPNESS: u32 = 2;

/// A figure before it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Its file, without ending.
    pub name: String,
    /// What stands above it; in a page, its caption.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis; [`Marks::Intervals`] have names there.
    pub y: Axis,
    /// What is drawn.
    pub marks: Marks,
}

/// An axis of a figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Axis {
    /// What it shows, with its unit.
    pub label: String,
    /// How it is divided.
    pub scale: Scale,
}

impl Axis {
    /// A linear one.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear }
    }

    /// A logarithmic one; values that are not positive are left out.
    pub fn logarithmic(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Logarithmic }
    }
}

/// How an axis is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal steps are equal differences.
    Linear,
    /// Equal steps are equal ratios.
    Logarithmic,
}

/// What is drawn.
#[derive(Debug, Clone, PartialEq)]
pub enum Marks {
    /// Lines, each with its band.
    Lines(Vec<Series>),
    /// Means in their intervals, one below the other.
    Intervals(Vec<Bar>),
}

impl Marks {
    /// Lines in the order of the legend. Every other is dashed, so that lines on top of each other are seen, too.
    pub fn lines(series: Vec<Series>) -> Self {
        let styled = |(index, series): (usize, Series)| {
            let style = index % COLORS.len() + COLORS.len() * (index % 2);
            Series { style, ..series }
        };
        Self::Lines(series.into_iter().enumerate().map(styled).collect())
    }
}

/// Which points of a line are marked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dots {
    /// Every one.
    All,
    /// The last.
    Last,
    /// Every one, and no line between them.
    Alone,
}

/// A line and its band.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// The place of its colour and its mark among all there are.
    pub style: usize,
    /// Its name in the legend.
    pub name: String,
    /// Its points, from left to right. Those that are not finite are left out.
    pub points: Vec<Point>,
    /// Which of them are marked.
    pub dots: Dots,
}

impl Series {
    /// A line through (x, y) by rising x.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        let points = points.into_iter().map(|(x, y)| Point { x, y, low: y, high: y }).collect();
        Self { style: 0, name: name.into(), points, dots: Dots::Last }
    }

    /// The same with a mark at each point, for few points.
    pub fn dotted(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { dots: Dots::All, ..Self::line(name, points) }
    }
}

/// A point of a line, and of its band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Where it stands from left to right.
    pub x: f64,
    /// Where the line is.
    pub y: f64,
    /// The band's lower edge.
    pub low: f64,
    /// The band's upper edge.
    pub high: f64,
}

/// A mean in its interval.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// As in [`Series::style`].
    pub style: usize,
    /// What it is of.
    pub label: String,
    /// The mean.
    pub mean: f64,
    /// Where it probably lies.
    pub interval: Interval,
    /// Whether a verdict may rest on it; it is drawn hollow where not.
    pub is_judged: bool,
}

/// What is behind a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Paper {
    White,
    /// Whatever the page has.
    Clear,
}

/// The colour of a [`Series::style`].
pub(crate) fn color(style: usize) -> RGBColor {
    COLORS[style % COLORS.len()]
}

/// Makes [`FONT`] known to the drawing library; again and again does no harm.
pub(crate) fn embed_font() {
    static ONCE: Once = Once::new();
    // A font that cannot be read shows up as an error of the first text that is drawn.
    ONCE.call_once(|| drop(register_font(FONT, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR)));
}

impl Figure {
    /// Its lines; none of a figure of intervals.
    pub fn lines(&self) -> &[Series] {
        match &self.marks {
            Marks::Lines(series) => series,
            Marks::Intervals(_) => &[],
        }
    }

    /// As SVG to stand in a page, which has its title and what is behind it.
    ///
    /// # Errors
    /// [`Error::Picture`] with what the drawing library reports.
    pub fn inline_svg(&self) -> Result<String, Error> {
        self.svg(Paper::Clear)
    }

    /// As SVG to stand alone.
    ///
    /// # Errors
    /// [`Error::Picture`] with what the drawing library reports.
    pub fn svg_file(&self) -> Result<String, Error> {
        self.svg(Paper::White)
    }

    /// As an image.
    ///
    /// # Errors
    /// [`Error::Picture`] with what the drawing library reports.
    pub fn image(&self) -> Result<Image, Error> {
        let (width, height) = (WIDTH * SHARPNESS, self.height() * SHARPNESS);
        let mut bytes = vec![255; 3 * (width * height) as usize];
        let area = BitMapBackend::with_buffer(&mut bytes, (width, height)).into_drawing_area();
        self.draw(&area, Paper::White, SHARPNESS).map_err(|message| self.failed(message))?;
        drop(area);
        let pixels = bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
        Image::from_pixels(width, height, pixels).map_err(|error| self.failed(error.to_string()))
    }

    fn svg(&self, paper: Paper) -> Result<String, Error> {
        let mut text = String::new();
        let area = SVGBackend::with_string(&mut text, (WIDTH, self.height())).into_drawing_area();
        self.draw(&area, paper, 1).map_err(|message| self.failed(message))?;
        drop(area);
        Ok(text)
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

    fn draw<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>, paper: Paper, zoom: u32) -> Result<(), String> {
        embed_font();
        let drawn = match &self.marks {
            Marks::Lines(series) => self.draw_lines(area, paper, zoom, series),
            Marks::Intervals(bars) => self.intervals(area, paper, zoom, bars),
        };
        drawn.and_then(|()| area.present()).map_err(|error| error.to_string())
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
            x.map(move |x| Point { x, y: from + x, low: from, high: from + 2.0 * x }).collect()
        };
        let one = |style: usize| {
            let name = format!("<arm{style}>");
            Series { style, name, points: points(style as f64), dots: Dots::Last }
        };
        let figure = figure(Marks::Lines((0..9).map(one).collect()));
        let svg = figure.inline_svg().unwrap();
        assert!(figure.svg_file().unwrap().contains("A title") && !svg.contains("A title"));
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
    fn any_numbers_make_a_figure() {
        let point = |x, y| Point { x, y, low: y, high: y };
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
