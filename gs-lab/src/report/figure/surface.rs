//! What figures are drawn on: SVG text or pixels. Only these few functions call the drawing
//! library, whose generic code takes long to compile.

use plotters::{
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::{FONT, INK};

/// A position, px.
pub(super) type Place = (i32, i32);

/// An empty SVG or bitmap.
pub(super) enum Surface<'a> {
    Svg(SVGBackend<'a>),
    Pixels(BitMapBackend<'a>),
}

/// Calls a method of either backend.
macro_rules! either {
    ($surface:expr, $backend:ident => $call:expr) => {
        match $surface {
            Self::Svg($backend) => $call.map_err(|error| error.to_string()),
            Self::Pixels($backend) => $call.map_err(|error| error.to_string()),
        }
    };
}

impl Surface<'_> {
    /// A line through these points.
    pub(super) fn line(&mut self, points: &[Place], color: RGBColor, width: u32) -> Result<(), String> {
        let style = color.stroke_width(width);
        match self {
            Self::Svg(svg) => svg.draw_path(points.iter().copied(), &style).map_err(|error| error.to_string()),
            // Separate segments: in one piece, a noisy line has miter joins that reach far beyond
            // it.
            Self::Pixels(pixels) => points
                .windows(2)
                .try_for_each(|ends| pixels.draw_path(ends.iter().copied(), &style).map_err(|error| error.to_string())),
        }
    }

    /// A filled polygon.
    pub(super) fn polygon(&mut self, corners: &[Place], color: RGBAColor) -> Result<(), String> {
        either!(self, backend => backend.fill_polygon(corners.iter().copied(), &color.filled()))
    }

    /// A filled circle.
    pub(super) fn disc(&mut self, center: Place, radius: u32, color: RGBColor) -> Result<(), String> {
        either!(self, backend => backend.draw_circle(center, radius, &color.filled(), true))
    }

    /// A circle's outline.
    pub(super) fn circle(&mut self, center: Place, radius: u32, color: RGBColor, width: u32) -> Result<(), String> {
        either!(self, backend => backend.draw_circle(center, radius, &color.stroke_width(width), false))
    }

    /// Text whose anchor is at `place`.
    pub(super) fn text(&mut self, text: &str, place: Place, size: f64, anchor: (HPos, VPos)) -> Result<(), String> {
        let style = (FONT, size).into_font().color(&INK).pos(Pos::new(anchor.0, anchor.1));
        either!(self, backend => backend.draw_text(text, &style, place))
    }

    /// Text that reads upwards, centred at `place`.
    pub(super) fn upward_text(&mut self, text: &str, place: Place, size: f64) -> Result<(), String> {
        let font = (FONT, size).into_font().transform(FontTransform::Rotate270);
        let style = font.color(&INK).pos(Pos::new(HPos::Center, VPos::Top));
        either!(self, backend => backend.draw_text(text, &style, place))
    }

    /// Ends the drawing.
    pub(super) fn finish(mut self) -> Result<(), String> {
        either!(&mut self, backend => backend.present())
    }
}
