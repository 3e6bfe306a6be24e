//! The frame of all HTML pages: a single file without links or network access, with a light and a
//! dark theme.

use super::figure::{COLORS, Figure, GRID, INK, Rgb, hex};
use base64::{Engine, engine::general_purpose::STANDARD};
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("html.css");

/// An HTML page with this title and body.
pub(crate) fn page(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(figure_style())) }
            }
            body { (body) }
        }
    };
    page.into_string()
}

/// A figure with its title as caption.
pub(crate) fn figure(drawn: &Figure) -> Markup {
    html! { figure { figcaption.title { (drawn.title) } (PreEscaped(drawn.inline_svg())) } }
}

/// A square in the colour of a [`Series::style`](crate::report::figure::Series::style), shown before a
/// name.
pub(crate) fn swatch(style: usize) -> Markup {
    html! { span.swatch style=(format!("background:var(--curve-{})", style % COLORS.len())) {} }
}

/// A data URI for the `src` of an `img`; `kind` is the subtype, such as `png`.
pub(crate) fn data_uri(kind: &str, bytes: &[u8]) -> String {
    format!("data:image/{kind};base64,{}", STANDARD.encode(bytes))
}

/// CSS rules that make figures follow the page's theme. Each colour is a variable; dark curves are
/// lightened on a dark page.
fn figure_style() -> String {
    let lighter = |[r, g, b]: Rgb| {
        let luma = 0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b);
        if luma < 140.0 { [r, g, b].map(|v| v + (255 - v) / 3) } else { [r, g, b] }
    };
    let declared = |color: &dyn Fn(Rgb) -> Rgb| {
        let each = COLORS.into_iter().enumerate().map(|(i, c)| format!("--curve-{i}:{};", hex(color(c))));
        each.collect::<String>()
    };
    let names = [(INK, "ink".to_owned()), (GRID, "grid".to_owned())];
    let curves = COLORS.into_iter().enumerate().map(|(i, color)| (color, format!("curve-{i}")));
    let rules = names.into_iter().chain(curves).map(|(color, name)| {
        let color = hex(color);
        format!("svg [stroke=\"{color}\"]{{stroke:var(--{name})}}svg [fill=\"{color}\"]{{fill:var(--{name})}}\n")
    });
    format!(
        ":root{{{}}}\n@media(prefers-color-scheme:dark){{:root{{{}}}}}\n{}",
        declared(&|color| color),
        declared(&lighter),
        rules.collect::<String>()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::figure::{Axis, Marks, Series};

    #[test]
    fn a_page_stands_alone_and_its_figures_follow_its_theme() {
        let series = vec![Series::line("falling", vec![(0.0, 2.0), (1.0, 1.0)]), Series::line("<&>", vec![(0.0, 0.5)])];
        let (x, y) = (Axis::linear("step"), Axis::linear("loss"));
        let drawn = Figure { name: "f".to_owned(), title: "a < b".to_owned(), x, y, marks: Marks::lines(series) };
        let page = page("t", &figure(&drawn));
        for part in [
            "a &lt; b",
            "&lt;&amp;&gt;",
            "<svg",
            "--curve-6:",
            "#0072B2",
            "svg [stroke=\"#0072B2\"]{stroke:var(--curve-0)}",
        ] {
            assert!(page.contains(part), "{part}");
        }
        let outside = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!outside.contains("http") && !outside.contains("<script") && !outside.contains("url("), "no network");
    }
}
