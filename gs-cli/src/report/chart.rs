//! Curves over one pair of axes, linear or logarithmic, as a PNG's pixels or as SVG; both from one drawing.
//!
//! Colours are those of Okabe and Ito, which the colour-blind can tell apart, and every other line is dashed, so that lines on top of each
//! other are seen, too. In the SVG that goes into a page, every colour is a
//! variable of the page's style, so that it follows the reader's light or dark theme.

use gs_core::Image;
use gs_train::experiments::{Axis, Chart, Mark, Series, Spread};
use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use crate::report::curve::{FONT, embed_font};

/// Size of the picture, px.
const SIZE: (u32, u32) = (600, 400);

/// Height of a row of the legend, px.
const LEGEND_ROW: i32 = 22;

/// Mean width of a letter of the legend, px: the font is monospaced where it is embedded, narrower elsewhere.
const LETTER: f64 = 7.6;

/// Colours of the curves, in their order.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(110, 110, 110),
    RGBColor(86, 180, 233),
];

/// The chart as pixels.
///
/// # Errors
/// What the drawing library reports, in words.
pub(crate) fn picture(chart: &Chart) -> Result<Image, String> {
    let mut bytes = vec![255; 3 * (SIZE.0 * SIZE.1) as usize];
    plot(&BitMapBackend::with_buffer(&mut bytes, SIZE).into_drawing_area(), chart)
        .map_err(|error| error.to_string())?;
    let pixels = bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
    Image::from_pixels(SIZE.0, SIZE.1, pixels).map_err(|error| error.to_string())
}

/// The chart as an SVG file's text.
///
/// # Errors
/// What the drawing library reports, in words.
pub(crate) fn svg(chart: &Chart) -> Result<String, String> {
    let mut text = String::new();
    plot(&SVGBackend::with_string(&mut text, SIZE).into_drawing_area(), chart).map_err(|error| error.to_string())?;
    Ok(text)
}

/// An SVG of [`svg`] for a page whose style defines `--ink`, `--surface` and `--curve-0` to `--curve-6`.
pub(crate) fn themed(svg: &str) -> String {
    let hex = |RGBColor(r, g, b): RGBColor| format!("#{r:02X}{g:02X}{b:02X}");
    let mut text = svg.replace(&hex(BLACK), "var(--ink)").replace(&hex(WHITE), "var(--surface)");
    for (i, color) in COLORS.into_iter().enumerate() {
        text = text.replace(&hex(color), &format!("var(--curve-{i})"));
    }
    // The page says how wide it is; the view box keeps the proportions.
    let (width, height) = SIZE;
    text.replacen(&format!("width=\"{width}\" height=\"{height}\" "), "", 1)
}

/// The style's colours of the curves on a light and on a dark page, as declarations of CSS variables.
pub(crate) fn curve_colors() -> (String, String) {
    let declare = |color: fn(RGBColor) -> [u8; 3]| {
        let each = COLORS.into_iter().map(color).enumerate();
        each.map(|(i, [r, g, b])| format!("--curve-{i}:#{r:02X}{g:02X}{b:02X};")).collect::<String>()
    };
    // On dark, halfway to white for what is dark itself.
    let lighter = |RGBColor(r, g, b): RGBColor| {
        let luma = 0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b);
        [r, g, b].map(|v| if luma < 140.0 { v + (255 - v) / 3 } else { v })
    };
    (declare(|RGBColor(r, g, b)| [r, g, b]), declare(lighter))
}

type Drawn = Result<(), Box<dyn std::error::Error>>;

fn plot<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart) -> Drawn
where
    B::ErrorType: 'static,
{
    embed_font();
    area.fill(&WHITE)?;
    let shown: Vec<Vec<(f64, f64)>> = chart.series.iter().map(|series| shown_points(chart, series)).collect();
    let rows = legend(area, &chart.series)?;
    let (_, below) = area.split_vertically(rows * LEGEND_ROW + 8);
    let x = range(chart.x, shown.iter().flatten().map(|p| p.0));
    let y = range(chart.y, shown.iter().flatten().map(|p| p.1));
    let mut builder = ChartBuilder::on(&below);
    builder.margin(10).margin_right(24).x_label_area_size(44).y_label_area_size(74);
    // The four kinds of axes are four types.
    macro_rules! draw {
        ($x:expr, $y:expr) => {{
            let mut context = builder.build_cartesian_2d($x, $y)?;
            context
                .configure_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(BLACK.mix(0.14))
                .axis_style(BLACK.mix(0.6))
                .x_desc(chart.x.label)
                .y_desc(chart.y.label)
                .x_labels(8)
                .y_labels(8)
                .x_label_formatter(&|v| tick(*v))
                .y_label_formatter(&|v| tick(*v))
                .axis_desc_style((FONT, 15, &BLACK))
                .label_style((FONT, 14, &BLACK))
                .draw()?;
            for (index, (series, points)) in chart.series.iter().zip(&shown).enumerate() {
                let style = color(index).stroke_width(2);
                if is_dashed(index) {
                    context.draw_series(DashedLineSeries::new(points.iter().copied(), DASH, GAP, style))?;
                } else {
                    // Segment by segment: where a noisy line is drawn in one piece, its pointed corners shoot far beyond it.
                    context.draw_series(points.windows(2).map(|ends| PathElement::new(ends.to_vec(), style)))?;
                }
                if series.mark == Mark::Dotted {
                    context.draw_series(points.iter().map(|&p| Circle::new(p, 4, color(index).filled())))?;
                }
            }
        }};
    }
    match (chart.x.spread, chart.y.spread) {
        (Spread::Linear, Spread::Linear) => draw!(x.0..x.1, y.0..y.1),
        (Spread::Linear, Spread::Logarithmic) => draw!(x.0..x.1, (y.0..y.1).log_scale()),
        (Spread::Logarithmic, Spread::Linear) => draw!((x.0..x.1).log_scale(), y.0..y.1),
        (Spread::Logarithmic, Spread::Logarithmic) => draw!((x.0..x.1).log_scale(), (y.0..y.1).log_scale()),
    }
    area.present()?;
    Ok(())
}

/// Lengths of a dash and of what lies between two, px.
const DASH: u32 = 7;
const GAP: u32 = 4;

fn is_dashed(index: usize) -> bool {
    index % 2 == 1
}

fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}

/// The points that the axes can show.
fn shown_points(chart: &Chart, series: &Series) -> Vec<(f64, f64)> {
    let fits = |axis: Axis, v: f64| v.is_finite() && (axis.spread == Spread::Linear || v > 0.0);
    series.points.iter().copied().filter(|&(x, y)| fits(chart.x, x) && fits(chart.y, y)).collect()
}

/// From the lowest to the highest value, with some room; a linear axis of nothing but positive numbers begins at 0.
fn range(axis: Axis, values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    match axis.spread {
        _ if low > high => (1.0, 2.0),
        Spread::Logarithmic => (low / 1.3, high * 1.3),
        Spread::Linear if low >= 0.0 => (0.0, if high > 0.0 { 1.05 * high } else { 1.0 }),
        Spread::Linear => (low - 0.03 * (high - low), high + 0.03 * (high - low) + f64::MIN_POSITIVE),
    }
}

/// A number on an axis.
fn tick(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        v if !(0.001..10_000.0).contains(&v) => {
            let exponent = v.log10().floor();
            let mantissa = value / 10f64.powf(exponent);
            if (mantissa.abs() - 1.0).abs() < 1e-6 {
                format!("1e{exponent}")
            } else {
                format!("{mantissa:.1}e{exponent}")
            }
        }
        _ => {
            let text = format!("{value:.3}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
    }
}

/// The names of the curves in rows above the chart; returns how many rows.
fn legend<B: DrawingBackend>(area: &DrawingArea<B, Shift>, series: &[Series]) -> Result<i32, Box<dyn std::error::Error>>
where
    B::ErrorType: 'static,
{
    const SAMPLE: i32 = 26;
    let style = (FONT, 14).into_font().color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center));
    let (mut x, mut row) = (20, 0);
    for (index, series) in series.iter().enumerate() {
        let width = SAMPLE + 8 + (series.label.chars().count() as f64 * LETTER) as i32 + 18;
        if x > 20 && x + width > SIZE.0 as i32 {
            (x, row) = (20, row + 1);
        }
        let y = 14 + row * LEGEND_ROW;
        let pieces = if is_dashed(index) { vec![(0, 11), (15, SAMPLE)] } else { vec![(0, SAMPLE)] };
        for (from, to) in pieces {
            area.draw(&PathElement::new([(x + from, y), (x + to, y)], color(index).stroke_width(3)))?;
        }
        area.draw(&Text::new(series.label.clone(), (x + SAMPLE + 8, y), style.clone()))?;
        x += width;
    }
    Ok(row + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(x: Axis, y: Axis, series: Vec<Series>) -> Chart {
        Chart { name: "test", title: "a test".to_owned(), x, y, series }
    }

    #[test]
    fn curves_axes_and_legend_are_there_in_both_forms() {
        let falling = (1..200).map(|x| (f64::from(x), 0.3 / f64::from(x))).collect();
        let rising = (1..200).map(|x| (f64::from(x), f64::from(x) * 1e-3)).collect();
        let series = vec![Series::line("falling", falling), Series::dotted("rising <&>", rising)];
        let chart = chart(Axis::linear("step"), Axis::logarithmic("loss, px²"), series);
        let drawn = picture(&chart).unwrap();
        let count = |RGBColor(r, g, b): RGBColor| {
            let wanted = [r, g, b].map(|v| f32::from(v) / 255.0);
            drawn.pixels().iter().filter(|p| p.iter().zip(wanted).all(|(v, w)| (v - w).abs() < 0.02)).count()
        };
        assert!(count(COLORS[0]) > 300 && count(COLORS[1]) > 300 && count(COLORS[2]) == 0);
        let text = svg(&chart).unwrap();
        for word in ["falling", "rising &lt;&amp;&gt;", "step", "loss, px²", "#0072B2"] {
            assert!(text.contains(word), "{word} in {text}");
        }
        let themed = themed(&text);
        assert!(themed.contains("var(--curve-0)") && themed.contains("var(--ink)") && themed.contains("viewBox"));
        // The page gives it its size.
        let opening = themed.split('>').next().unwrap();
        assert!(!themed.contains("#0072B2") && !opening.contains("width"), "{opening}");
    }

    #[test]
    fn any_points_make_a_chart() {
        let lines: [Vec<(f64, f64)>; 5] = [
            vec![],
            vec![(1.0, 1.0)],
            vec![(0.0, 0.0), (f64::NAN, 1.0)],
            vec![(-1.0, -2.0), (3.0, f64::INFINITY)],
            vec![(1e-30, 1e30), (1e30, 1e-30)],
        ];
        for points in lines {
            for x in [Axis::linear("x"), Axis::logarithmic("x")] {
                for y in [Axis::linear("y"), Axis::logarithmic("y")] {
                    let chart = chart(x, y, vec![Series::dotted("one", points.clone())]);
                    picture(&chart).unwrap_or_else(|error| panic!("{points:?}: {error}"));
                }
            }
        }
    }

    #[test]
    fn ticks_are_short() {
        let cases = [(0.0, "0"), (250.0, "250"), (0.25, "0.25"), (1e-5, "1e-5"), (25_000.0, "2.5e4"), (-12.5, "-12.5")];
        for (value, expected) in cases {
            assert_eq!(tick(value), expected);
        }
    }
}
