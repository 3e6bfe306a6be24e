//! The curve of a fit over its steps: the number of Gaussians and the loss on two axes (paper Fig. 8), and below them the PSNR where it was
//! measured.

use std::ops::Range;

use gs_core::Image;
use plotters::{
    coord::{Shift, types::RangedCoordf64},
    prelude::*,
};

use super::{FONT, Scale, axis::Ticked, embed_font, human};
use crate::error::Error;

/// Width of the picture, px.
const WIDTH: u32 = 960;
/// Height of the chart of count and loss, px.
const UPPER: u32 = 560;
/// Height of the chart of PSNR, px.
const LOWER: u32 = 340;
const COUNT_COLOR: RGBColor = RGBColor(31, 94, 168);
const LOSS_COLOR: RGBColor = RGBColor(196, 62, 28);
const PSNR_COLOR: RGBColor = RGBColor(0, 121, 88);
/// Room for the labels of the axes, px: below, on the left, on the right.
const LABELS: [u32; 3] = [48, 84, 92];

/// One point of the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Steps done.
    pub step: u32,
    /// Number of Gaussians.
    pub count: u32,
    /// Loss, NaN where it is not known; points that are not positive and finite are left out of the loss's curve, which is logarithmic.
    pub loss: f32,
}

/// The PSNR after a step, dB.
pub type Psnr = (u32, f64);

/// Where the PSNR was measured, as the rows of a log have it.
pub fn measured(rows: &[gs_train::MetricsRow]) -> Vec<Psnr> {
    rows.iter().filter_map(|row| Some((row.step, row.psnr?))).collect()
}

/// Draws the curve; `title` stands above it. Any number of points, none included; without a chart of PSNR where there is none that is finite.
///
/// # Errors
/// [`Error::Picture`] with what the drawing library reports.
pub fn draw(points: &[Point], psnrs: &[Psnr], title: &str) -> Result<Image, Error> {
    let failed = |message: String| Error::Picture { name: "the curve".to_owned(), message };
    let psnrs: Vec<(f64, f64)> =
        psnrs.iter().filter(|psnr| psnr.1.is_finite()).map(|&(step, psnr)| (f64::from(step), psnr)).collect();
    let height = if psnrs.is_empty() { UPPER } else { UPPER + LOWER };
    let mut bytes = vec![255; 3 * (WIDTH * height) as usize];
    plot(points, &psnrs, title, &mut bytes, height).map_err(|error| failed(error.to_string()))?;
    let pixels = bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
    Image::from_pixels(WIDTH, height, pixels).map_err(|error| failed(error.to_string()))
}

type Drawn = Result<(), Box<dyn std::error::Error>>;
type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

fn plot(points: &[Point], psnrs: &[(f64, f64)], title: &str, bytes: &mut [u8], height: u32) -> Drawn {
    embed_font();
    let area = BitMapBackend::with_buffer(bytes, (WIDTH, height)).into_drawing_area();
    area.fill(&WHITE)?;
    let (upper, lower) = area.split_vertically(UPPER);
    let last_step = points.last().map_or(1, |p| p.step.max(1));
    let steps = 0.0..f64::from(last_step);
    count_and_loss(&upper, points, steps.clone(), title)?;
    if !psnrs.is_empty() {
        quality(&lower, psnrs, steps)?;
    }
    area.present()?;
    Ok(())
}

fn count_and_loss(area: &Area<'_>, points: &[Point], steps: Range<f64>, title: &str) -> Drawn {
    let losses: Vec<(f64, f64)> = points
        .iter()
        .filter(|p| p.loss.is_finite() && p.loss > 0.0)
        .map(|p| (f64::from(p.step), f64::from(p.loss).log10()))
        .collect();
    let counts: Vec<(f64, f64)> = points.iter().map(|p| (f64::from(p.step), f64::from(p.count))).collect();
    let most = points.iter().map(|p| p.count).max().unwrap_or(1).max(1);
    let (lowest, highest) = losses.iter().fold((f64::MAX, f64::MIN), |(lo, hi), &(_, l)| (lo.min(l), hi.max(l)));
    let decades = if losses.is_empty() { -1.0..0.0 } else { lowest - 0.1..highest + 0.1 };
    let (counts, losses) = (thinned(&counts), thinned(&losses));

    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, 22))
        .margin(16)
        .x_label_area_size(LABELS[0])
        .y_label_area_size(LABELS[1])
        .right_y_label_area_size(LABELS[2])
        .build_cartesian_2d(steps.clone(), 0.0..1.08 * f64::from(most))?
        .set_secondary_coord(steps, Ticked::new(decades.clone(), Scale::Logarithmic.ticks(&decades)));
    mesh(&mut chart, "Gaussians")?;
    chart
        .configure_secondary_axes()
        .y_desc("loss (logarithmic)")
        .y_label_formatter(&|decade| human(10f64.powf(*decade)))
        .axis_desc_style((FONT, 18))
        .label_style((FONT, 15))
        .draw()?;

    let sample = |color: RGBColor| move |(x, y)| PathElement::new([(x, y), (x + 24, y)], color.stroke_width(2));
    chart.draw_series(segments(&counts, COUNT_COLOR))?.label("Gaussians").legend(sample(COUNT_COLOR));
    chart.draw_secondary_series(segments(&losses, LOSS_COLOR))?.label("loss").legend(sample(LOSS_COLOR));
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::MiddleRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .label_font((FONT, 16))
        .draw()?;
    Ok(())
}

/// The PSNR under the same steps.
fn quality(area: &Area<'_>, psnrs: &[(f64, f64)], steps: Range<f64>) -> Drawn {
    let (low, high) = psnrs.iter().fold((f64::MAX, f64::MIN), |(low, high), &(_, v)| (low.min(v), high.max(v)));
    let room = (0.08 * (high - low)).max(0.5);
    let mut chart = ChartBuilder::on(area)
        .margin(16)
        .margin_right(16 + LABELS[2])
        .x_label_area_size(LABELS[0])
        .y_label_area_size(LABELS[1])
        .build_cartesian_2d(steps, low - room..high + room)?;
    mesh(&mut chart, "PSNR, dB")?;
    chart.draw_series(segments(psnrs, PSNR_COLOR))?;
    chart.draw_series(psnrs.iter().map(|&point| Circle::new(point, 3, PSNR_COLOR.filled())))?;
    Ok(())
}

fn mesh<'a>(
    chart: &mut ChartContext<'_, BitMapBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
    what: &str,
) -> Drawn {
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc("step")
        .y_desc(what)
        .x_label_formatter(&|step| human(*step))
        .y_label_formatter(&|value| human(*value))
        .axis_desc_style((FONT, 18))
        .label_style((FONT, 15))
        .draw()?;
    Ok(())
}

/// A line segment by segment: where a noisy one is drawn in one piece, its pointed corners shoot far beyond it.
fn segments(line: &[(f64, f64)], color: RGBColor) -> Vec<PathElement<(f64, f64)>> {
    line.windows(2).map(|ends| PathElement::new(ends.to_vec(), color.stroke_width(2))).collect()
}

/// A line of no more points than the picture can show: of many, the lowest and the highest of each of `BUCKETS` stretches.
fn thinned(line: &[(f64, f64)]) -> Vec<(f64, f64)> {
    const BUCKETS: usize = 400;
    if line.len() <= 2 * BUCKETS {
        return line.to_vec();
    }
    let (first, last) = (line.first().copied(), line.last().copied());
    let extremes = line.chunks(line.len().div_ceil(BUCKETS)).flat_map(|stretch| {
        let by_height = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let mut ends: Vec<(f64, f64)> = [stretch.iter().min_by(by_height), stretch.iter().max_by(by_height)]
            .into_iter()
            .flatten()
            .copied()
            .collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        ends
    });
    first.into_iter().chain(extremes).chain(last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many pixels are close to a colour.
    fn count_of(image: &Image, RGBColor(r, g, b): RGBColor) -> usize {
        let wanted = [r, g, b].map(|v| f32::from(v) / 255.0);
        image.pixels().iter().filter(|p| p.iter().zip(wanted).all(|(v, w)| (v - w).abs() < 0.02)).count()
    }

    #[test]
    fn both_curves_and_the_lettering_are_there() {
        let points: Vec<Point> =
            (0..200).map(|step| Point { step, count: 20 + 3 * step, loss: 0.2 / (1.0 + step as f32) }).collect();
        let psnrs: Vec<Psnr> = (0..10).map(|i| (20 * i, 20.0 + f64::from(i))).collect();
        let drawn = draw(&points, &psnrs, "count and loss").unwrap();
        assert!(count_of(&drawn, COUNT_COLOR) > 500);
        assert!(count_of(&drawn, LOSS_COLOR) > 500);
        assert!(count_of(&drawn, PSNR_COLOR) > 500);
        assert_eq!(drawn.size(), (WIDTH, UPPER + LOWER));
        let without = draw(&points, &[], "count and loss").unwrap();
        assert_eq!((without.size(), count_of(&without, PSNR_COLOR)), ((WIDTH, UPPER), 0));
        let title_rows = &drawn.pixels()[..(40 * WIDTH) as usize];
        assert!(title_rows.iter().filter(|p| p[0] < 0.4).count() > 200, "the title is written");
    }

    #[test]
    fn thinning_keeps_ends_and_extremes() {
        let mut line: Vec<(f64, f64)> = (0..10_000).map(|x| (f64::from(x), 1.0 + f64::from(x % 7))).collect();
        (line[1234].1, line[8765].1) = (100.0, -100.0);
        let few = thinned(&line);
        assert!(few.len() <= 802 && few.is_sorted_by(|a, b| a.0 <= b.0));
        assert!(few.contains(&(1234.0, 100.0)) && few.contains(&(8765.0, -100.0)));
        assert_eq!((few.first(), few.last()), (line.first(), line.last()));
        assert_eq!(thinned(&line[..800]), line[..800]);
    }

    #[test]
    fn any_points_make_a_picture() {
        let at = |step, count, loss| Point { step, count, loss };
        let cases: [&[Point]; 5] = [
            &[],
            &[at(0, 1, 0.5)],
            &[at(1, 0, 0.0), at(2, 0, f32::NAN)],
            &[at(1, 5, 0.1), at(2, 5, 0.1)],
            &[at(1, 5, f32::INFINITY), at(4_000_000_000, 4_000_000_000, 1e-30)],
        ];
        for points in cases {
            for psnrs in [&[][..], &[(1, 20.0)], &[(0, f64::INFINITY)], &[(0, -3.0), (9, 1e9)]] {
                draw(points, psnrs, "").unwrap_or_else(|error| panic!("{points:?}, {psnrs:?}: {error}"));
            }
        }
    }
}
