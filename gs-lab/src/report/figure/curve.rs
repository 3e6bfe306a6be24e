//! Figures of a fit over its steps, one below the other: number of Gaussians and loss
//! (paper Fig. 8), and PSNR.

use gs_train::MetricsRow;

use super::{Axis, Dots, Figure, HEIGHT, Marks, Series, WIDTH};

/// One point of the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Steps done.
    pub step: u32,
    /// Number of Gaussians.
    pub count: u32,
    /// The loss. Points that are not positive and finite are left out of its curve, which is
    /// logarithmic.
    pub loss: f32,
}

/// Draws the curves under a title, as an SVG file, with the PSNR of a log's rows. Without a
/// finite PSNR its figure is left out.
pub fn draw(points: &[CurvePoint], rows: &[MetricsRow], title: &str) -> String {
    let counts = points.iter().map(|p| (f64::from(p.step), f64::from(p.count))).collect();
    let losses = points.iter().map(|p| (f64::from(p.step), f64::from(p.loss)));
    let losses = losses.filter(|(_, loss)| loss.is_finite() && *loss > 0.0).collect();
    let psnrs = rows.iter().filter_map(|row| Some((f64::from(row.step), row.psnr?)));
    let psnrs: Vec<(f64, f64)> = psnrs.filter(|(_, psnr)| psnr.is_finite()).collect();
    let mut panels = vec![
        panel(title, 0, Axis::linear("Gaussians"), thinned(counts), Dots::Last),
        panel("", 1, Axis::logarithmic("loss"), thinned(losses), Dots::Last),
    ];
    if !psnrs.is_empty() {
        panels.push(panel("", 2, Axis::linear("PSNR, dB"), psnrs, Dots::All));
    }
    let height = panels.len() as u32 * HEIGHT;
    let below = |(place, panel): (u32, &Figure)| {
        panel.svg_file().replacen("<svg ", &format!("<svg y=\"{}\" ", place * HEIGHT), 1)
    };
    let panels: String = (0..).zip(&panels).map(below).collect();
    format!("<svg width=\"{WIDTH}\" height=\"{height}\" xmlns=\"http://www.w3.org/2000/svg\">\n{panels}</svg>\n")
}

fn panel(title: &str, style: usize, y: Axis, points: Vec<(f64, f64)>, dots: Dots) -> Figure {
    let series = Series { style, dots, ..Series::line(y.label.clone(), points) };
    let x = Axis::linear("step");
    Figure { name: "curve".to_owned(), title: title.to_owned(), x, y, marks: Marks::Lines(vec![series]) }
}

/// Reduces a line to what the picture can show: the lowest and the highest point of each of
/// `BUCKETS` parts.
fn thinned(line: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    const BUCKETS: usize = 400;
    if line.len() <= 2 * BUCKETS {
        return line;
    }
    let (first, last) = (line.first().copied(), line.last().copied());
    let extremes = line.chunks(line.len().div_ceil(BUCKETS)).flat_map(|part| {
        let by_height = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let mut ends = [part.iter().min_by(by_height), part.iter().max_by(by_height)];
        ends.sort_by(|a, b| a.map(|p| p.0).partial_cmp(&b.map(|p| p.0)).unwrap_or(std::cmp::Ordering::Equal));
        ends.into_iter().flatten().copied()
    });
    first.into_iter().chain(extremes).chain(last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{report::figure::color, run::tests::finished};

    /// Rows of a log with a PSNR after each of these steps.
    fn rows(psnrs: &[(u32, f64)]) -> Vec<MetricsRow> {
        let row = finished(0.0).trajectory[0];
        psnrs.iter().map(|&(step, psnr)| MetricsRow { step, psnr: Some(psnr), ..row }).collect()
    }

    #[test]
    fn all_curves_and_the_title_are_there() {
        let points: Vec<CurvePoint> =
            (0..200).map(|step| CurvePoint { step, count: 20 + 3 * step, loss: 0.2 / (1.0 + step as f32) }).collect();
        let psnrs: Vec<(u32, f64)> = (0..10).map(|i| (20 * i, 20.0 + f64::from(i))).collect();
        let has = |svg: &str, style: usize| svg.contains(&format!("<path fill=\"none\" stroke=\"{}\"", color(style)));
        let drawn = draw(&points, &rows(&psnrs), "count < loss");
        assert!((0..3).all(|style| has(&drawn, style)) && drawn.contains("count &lt; loss"), "{drawn}");
        assert!(
            drawn.contains(&format!("height=\"{}\"", 3 * HEIGHT)) && drawn.contains(&format!("<svg y=\"{HEIGHT}\""))
        );
        let without = draw(&points, &[], "count and loss");
        assert!(without.contains(&format!("height=\"{}\"", 2 * HEIGHT)) && !has(&without, 2), "{without}");
    }

    #[test]
    fn thinning_keeps_ends_and_extremes() {
        let mut line: Vec<(f64, f64)> = (0..10_000).map(|x| (f64::from(x), 1.0 + f64::from(x % 7))).collect();
        (line[1234].1, line[8765].1) = (100.0, -100.0);
        let few = thinned(line.clone());
        assert!(few.len() <= 802 && few.is_sorted_by(|a, b| a.0 <= b.0));
        assert!(few.contains(&(1234.0, 100.0)) && few.contains(&(8765.0, -100.0)));
        assert_eq!((few.first(), few.last()), (line.first(), line.last()));
        assert_eq!(thinned(line[..800].to_vec()), line[..800]);
    }

    #[test]
    #[expect(clippy::type_complexity, reason = "a table of cases")]
    fn any_points_make_a_picture() {
        let at = |step, count, loss| CurvePoint { step, count, loss };
        let cases: [(&[CurvePoint], &[(u32, f64)]); 4] = [
            (&[], &[]),
            (&[at(0, 1, 0.5)], &[(0, f64::INFINITY)]),
            (&[at(1, 0, 0.0), at(2, 0, f32::NAN)], &[(0, -3.0), (9, 1e9)]),
            (&[at(1, 5, f32::INFINITY), at(4_000_000_000, 4_000_000_000, 1e-30)], &[(7, 0.0)]),
        ];
        for (points, psnrs) in cases {
            let svg = draw(points, &rows(psnrs), "");
            assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"), "{points:?}, {psnrs:?}");
        }
    }
}
