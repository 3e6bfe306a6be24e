//! The drawing of a figure: lines with bands or intervals, in their axes, under a title and a legend.

use std::ops::Range;

use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use crate::figure::{
    Bar, COLORS, Dots, FONT, Figure, GRID, INK, Paper, Series, WIDTH,
    axis::{Ticked, digits, label, range, ticks},
    color,
};

/// Sizes of letters, in the unit of the drawing library: a quarter more than px.
const TITLE: u32 = 19;
const MEDIUM: u32 = 17;
const SMALL: u32 = 16;
/// Width of a letter, as a part of the font's size.
const LETTER: f64 = 0.5;

type Parameterization<'a, DB> = ChartContext<'a, DB, Cartesian2d<Ticked, Ticked>>;
type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// A point where the axes have it.
#[derive(Clone, Copy)]
struct Placed {
    x: f64,
    y: f64,
    low: f64,
    high: f64,
}

impl Figure {
    pub(super) fn draw_lines<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        paper: Paper,
        zoom: u32,
        series: &[Series],
    ) -> Drawn<DB> {
        let top = self.head(area, paper, zoom, series)?;
        let placed: Vec<Vec<Placed>> = series.iter().map(|series| self.placed(series)).collect();
        let points = || placed.iter().flatten();
        let xs = range(points().map(|point| point.x), 0.02);
        let ys = range(points().flat_map(|point| [point.low, point.high]), 0.05);
        let (x_ticks, y_ticks) = (self.x.scale.ticks(&xs), self.y.scale.ticks(&ys));
        let (x_digits, y_digits) = (digits(&x_ticks), digits(&y_ticks));
        let mut chart = self.chart(area, zoom, top, 62, (xs, x_ticks), (ys, y_ticks))?;
        let (x, y) = (self.x.scale, self.y.scale);
        self.axes(&mut chart, zoom, &|place| x.label(*place, x_digits), &|place| y.label(*place, y_digits))?;
        for (Series { style, dots, .. }, points) in series.iter().zip(&placed).filter(|(_, points)| !points.is_empty())
        {
            if points.iter().any(|point| point.low < point.high) {
                let there = points.iter().map(|point| (point.x, point.low));
                let back = points.iter().rev().map(|point| (point.x, point.high));
                chart.draw_series([Polygon::new(there.chain(back).collect::<Vec<_>>(), color(*style).mix(0.18))])?;
            }
            let line: Vec<(f64, f64)> = points.iter().map(|point| (point.x, point.y)).collect();
            let pen = color(*style).stroke_width(2 * zoom);
            match is_dashed(*style) {
                _ if *dots == Dots::Alone => chart.draw_series(Vec::<PathElement<(f64, f64)>>::new())?,
                true => chart.draw_series(DashedLineSeries::new(line.clone(), 6 * zoom, 4 * zoom, pen))?,
                // Segment by segment: where a noisy line is drawn in one piece, its pointed corners shoot far beyond it.
                false => chart.draw_series(line.windows(2).map(|ends| PathElement::new(ends.to_vec(), pen)))?,
            };
            let marked = if *dots == Dots::Last { &line[line.len() - 1..] } else { &line[..] };
            for &place in marked {
                let pixel = chart.backend_coord(&place);
                mark(area, *style, pixel, 4 * zoom as i32)?;
            }
        }
        Ok(())
    }

    /// The points that the axes can show. A band that they cannot is as narrow as the line.
    fn placed(&self, series: &Series) -> Vec<Placed> {
        let place = |point: &crate::figure::Point| {
            let (x, y) = (self.x.scale.place(point.x)?, self.y.scale.place(point.y)?);
            let edge = |value: f64| self.y.scale.place(value).unwrap_or(y);
            Some(Placed { x, y, low: edge(point.low), high: edge(point.high) })
        };
        series.points.iter().filter_map(place).collect()
    }

    pub(super) fn intervals<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        paper: Paper,
        zoom: u32,
        bars: &[Bar],
    ) -> Drawn<DB> {
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
            let ink = color(bar.style);
            let ends = [(bar.interval.low, y), (bar.interval.high, y)];
            chart.draw_series([PathElement::new(ends.to_vec(), ink.stroke_width(2 * zoom))])?;
            let pixel = chart.backend_coord(&(bar.mean, y));
            match bar.is_judged {
                true => mark(area, bar.style, pixel, 5 * zoom as i32)?,
                false => area.draw(&Circle::new(pixel, 5 * zoom, ink.stroke_width(2 * zoom)))?,
            }
        }
        Ok(())
    }

    /// Title, where no page has it, and legend; returns how high they are, px before zooming.
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
        let untitled = self.title.is_empty() || paper == Paper::Clear;
        if !untitled {
            area.draw(&Text::new(self.title.clone(), (14 * z, 18 * z), text(TITLE)))?;
        }
        let (mut x, mut y) = (14, if untitled { 18 } else { 42 });
        for Series { style, name, dots, .. } in series {
            let width = 36 + (name.chars().count() as f64 * LETTER * f64::from(SMALL)) as i32;
            if x + width > WIDTH as i32 - 10 && x > 14 {
                (x, y) = (14, y + 20);
            }
            let pen = color(*style).stroke_width(2 * zoom);
            // As the line is drawn: dashed, or not at all.
            let pieces: &[(i32, i32)] = match dots {
                Dots::Alone => &[],
                _ if is_dashed(*style) => &[(0, 6), (10, 14), (18, 24)],
                _ => &[(0, 24)],
            };
            for (from, to) in pieces {
                area.draw(&PathElement::new(vec![((x + from) * z, y * z), ((x + to) * z, y * z)], pen))?;
            }
            mark(area, *style, ((x + 12) * z, y * z), 4 * z)?;
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
        (xs, x_ticks): (Range<f64>, Vec<f64>),
        (ys, y_ticks): (Range<f64>, Vec<f64>),
    ) -> Result<Parameterization<'a, DB>, DrawingAreaErrorKind<DB::ErrorType>> {
        let label_room = if self.y.label.is_empty() { left } else { left + 4 };
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
        chart: &mut Parameterization<'_, DB>,
        zoom: u32,
        x_label: &dyn Fn(&f64) -> String,
        y_label: &dyn Fn(&f64) -> String,
    ) -> Drawn<DB> {
        let font = |size: u32| (FONT, f64::from(size * zoom)).into_font().color(&INK);
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(zoom))
            .axis_style(INK.stroke_width(zoom))
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .x_label_formatter(x_label)
            .y_label_formatter(y_label)
            .axis_desc_style(font(MEDIUM))
            .label_style(font(SMALL))
            .draw()
    }
}

/// The mark of a style: one of four shapes.
fn mark<DB: DrawingBackend>(area: &DrawingArea<DB, Shift>, style: usize, (x, y): (i32, i32), r: i32) -> Drawn<DB> {
    let fill = color(style).filled();
    match style % 4 {
        0 => area.draw(&Circle::new((x, y), r, fill)),
        1 => area.draw(&Rectangle::new([(x - r, y - r), (x + r, y + r)], fill)),
        2 => area.draw(&Polygon::new(vec![(x - r - 1, y + r), (x + r + 1, y + r), (x, y - r - 1)], fill)),
        _ => area.draw(&Polygon::new(vec![(x - r - 1, y), (x, y - r - 1), (x + r + 1, y), (x, y + r + 1)], fill)),
    }
}

fn is_dashed(style: usize) -> bool {
    style >= COLORS.len()
}
