//! The curve of a fit: the number of Gaussians and the loss over the steps, on two axes (paper Fig. 8).

use gs_core::Image;
use gs_study::figure::{FONT, embed_font};
use plotters::prelude::*;

/// Size of the picture, px.
const SIZE: (u32, u32) = (960, 600);
const COUNT_COLOR: RGBColor = RGBColor(31, 94, 168);
const LOSS_COLOR: RGBColor = RGBColor(196, 62, 28);

/// One point of the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    /// Steps done.
    pub(crate) step: u32,
    /// Number of Gaussians.
    pub(crate) count: u32,
    /// Loss, NaN where it is not known; points that are not positive and finite are left out of the loss's curve, which is logarithmic.
    pub(crate) loss: f32,
}

/// Draws the curve; `title` stands above it. Any number of points, none included.
///
/// # Errors
/// What the drawing library reports, in words.
pub(crate) fn draw(points: &[Point], title: &str) -> Result<Image, String> {
    let mut bytes = vec![255; 3 * (SIZE.0 * SIZE.1) as usize];
    plot(points, title, &mut bytes).map_err(|error| error.to_string())?;
    let pixels = bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
    Image::from_pixels(SIZE.0, SIZE.1, pixels).map_err(|error| error.to_string())
}

fn plot(points: &[Point], title: &str, bytes: &mut [u8]) -> Result<(), Box<dyn std::error::Error>> {
    embed_font();
    let area = BitMapBackend::with_buffer(bytes, SIZE).into_drawing_area();
    area.fill(&WHITE)?;

    let losses: Vec<(f64, f64)> = points
        .iter()
        .filter(|p| p.loss.is_finite() && p.loss > 0.0)
        .map(|p| (f64::from(p.step), f64::from(p.loss)))
        .collect();
    let counts: Vec<(f64, f64)> = points.iter().map(|p| (f64::from(p.step), f64::from(p.count))).collect();
    let last_step = points.last().map_or(1, |p| p.step.max(1));
    let most = points.iter().map(|p| p.count).max().unwrap_or(1).max(1);
    let (lowest, highest) =
        losses.iter().fold((f64::MAX, f64::MIN_POSITIVE), |(lo, hi), &(_, l)| (lo.min(l), hi.max(l)));
    let lowest = if losses.is_empty() { highest } else { lowest };
    let (counts, losses) = (thinned(&counts), thinned(&losses));

    let steps = 0.0..f64::from(last_step);
    let mut chart = ChartBuilder::on(&area)
        .caption(title, (FONT, 22))
        .margin(16)
        .x_label_area_size(48)
        .y_label_area_size(76)
        .right_y_label_area_size(88)
        .build_cartesian_2d(steps.clone(), 0.0..1.08 * f64::from(most))?
        .set_secondary_coord(steps, (lowest * 0.8..highest * 1.25).log_scale());
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc("step")
        .y_desc("Gaussians")
        .x_label_formatter(&|step| format!("{step:.0}"))
        .y_label_formatter(&|count| format!("{count:.0}"))
        .axis_desc_style((FONT, 18))
        .label_style((FONT, 15))
        .draw()?;
    chart
        .configure_secondary_axes()
        .y_desc("loss (logarithmic)")
        .y_label_formatter(&|loss| format!("{loss:.1e}"))
        .axis_desc_style((FONT, 18))
        .label_style((FONT, 15))
        .draw()?;

    let sample = |color: RGBColor| move |(x, y)| PathElement::new([(x, y), (x + 24, y)], color.stroke_width(2));
    // Segment by segment: where a noisy line is drawn in one piece, its pointed corners shoot far beyond it.
    let segments = |line: &[(f64, f64)], color: RGBColor| {
        let segment = |ends: &[(f64, f64)]| PathElement::new(ends.to_vec(), color.stroke_width(2));
        line.windows(2).map(segment).collect::<Vec<_>>()
    };
    chart.draw_series(segments(&counts, COUNT_COLOR))?.label("Gaussians").legend(sample(COUNT_COLOR));
    chart.draw_secondary_series(segments(&losses, LOSS_COLOR))?.label("loss").legend(sample(LOSS_COLOR));
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::MiddleRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .label_font((FONT, 16))
        .draw()?;
    area.present()?;
    Ok(())
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
        let drawn = draw(&points, "count and loss").unwrap();
        assert!(count_of(&drawn, COUNT_COLOR) > 500);
        assert!(count_of(&drawn, LOSS_COLOR) > 500);
        let title_rows = &drawn.pixels()[..(40 * SIZE.0) as usize];
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
            let drawn = draw(points, "").unwrap_or_else(|error| panic!("{points:?}: {error}"));
            assert_eq!(drawn.size(), SIZE);
        }
    }
}
