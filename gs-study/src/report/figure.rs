//! A figure, drawn as SVG and as pixels by the same code: lines with bands, or intervals.
//!
//! Colours are those of Okabe and Ito, which people with any kind of colour vision tell apart; lines beyond the seventh are dashed, and
//! each arm has a mark of its own shape. Ink and grid have one colour each, so that a page can replace them in the dark.

use std::sync::Once;

use gs_core::Image;
use plotters::{
    coord::{
        Shift,
        ranged1d::{DefaultFormatting, KeyPointHint},
        types::RangedCoordf64,
    },
    prelude::*,
    style::{
        FontStyle, register_font,
        text_anchor::{HPos, Pos, VPos},
    },
};

use crate::{error::Error, statistics::Interval};

/// What text and axes are drawn in.
pub(crate) const INK: RGBColor = RGBColor(40, 40, 40);
/// What the grid is drawn in.
pub(crate) const GRID: RGBColor = RGBColor(221, 221, 221);

/// Okabe and Ito 2008, "Color universal design", without black.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(148, 130, 0),
];

/// Size of a figure, px.
const WIDTH: u32 = 640;
const HEIGHT: u32 = 420;
/// Enlargement of the picture in pixels.
const SHARPNESS: u32 = 2;
const FONT: &str = "sans-serif";
/// Sizes of letters, in the unit of the drawing library: a quarter more than px.
const TITLE: u32 = 19;
const MEDIUM: u32 = 17;
const SMALL: u32 = 16;
/// Width of a letter, as a part of the font's size.
const LETTER: f64 = 0.5;

/// A figure before it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Figure {
    /// Its file, without ending.
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) x: Axis,
    /// What is on the other axis, with its unit.
    pub(crate) y: String,
    pub(crate) marks: Marks,
}

/// The horizontal axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    /// What it shows, with its unit.
    pub(crate) label: String,
    pub(crate) scale: Scale,
}

/// How an axis is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scale {
    Linear,
    Logarithmic,
}

/// What is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Marks {
    Lines(Vec<Series>, Dots),
    Intervals(Vec<Bar>),
}

/// Which points of a line are marked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dots {
    All,
    Last,
}

/// A line and its band.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Series {
    /// Which arm: the line's colour and mark.
    pub(crate) arm: usize,
    pub(crate) name: String,
    pub(crate) points: Vec<Point>,
}

/// A point of a line, and of its band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// A mean in its interval.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bar {
    pub(crate) arm: usize,
    pub(crate) label: String,
    pub(crate) mean: f64,
    pub(crate) interval: Interval,
    /// Whether a verdict may rest on it; it is drawn hollow where not.
    pub(crate) is_judged: bool,
}

/// What is behind a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Paper {
    White,
    /// Whatever the page has.
    Clear,
}

/// The colour of an arm.
pub(crate) fn color(arm: usize) -> RGBColor {
    COLORS[arm % COLORS.len()]
}

impl Figure {
    /// As SVG to stand in a page: nothing behind it.
    pub(crate) fn inline_svg(&self) -> Result<String, Error> {
        self.svg(Paper::Clear)
    }

    /// As SVG to stand alone.
    pub(crate) fn svg_file(&self) -> Result<String, Error> {
        self.svg(Paper::White)
    }

    /// As an image.
    pub(crate) fn image(&self) -> Result<Image, Error> {
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
            Marks::Lines(series, dots) => self.lines(area, paper, zoom, series, *dots),
            Marks::Intervals(bars) => self.intervals(area, paper, zoom, bars),
        };
        drawn.and_then(|()| area.present()).map_err(|error| error.to_string())
    }

    fn lines<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        paper: Paper,
        zoom: u32,
        series: &[Series],
        dots: Dots,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let top = self.head(area, paper, zoom, series)?;
        let points = || series.iter().flat_map(|series| &series.points);
        let xs = range(points().map(|point| self.x.scale.place(point.x)), 0.02);
        let ys = range(points().flat_map(|point| [point.low, point.high]), 0.05);
        let mut chart =
            self.chart(area, zoom, top, 62, (xs.clone(), self.x.scale.ticks(&xs)), (ys.clone(), ticks(&ys, 7)))?;
        let x_digits = digits(&self.x.scale.ticks(&xs));
        let y_digits = digits(&ticks(&ys, 7));
        self.axes(&mut chart, zoom, &|x| self.x.scale.label(*x, x_digits), &|y| label(*y, y_digits))?;
        for Series { arm, points, .. } in series.iter().filter(|series| !series.points.is_empty()) {
            let at = |point: &Point, y: f64| (self.x.scale.place(point.x), y);
            let there = points.iter().map(|point| at(point, point.low));
            let back = points.iter().rev().map(|point| at(point, point.high));
            chart.draw_series([Polygon::new(there.chain(back).collect::<Vec<_>>(), color(*arm).mix(0.18))])?;
            let line: Vec<(f64, f64)> = points.iter().map(|point| at(point, point.y)).collect();
            let style = color(*arm).stroke_width(2 * zoom);
            match is_dashed(*arm) {
                true => chart.draw_series(DashedLineSeries::new(line.clone(), 6 * zoom, 4 * zoom, style))?,
                false => chart.draw_series([PathElement::new(line.clone(), style)])?,
            };
            let marked = if dots == Dots::All { &line[..] } else { &line[line.len() - 1..] };
            for &place in marked {
                let pixel = chart.backend_coord(&place);
                mark(area, *arm, pixel, 4 * zoom as i32)?;
            }
        }
        Ok(())
    }

    fn intervals<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        paper: Paper,
        zoom: u32,
        bars: &[Bar],
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let top = self.head(area, paper, zoom, &[])?;
        let xs = range(bars.iter().flat_map(|bar| [bar.interval.low, bar.interval.high]).chain([0.0]), 0.05);
        let rows = bars.len().max(1) as f64;
        let centers: Vec<f64> = (0..bars.len()).map(|row| row as f64 + 0.5).collect();
        let longest = bars.iter().map(|bar| bar.label.chars().count()).max().unwrap_or(0);
        let labels = (longest as f64 * LETTER * f64::from(SMALL)) as u32 + 12;
        let mut chart = self.chart(area, zoom, top, labels, (xs.clone(), ticks(&xs, 8)), (rows..0.0, centers))?;
        let x_digits = digits(&ticks(&xs, 8));
        let name = |y: &f64| bars.get(*y as usize).map_or_else(String::new, |bar| bar.label.clone());
        self.axes(&mut chart, zoom, &|x| label(*x, x_digits), &name)?;
        chart.draw_series([PathElement::new(vec![(0.0, 0.0), (0.0, rows)], INK.stroke_width(zoom))])?;
        for (bar, y) in bars.iter().zip((0..).map(|row| f64::from(row) + 0.5)) {
            let ink = color(bar.arm);
            let ends = [(bar.interval.low, y), (bar.interval.high, y)];
            chart.draw_series([PathElement::new(ends.to_vec(), ink.stroke_width(2 * zoom))])?;
            let pixel = chart.backend_coord(&(bar.mean, y));
            match bar.is_judged {
                true => mark(area, bar.arm, pixel, 5 * zoom as i32)?,
                false => area.draw(&Circle::new(pixel, 5 * zoom, ink.stroke_width(2 * zoom)))?,
            }
        }
        Ok(())
    }

    /// Title and legend; returns how high they are, px before zooming.
    fn head<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        paper: Paper,
        zoom: u32,
        series: &[Series],
    ) -> Result<u32, DrawingAreaErrorKind<DB::ErrorType>> {
        if paper == Paper::White {
            area.fill(&WHITE)?;
        }
        let z = zoom as i32;
        let middle = Pos::new(HPos::Left, VPos::Center);
        let text = |size: u32| (FONT, f64::from(size * zoom)).into_font().color(&INK).pos(middle);
        area.draw(&Text::new(self.title.clone(), (14 * z, 18 * z), text(TITLE)))?;
        let (mut x, mut y) = (14, 42);
        for Series { arm, name, .. } in series {
            let width = 36 + (name.chars().count() as f64 * LETTER * f64::from(SMALL)) as i32;
            if x + width > WIDTH as i32 - 10 && x > 14 {
                (x, y) = (14, y + 20);
            }
            let style = color(*arm).stroke_width(2 * zoom);
            // A dashed sample, where the line is dashed.
            let pieces: &[(i32, i32)] = if is_dashed(*arm) { &[(0, 6), (10, 14), (18, 24)] } else { &[(0, 24)] };
            for (from, to) in pieces {
                area.draw(&PathElement::new(vec![((x + from) * z, y * z), ((x + to) * z, y * z)], style))?;
            }
            mark(area, *arm, ((x + 12) * z, y * z), 4 * z)?;
            area.draw(&Text::new(name.clone(), ((x + 29) * z, y * z), text(SMALL)))?;
            x += width + 12;
        }
        Ok(if series.is_empty() { 34 } else { y as u32 + 14 })
    }

    fn chart<'a, DB: DrawingBackend>(
        &self,
        area: &'a DrawingArea<DB, Shift>,
        zoom: u32,
        top: u32,
        left: u32,
        (xs, x_ticks): (std::ops::Range<f64>, Vec<f64>),
        (ys, y_ticks): (std::ops::Range<f64>, Vec<f64>),
    ) -> Result<Chart<'a, DB>, DrawingAreaErrorKind<DB::ErrorType>> {
        let label_room = if self.y.is_empty() { left } else { left + 4 };
        ChartBuilder::on(area)
            .margin_top(top * zoom)
            .margin_right(18 * zoom)
            .margin_left(6 * zoom)
            .margin_bottom(6 * zoom)
            .x_label_area_size(46 * zoom)
            .y_label_area_size(label_room * zoom)
            .build_cartesian_2d(Ticked::new(xs, x_ticks), Ticked::new(ys, y_ticks))
    }

    fn axes<DB: DrawingBackend>(
        &self,
        chart: &mut Chart<'_, DB>,
        zoom: u32,
        x_label: &dyn Fn(&f64) -> String,
        y_label: &dyn Fn(&f64) -> String,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let font = |size: u32| (FONT, f64::from(size * zoom)).into_font().color(&INK);
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(zoom))
            .axis_style(INK.stroke_width(zoom))
            .x_desc(&self.x.label)
            .y_desc(&self.y)
            .x_label_formatter(x_label)
            .y_label_formatter(y_label)
            .axis_desc_style(font(MEDIUM))
            .label_style(font(SMALL))
            .draw()
    }
}

type Chart<'a, DB> = ChartContext<'a, DB, Cartesian2d<Ticked, Ticked>>;

/// A linear axis with its ticks where they are wanted.
struct Ticked {
    axis: RangedCoordf64,
    ticks: Vec<f64>,
}

impl Ticked {
    fn new(range: std::ops::Range<f64>, ticks: Vec<f64>) -> Self {
        Self { axis: range.into(), ticks }
    }
}

impl Ranged for Ticked {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.axis.map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.axis.range()
    }
}

/// The mark of an arm: one of four shapes.
fn mark<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    arm: usize,
    (x, y): (i32, i32),
    r: i32,
) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
    let fill = color(arm).filled();
    match arm % 4 {
        0 => area.draw(&Circle::new((x, y), r, fill)),
        1 => area.draw(&Rectangle::new([(x - r, y - r), (x + r, y + r)], fill)),
        2 => area.draw(&Polygon::new(vec![(x - r - 1, y + r), (x + r + 1, y + r), (x, y - r - 1)], fill)),
        _ => area.draw(&Polygon::new(vec![(x - r - 1, y), (x, y - r - 1), (x + r + 1, y), (x, y + r + 1)], fill)),
    }
}

fn is_dashed(arm: usize) -> bool {
    arm >= COLORS.len()
}

impl Scale {
    /// Where a value stands on the axis.
    fn place(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Logarithmic => value.max(f64::MIN_POSITIVE).log10(),
        }
    }

    fn ticks(self, range: &std::ops::Range<f64>) -> Vec<f64> {
        match self {
            Self::Linear => ticks(range, 7),
            Self::Logarithmic => {
                let decades = range.end - range.start;
                let steps: &[f64] = if decades > 3.0 {
                    &[1.0]
                } else if decades > 0.7 {
                    &[1.0, 2.0, 5.0]
                } else {
                    &[1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]
                };
                let decades = range.start.floor() as i32..=range.end.ceil() as i32;
                let all = decades.flat_map(|d| steps.iter().map(move |s| (s * 10f64.powi(d)).log10()));
                all.filter(|place| range.contains(place)).collect()
            }
        }
    }

    fn label(self, place: f64, digits: usize) -> String {
        match self {
            Self::Linear => label(place, digits),
            Self::Logarithmic => {
                let value = 10f64.powf(place);
                let digits = (1.0 - value.log10().floor()).clamp(0.0, 9.0) as usize;
                let text = format!("{value:.digits$}");
                if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
            }
        }
    }
}

/// The span of the values with some room around them; never empty.
fn range(values: impl Iterator<Item = f64>, room: f64) -> std::ops::Range<f64> {
    let (low, high) = values.filter(|v| v.is_finite()).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    let room = if high > low { room * (high - low) } else { 0.5 * high.abs().max(0.1) };
    low - room..high + room
}

/// About `count` round values in a range.
fn ticks(range: &std::ops::Range<f64>, count: usize) -> Vec<f64> {
    let step = step(range, count);
    let (first, last) = ((range.start / step).ceil() as i64, (range.end / step).floor() as i64);
    (first..=last).map(|i| i as f64 * step).collect()
}

fn step(range: &std::ops::Range<f64>, count: usize) -> f64 {
    let rough = (range.end - range.start) / count as f64;
    let decade = 10f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|s| s * decade).into_iter().find(|&s| s >= rough).unwrap_or(decade)
}

/// Digits behind the point that tell ticks apart.
fn digits(ticks: &[f64]) -> usize {
    let step = ticks.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    if step.is_finite() { (-(step * 1.001).log10().floor()).clamp(0.0, 9.0) as usize } else { 1 }
}

fn label(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    // -0 is 0.
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') { text.replace('-', "") } else { text }
}

fn embed_font() {
    static ONCE: Once = Once::new();
    // A font that cannot be read shows up as an error of the first text that is drawn.
    ONCE.call_once(|| drop(register_font(FONT, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR)));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(marks: Marks) -> Figure {
        let x = Axis { label: "time, s".to_owned(), scale: Scale::Logarithmic };
        Figure { name: "f".to_owned(), title: "A title".to_owned(), x, y: "PSNR, dB".to_owned(), marks }
    }

    #[test]
    fn lines_are_drawn_in_their_colours_with_axes_and_units() {
        let points = |from: f64| {
            let x = (1..50).map(f64::from);
            x.map(move |x| Point { x, y: from + x, low: from, high: from + 2.0 * x })
        };
        let series = (0..9).map(|arm| Series { arm, name: format!("arm{arm}"), points: points(arm as f64).collect() });
        let figure = figure(Marks::Lines(series.collect(), Dots::Last));
        let svg = figure.inline_svg().unwrap();
        for expected in ["A title", "time, s", "PSNR, dB", "arm8", "#0072B2", "#282828"] {
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
        for points in [vec![], vec![point(1.0, 2.0)], vec![point(0.0, 1e9), point(1e-9, 1e9)]] {
            figure(Marks::Lines(vec![Series { arm: 0, name: String::new(), points }], Dots::All)).image().unwrap();
        }
        figure(Marks::Intervals(vec![])).image().unwrap();
    }

    #[test]
    fn ticks_are_round_and_labels_short() {
        assert_eq!(ticks(&(-0.3..1.1), 7).len(), 7);
        assert_eq!((label(-0.0001, 2), label(0.25, 2), digits(&[0.0, 0.05, 0.1])), ("0.00".into(), "0.25".into(), 2));
        let log = Scale::Logarithmic;
        let labels: Vec<String> = log.ticks(&(-1.0..1.0)).into_iter().map(|t| log.label(t, 0)).collect();
        assert_eq!(labels[1..5], ["0.2", "0.5", "1", "2"].map(str::to_owned));
    }
}
