//! Draws a figure: lines with bands, or intervals, with axes, title and legend.

use std::ops::Range;

use plotters::{
    prelude::*,
    style::text_anchor::{HPos, VPos},
};

use super::{
    Axis, Bar, COLORS, Dots, Figure, GRID, INK, Paper, Series, WIDTH,
    axis::{digits, label, range, ticks},
    color,
    surface::{Place, Surface},
};

/// Font sizes, in the unit of the drawing library: 1.24 times the size in px.
const TITLE: u32 = 19;
const MEDIUM: u32 = 17;
const SMALL: u32 = 16;
/// Width of a letter, as a share of the font size.
const LETTER: f64 = 0.5;

/// A point in the coordinates of the axes.
#[derive(Clone, Copy)]
struct Placed {
    x: f64,
    y: f64,
    low: f64,
    high: f64,
}

/// A figure while it is being drawn.
pub(super) struct Drawing<'a> {
    pub(super) surface: Surface<'a>,
    /// Width and height, px.
    pub(super) size: (u32, u32),
    pub(super) paper: Paper,
    /// All lengths are multiplied by this.
    pub(super) zoom: u32,
}

/// The area between the axes.
struct Plot {
    /// Left and right edge, px.
    columns: (i32, i32),
    /// Bottom and top edge, px.
    rows: (i32, i32),
    xs: Range<f64>,
    ys: Range<f64>,
}

/// The ticks of an axis with their labels.
type Ticks = Vec<(f64, String)>;

impl Plot {
    /// The pixel of a point.
    fn at(&self, x: f64, y: f64) -> Place {
        let map = |value: f64, range: &Range<f64>, (from, to): (i32, i32)| {
            let share = (value - range.start) / (range.end - range.start);
            from + (share * f64::from(to - from)).round() as i32
        };
        (map(x, &self.xs, self.columns), map(y, &self.ys, self.rows))
    }
}

impl Drawing<'_> {
    pub(super) fn lines(&mut self, figure: &Figure, series: &[Series]) -> Result<(), String> {
        let top = self.head(&figure.title, series)?;
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
        let plot = self.plot(top, 62, xs, ys);
        self.axes(figure, &plot, &x_ticks, &y_ticks)?;
        let zoom = self.zoom;
        for (Series { style, dots, .. }, points) in series.iter().zip(&placed).filter(|(_, points)| !points.is_empty())
        {
            if points.iter().any(|point| point.low < point.high) {
                let there = points.iter().map(|point| plot.at(point.x, point.low));
                let back = points.iter().rev().map(|point| plot.at(point.x, point.high));
                self.surface.polygon(&there.chain(back).collect::<Vec<_>>(), color(*style).mix(0.18))?;
            }
            let line: Vec<Place> = points.iter().map(|point| plot.at(point.x, point.y)).collect();
            match is_dashed(*style) {
                _ if *dots == Dots::Alone => {}
                true => {
                    for dash in dashes(&line, f64::from(6 * zoom), f64::from(4 * zoom)) {
                        self.surface.line(&dash, color(*style), 2 * zoom)?;
                    }
                }
                false => self.surface.line(&line, color(*style), 2 * zoom)?,
            }
            let marked = if *dots == Dots::Last { &line[line.len() - 1..] } else { &line[..] };
            marked.iter().try_for_each(|&place| self.mark(*style, place, 4))?;
        }
        Ok(())
    }

    pub(super) fn intervals(&mut self, figure: &Figure, bars: &[Bar]) -> Result<(), String> {
        let top = self.head(&figure.title, &[])?;
        let ends = |bar: &Bar| bar.interval.map_or([bar.mean; 2], |interval| [interval.low, interval.high]);
        let xs = range(bars.iter().flat_map(ends).chain([0.0]), 0.05);
        let rows = bars.len().max(1) as f64;
        let longest = bars.iter().map(|bar| bar.label.chars().count()).max().unwrap_or(0);
        let labels = (longest as f64 * LETTER * f64::from(SMALL)) as u32 + 12;
        let x_ticks = ticks(&xs, 8);
        let x_digits = digits(&x_ticks);
        let x_ticks: Ticks = x_ticks.into_iter().map(|x| (x, label(x, x_digits))).collect();
        let middle = |row: usize| row as f64 + 0.5;
        let y_ticks: Ticks = bars.iter().enumerate().map(|(row, bar)| (middle(row), bar.label.clone())).collect();
        let plot = self.plot(top, labels, xs, rows..0.0);
        self.axes(figure, &plot, &x_ticks, &y_ticks)?;
        let zoom = self.zoom;
        self.surface.line(&[plot.at(0.0, 0.0), plot.at(0.0, rows)], INK, zoom)?;
        for (row, bar) in bars.iter().enumerate() {
            let (y, ink) = (middle(row), color(bar.style));
            if bar.interval.is_some() {
                self.surface.line(&ends(bar).map(|x| plot.at(x, y)), ink, 2 * zoom)?;
            }
            match bar.is_judged {
                true => self.mark(bar.style, plot.at(bar.mean, y), 5)?,
                false => self.surface.circle(plot.at(bar.mean, y), 5 * zoom, ink, 2 * zoom)?,
            }
        }
        Ok(())
    }

    fn px(&self, length: u32) -> i32 {
        (length * self.zoom) as i32
    }

    fn text(&mut self, text: &str, place: Place, size: u32, anchor: (HPos, VPos)) -> Result<(), String> {
        self.surface.text(text, place, f64::from(size * self.zoom), anchor)
    }

    /// Draws title and legend; returns their height, px before zooming. In a page the caption is
    /// the title.
    fn head(&mut self, title: &str, series: &[Series]) -> Result<u32, String> {
        let (width, height) = (self.size.0 as i32, self.size.1 as i32);
        if self.paper == Paper::White {
            self.surface.polygon(&[(0, 0), (width, 0), (width, height), (0, height)], WHITE.to_rgba())?;
        }
        let z = self.zoom as i32;
        let middle = (HPos::Left, VPos::Center);
        let untitled = title.is_empty() || self.paper == Paper::Clear;
        if !untitled {
            self.text(title, (14 * z, 18 * z), TITLE, middle)?;
        }
        let (mut x, mut y) = (14, if untitled { 18 } else { 42 });
        for Series { style, name, dots, .. } in series {
            let width = 36 + (name.chars().count() as f64 * LETTER * f64::from(SMALL)) as i32;
            if x + width > WIDTH as i32 - 10 && x > 14 {
                (x, y) = (14, y + 20);
            }
            // Dashed or invisible, like the line itself.
            let pieces: &[(i32, i32)] = match dots {
                Dots::Alone => &[],
                _ if is_dashed(*style) => &[(0, 6), (10, 14), (18, 24)],
                _ => &[(0, 24)],
            };
            for (from, to) in pieces {
                let ends = [((x + from) * z, y * z), ((x + to) * z, y * z)];
                self.surface.line(&ends, color(*style), 2 * self.zoom)?;
            }
            self.mark(*style, ((x + 12) * z, y * z), 4)?;
            self.text(name, ((x + 29) * z, y * z), SMALL, middle)?;
            x += width + 12;
        }
        Ok(if series.is_empty() { 34 } else { y as u32 + 14 })
    }

    /// The area below the head with room for labels of `left` px.
    fn plot(&self, top: u32, left: u32, xs: Range<f64>, ys: Range<f64>) -> Plot {
        let (width, height) = (self.size.0 as i32, self.size.1 as i32);
        Plot { columns: (self.px(left + 10), width - self.px(18)), rows: (height - self.px(52), self.px(top)), xs, ys }
    }

    /// Grid, axes, and their labels.
    fn axes(&mut self, figure: &Figure, plot: &Plot, x_ticks: &Ticks, y_ticks: &Ticks) -> Result<(), String> {
        let (zoom, tick) = (self.zoom, self.px(5));
        let ((left, right), (bottom, top)) = (plot.columns, plot.rows);
        for (x, label) in x_ticks {
            let (x, _) = plot.at(*x, plot.ys.start);
            self.surface.line(&[(x, bottom), (x, top)], GRID, zoom)?;
            self.surface.line(&[(x, bottom), (x, bottom + tick)], INK, zoom)?;
            self.text(label, (x, bottom + 2 * tick), SMALL, (HPos::Center, VPos::Top))?;
        }
        for (y, label) in y_ticks {
            let (_, y) = plot.at(plot.xs.start, *y);
            self.surface.line(&[(left, y), (right, y)], GRID, zoom)?;
            self.surface.line(&[(left - tick, y), (left, y)], INK, zoom)?;
            self.text(label, (left - 2 * tick, y), SMALL, (HPos::Right, VPos::Center))?;
        }
        self.surface.line(&[(left, top), (left, bottom), (right, bottom)], INK, zoom)?;
        let below = (i32::midpoint(left, right), self.size.1 as i32 - self.px(6));
        self.text(&figure.x.label, below, MEDIUM, (HPos::Center, VPos::Bottom))?;
        if figure.y.label.is_empty() {
            return Ok(());
        }
        let beside = (self.px(6), i32::midpoint(bottom, top));
        self.surface.upward_text(&figure.y.label, beside, f64::from(MEDIUM * zoom))
    }

    /// Draws the marker of a style, one of four shapes, of radius `r` px before zooming.
    fn mark(&mut self, style: usize, (x, y): Place, r: u32) -> Result<(), String> {
        let (fill, radius, r) = (color(style), r * self.zoom, self.px(r));
        let corners: &[Place] = match style % 4 {
            0 => return self.surface.disc((x, y), radius, fill),
            1 => &[(x - r, y - r), (x + r, y - r), (x + r, y + r), (x - r, y + r)],
            2 => &[(x - r - 1, y + r), (x + r + 1, y + r), (x, y - r - 1)],
            _ => &[(x - r - 1, y), (x, y - r - 1), (x + r + 1, y), (x, y + r + 1)],
        };
        self.surface.polygon(corners, fill.to_rgba())
    }
}

impl Figure {
    /// The points that the axes can show. Where they cannot show a band's edge, the line takes its
    /// place.
    fn placed(&self, series: &Series) -> Vec<Placed> {
        let place = |point: &crate::report::figure::FigurePoint| {
            let (x, y) = (self.x.scale.place(point.x)?, self.y.scale.place(point.y)?);
            let edge = |value: f64| self.y.scale.place(value).unwrap_or(y);
            Some(Placed { x, y, low: edge(point.low), high: edge(point.high) })
        };
        series.points.iter().filter_map(place).collect()
    }
}

fn is_dashed(style: usize) -> bool {
    style >= COLORS.len()
}

/// The dashes of a line, with gaps between them, px.
fn dashes(line: &[Place], dash: f64, gap: f64) -> Vec<Vec<Place>> {
    let mut all = Vec::new();
    let mut current: Vec<Place> = line.first().copied().into_iter().collect();
    let (mut is_drawn, mut left) = (true, dash);
    for ends in line.windows(2) {
        let [from, to] = [ends[0], ends[1]].map(|(x, y)| (f64::from(x), f64::from(y)));
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let share = done / length;
            let place = (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
            let place = (place.0.round() as i32, place.1.round() as i32);
            if is_drawn {
                current.push(place);
                all.push(std::mem::take(&mut current));
            } else {
                current = vec![place];
            }
            is_drawn = !is_drawn;
            left = if is_drawn { dash } else { gap };
        }
        left -= length - done;
        if is_drawn {
            current.push(ends[1]);
        }
    }
    if current.len() > 1 {
        all.push(current);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_follow_the_line_around_corners() {
        let found = dashes(&[(0, 0), (10, 0), (10, 10)], 6.0, 2.0);
        assert_eq!(found, [vec![(0, 0), (6, 0)], vec![(8, 0), (10, 0), (10, 4)], vec![(10, 6), (10, 10)]]);
        assert!(dashes(&[], 6.0, 2.0).is_empty() && dashes(&[(1, 1)], 6.0, 2.0).is_empty());
    }
}
