//! Draws a figure as SVG: lines with bands, or intervals, with axes, title and legend.

use std::{fmt::Write as _, ops::Range};

use maud::html;

use super::{
    Axis, Bar, COLORS, Dots, Figure, GRID, INK, Marks, Series, WIDTH,
    axis::{digits, label, range, ticks},
    color, hex,
};

/// Font sizes, px.
const TITLE: f64 = 15.5;
const MEDIUM: f64 = 14.0;
const SMALL: f64 = 13.0;
/// Width of a letter of [`SMALL`] text, px.
const LETTER: f64 = 8.0;

/// Strokes of lines.
const THIN: &str = "stroke-width=\"1\"";
const WIDE: &str = "stroke-width=\"2\"";
const DASHED: &str = "stroke-width=\"2\" stroke-dasharray=\"6 4\"";

/// A position, px.
type Place = (f64, f64);

/// A point in the coordinates of the axes.
#[derive(Clone, Copy)]
struct Placed {
    x: f64,
    y: f64,
    low: f64,
    high: f64,
}

/// A figure while it is being drawn.
struct Drawing {
    /// The elements so far.
    svg: String,
    height: f64,
}

/// The area between the axes.
struct Plot {
    /// Left and right edge, px.
    columns: (f64, f64),
    /// Bottom and top edge, px.
    rows: (f64, f64),
    xs: Range<f64>,
    ys: Range<f64>,
}

/// The ticks of an axis with their labels.
type Ticks = Vec<(f64, String)>;

/// The figure as SVG; in a page without title and background, which the page has.
pub(super) fn svg(figure: &Figure, is_in_page: bool) -> String {
    let height = figure.height();
    let mut drawing = Drawing { svg: String::new(), height: height.into() };
    if !is_in_page {
        drawing.svg += "<rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>\n";
    }
    let title = if is_in_page { "" } else { &figure.title };
    match &figure.marks {
        Marks::Lines(series) => drawing.lines(figure, title, series),
        Marks::Intervals(bars) => drawing.intervals(figure, title, bars),
    }
    // The corners of noisy lines must not reach beyond them.
    format!(
        "<svg width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\" xmlns=\"http://www.w3.org/2000/svg\" \
         font-family=\"sans-serif\" stroke-linejoin=\"round\">\n{}</svg>\n",
        drawing.svg
    )
}

impl Plot {
    /// The place of a point.
    fn at(&self, x: f64, y: f64) -> Place {
        let map = |value: f64, range: &Range<f64>, (from, to): (f64, f64)| {
            from + (value - range.start) / (range.end - range.start) * (to - from)
        };
        (map(x, &self.xs, self.columns), map(y, &self.ys, self.rows))
    }
}

impl Drawing {
    fn lines(&mut self, figure: &Figure, title: &str, series: &[Series]) {
        let top = self.head(title, series);
        let placed: Vec<Vec<Placed>> = series.iter().map(|series| figure.placed(series)).collect();
        let points = || placed.iter().flatten();
        let xs = range(points().map(|point| point.x), 0.02);
        let ys = range(points().flat_map(|point| [point.low, point.high]), 0.05);
        let labelled = |axis: &Axis, range: &Range<f64>| -> Ticks {
            let ticks = axis.scale.ticks(range);
            let digits = digits(&ticks);
            ticks.into_iter().map(|place| (place, axis.scale.label(place, digits))).collect()
        };
        let (x_ticks, y_ticks) = (labelled(&figure.x, &xs), labelled(&figure.y, &ys));
        let plot = self.plot(top, 72.0, xs, ys);
        self.axes(figure, &plot, &x_ticks, &y_ticks);
        for (Series { style, dots, .. }, points) in series.iter().zip(&placed).filter(|(_, points)| !points.is_empty())
        {
            if points.iter().any(|point| point.low < point.high) {
                let there = points.iter().map(|point| plot.at(point.x, point.low));
                let back = points.iter().rev().map(|point| plot.at(point.x, point.high));
                self.polygon(&there.chain(back).collect::<Vec<_>>(), &color(*style), 0.18);
            }
            let line: Vec<Place> = points.iter().map(|point| plot.at(point.x, point.y)).collect();
            if *dots != Dots::Alone {
                self.curve(&line, *style);
            }
            let marked = if *dots == Dots::Last { &line[line.len() - 1..] } else { &line[..] };
            marked.iter().for_each(|&place| self.mark(*style, place, 4.0));
        }
    }

    fn intervals(&mut self, figure: &Figure, title: &str, bars: &[Bar]) {
        let top = self.head(title, &[]);
        let ends = |bar: &Bar| bar.interval.map_or([bar.mean; 2], |interval| [interval.low, interval.high]);
        let xs = range(bars.iter().flat_map(ends).chain([0.0]), 0.05);
        let rows = bars.len().max(1) as f64;
        let longest = bars.iter().map(|bar| bar.label.chars().count()).max().unwrap_or(0);
        let x_ticks = ticks(&xs, 8);
        let x_digits = digits(&x_ticks);
        let x_ticks: Ticks = x_ticks.into_iter().map(|x| (x, label(x, x_digits))).collect();
        let middle = |row: usize| row as f64 + 0.5;
        let y_ticks: Ticks = bars.iter().enumerate().map(|(row, bar)| (middle(row), bar.label.clone())).collect();
        let plot = self.plot(top, longest as f64 * LETTER + 22.0, xs, rows..0.0);
        self.axes(figure, &plot, &x_ticks, &y_ticks);
        self.line(&[plot.at(0.0, 0.0), plot.at(0.0, rows)], &hex(INK), THIN);
        for (row, bar) in bars.iter().enumerate() {
            let (y, ink) = (middle(row), color(bar.style));
            if bar.interval.is_some() {
                self.line(&ends(bar).map(|x| plot.at(x, y)), &ink, WIDE);
            }
            let (x, y) = plot.at(bar.mean, y);
            match bar.is_judged {
                true => self.mark(bar.style, (x, y), 5.0),
                false => self.add(&format!(
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"none\" stroke=\"{ink}\" {WIDE}/>"
                )),
            }
        }
    }

    fn add(&mut self, element: &str) {
        self.svg.extend([element, "\n"]);
    }

    fn line(&mut self, points: &[Place], color: &str, stroke: &str) {
        let points = coordinates(points);
        self.add(&format!("<path fill=\"none\" stroke=\"{color}\" {stroke} d=\"M{points}\"/>"));
    }

    /// A line in the colour of a style, dashed beyond the seventh.
    fn curve(&mut self, points: &[Place], style: usize) {
        self.line(points, &color(style), if style < COLORS.len() { WIDE } else { DASHED });
    }

    fn polygon(&mut self, corners: &[Place], color: &str, opacity: f64) {
        let points = coordinates(corners);
        self.add(&format!("<polygon fill=\"{color}\" opacity=\"{opacity}\" points=\"{points}\"/>"));
    }

    /// Text that starts, ends or is centred at a place, as `anchor` says, and lies `down` letters below it.
    fn text(&mut self, text: &str, (x, y): Place, size: f64, (anchor, down): (&str, f64)) {
        // XML has no control characters, and a file's name may have them.
        let text = html! { (text.replace(char::is_control, "\u{fffd}")) }.into_string();
        self.add(&format!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" dy=\"{down}em\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{}\">{text}</text>",
            hex(INK)
        ));
    }

    /// Draws title and legend; returns their height, px.
    fn head(&mut self, title: &str, series: &[Series]) -> f64 {
        const MIDDLE: (&str, f64) = ("start", 0.35);
        if !title.is_empty() {
            self.text(title, (14.0, 18.0), TITLE, MIDDLE);
        }
        let (mut x, mut y) = (14.0, if title.is_empty() { 18.0 } else { 42.0 });
        for Series { style, name, dots, .. } in series {
            let width = 36.0 + name.chars().count() as f64 * LETTER;
            if x + width > f64::from(WIDTH) - 10.0 && x > 14.0 {
                (x, y) = (14.0, y + 20.0);
            }
            if *dots != Dots::Alone {
                self.curve(&[(x, y), (x + 24.0, y)], *style);
            }
            self.mark(*style, (x + 12.0, y), 4.0);
            self.text(name, (x + 29.0, y), SMALL, MIDDLE);
            x += width + 12.0;
        }
        if series.is_empty() { 34.0 } else { y + 14.0 }
    }

    /// The area below the head, with room of this width for labels.
    fn plot(&self, top: f64, left: f64, xs: Range<f64>, ys: Range<f64>) -> Plot {
        Plot { columns: (left, f64::from(WIDTH) - 18.0), rows: (self.height - 52.0, top), xs, ys }
    }

    /// Grid, axes, and their labels.
    fn axes(&mut self, figure: &Figure, plot: &Plot, x_ticks: &Ticks, y_ticks: &Ticks) {
        let ((left, right), (bottom, top)) = (plot.columns, plot.rows);
        let (ink, grid) = (hex(INK), hex(GRID));
        for (x, label) in x_ticks {
            let (x, _) = plot.at(*x, plot.ys.start);
            self.line(&[(x, bottom), (x, top)], &grid, THIN);
            self.line(&[(x, bottom), (x, bottom + 5.0)], &ink, THIN);
            self.text(label, (x, bottom + 10.0), SMALL, ("middle", 0.8));
        }
        for (y, label) in y_ticks {
            let (_, y) = plot.at(plot.xs.start, *y);
            self.line(&[(left, y), (right, y)], &grid, THIN);
            self.line(&[(left - 5.0, y), (left, y)], &ink, THIN);
            self.text(label, (left - 10.0, y), SMALL, ("end", 0.35));
        }
        self.line(&[(left, top), (left, bottom), (right, bottom)], &ink, THIN);
        self.text(&figure.x.label, (f64::midpoint(left, right), self.height - 9.0), MEDIUM, ("middle", 0.0));
        if !figure.y.label.is_empty() {
            let _ = write!(self.svg, "<g transform=\"translate(6 {:.1}) rotate(-90)\">", f64::midpoint(bottom, top));
            self.text(&figure.y.label, (0.0, 0.0), MEDIUM, ("middle", 0.8));
            self.add("</g>");
        }
    }

    /// Draws the marker of a style, one of four shapes, of radius `r` px.
    fn mark(&mut self, style: usize, (x, y): Place, r: f64) {
        let fill = color(style);
        let corners: &[Place] = match style % 4 {
            0 => return self.add(&format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\" fill=\"{fill}\"/>")),
            1 => &[(x - r, y - r), (x + r, y - r), (x + r, y + r), (x - r, y + r)],
            2 => &[(x - r - 1.0, y + r), (x + r + 1.0, y + r), (x, y - r - 1.0)],
            _ => &[(x - r - 1.0, y), (x, y - r - 1.0), (x + r + 1.0, y), (x, y + r + 1.0)],
        };
        self.polygon(corners, &fill, 1.0);
    }
}

/// Places as SVG writes them.
fn coordinates(places: &[Place]) -> String {
    places.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

impl Figure {
    /// The points that the axes can show. Where they cannot show a band's edge, the line takes its
    /// place.
    fn placed(&self, series: &Series) -> Vec<Placed> {
        let place = |point: &super::FigurePoint| {
            let (x, y) = (self.x.scale.place(point.x)?, self.y.scale.place(point.y)?);
            let edge = |value: f64| self.y.scale.place(value).unwrap_or(y);
            Some(Placed { x, y, low: edge(point.low), high: edge(point.high) })
        };
        series.points.iter().filter_map(place).collect()
    }
}
