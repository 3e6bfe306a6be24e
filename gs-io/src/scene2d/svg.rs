//! Export of 2D scenes to SVG: each Gaussian is an ellipse with a radial gradient, painted back to
//! front.
//!
//! The export is approximate: a gradient has [`STOPS`] stops with linear interpolation, and ends at
//! [`RADIUS`] standard deviations; colours and opacities have 8 bits; antialiasing is that of the
//! picture's own size.

use std::{
    io::{self, Write},
    path::Path,
};

use glam::{Mat2, Vec2};
use gs_core::{Blend, Gaussian2d, Scene, effects::Antialias, sigmoid, to_8_bits};

use super::File2d;
use crate::{atomic::write_durably, error::Error};

/// Radius of a gradient, standard deviations. A Gaussian's weight is 1/255 there, where the
/// renderer cuts it off, too.
const RADIUS: f32 = 3.33;

/// Stops of a gradient. Linear interpolation between them is within 0.01 of a Gaussian.
const STOPS: u32 = 10;

/// Writes the scene as an SVG of the picture's size, atomically.
///
/// # Errors
/// [`Error::Content`] where [`File2d::validate`] fails and for a scene blended by [`Blend::Sum`]:
/// SVG has no negative colours, which such scenes need. Those of
/// [`write_durably`](crate::write_durably).
pub fn write_svg(path: impl AsRef<Path>, file: &File2d) -> Result<(), Error> {
    let path = path.as_ref();
    file.validate().map_err(Error::content(path))?;
    if file.settings.effects.blend == Blend::Sum {
        let message = "its Gaussians are added up (blend sum), some with negative colours, which SVG does not have";
        return Err(Error::content(path)(gs_core::Error::State(message.to_owned())));
    }
    write_durably(path, |out| write(file, out))
}

fn write(file: &File2d, out: &mut dyn Write) -> io::Result<()> {
    let File2d { scene, width, height, settings, .. } = file;
    writeln!(
        out,
        r#"<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">"#
    )?;
    writeln!(out, r#"<rect width="{width}" height="{height}" fill="{}"/>"#, hex(settings.background_color()))?;
    for index in (0..scene.len()).rev() {
        ellipse(index, &scene.gaussian(index), settings.effects.antialias, out)?;
    }
    writeln!(out, "</svg>")
}

/// Writes a Gaussian as a circle of [`RADIUS`] around the origin with a transformation.
fn ellipse(index: usize, g: &Gaussian2d, antialias: Antialias, out: &mut dyn Write) -> io::Result<()> {
    let (frame, share) = shown(g.factor(), antialias);
    let opacity = share * sigmoid(g.opacity_logit);
    let color = hex(g.color.to_array());
    write!(out, r#"<radialGradient id="g{index}" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="{RADIUS}">"#)?;
    for stop in 0..=STOPS {
        let offset = stop as f32 / STOPS as f32;
        let weight = (-0.5 * (offset * RADIUS).powi(2)).exp();
        write!(out, r#"<stop offset="{offset}" stop-color="{color}" stop-opacity="{weight:.3}"/>"#)?;
    }
    let [a, b, c, d] = frame.to_cols_array();
    let Vec2 { x, y } = g.mean;
    writeln!(
        out,
        r#"</radialGradient><circle r="{RADIUS}" fill="url(#g{index})" fill-opacity="{opacity:.3}" transform="matrix({a:.4} {b:.4} {c:.4} {d:.4} {x:.3} {y:.3})"/>"#
    )
}

/// The covariance factor and the share of the opacity after antialiasing.
fn shown(frame: Mat2, antialias: Antialias) -> (Mat2, f32) {
    if antialias == Antialias::None {
        return (frame, 1.0);
    }
    let widened = frame * frame.transpose() + Mat2::from_diagonal(Vec2::splat(antialias.dilation()));
    let share = match antialias.compensates() {
        false => 1.0,
        true => (frame.determinant().abs() / widened.determinant().sqrt()).min(1.0),
    };
    // Cholesky: the first column of L carries all of x.
    let x = widened.x_axis.x.sqrt();
    let below = widened.x_axis.y / x;
    let y = (widened.y_axis.y - below * below).max(0.0).sqrt();
    (Mat2::from_cols(Vec2::new(x, below), Vec2::new(0.0, y)), share)
}

fn hex(color: [f32; 3]) -> String {
    let [r, g, b] = color.map(to_8_bits);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use gs_core::RenderSettings;

    fn file(blend: Blend) -> File2d {
        let gaussian = |x: f32, color: Vec3| Gaussian2d {
            mean: Vec2::new(x, 4.0),
            log_scale: Vec2::new(1.0, 0.0),
            rotation: 0.3,
            opacity_logit: 0.0,
            color,
        };
        let scene = [gaussian(3.0, Vec3::X), gaussian(5.5, Vec3::new(2.0, -1.0, 0.5))].into_iter().collect();
        let settings = RenderSettings::blended(blend).on([1.0, 0.0, 1.0]);
        File2d { scene, width: 12, height: 8, settings, profile: None }
    }

    #[test]
    fn gaussians_are_painted_back_to_front_over_the_background() {
        let mut bytes = Vec::new();
        write(&file(Blend::Over), &mut bytes).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 5);
        assert!(lines[0].contains(r#"width="12" height="8" viewBox="0 0 12 8""#), "{text}");
        assert!(lines[1].contains("#ff00ff"), "{text}");
        assert!(lines[2].contains(r##"id="g1""##) && lines[2].contains("#ff0080"), "colours are clamped: {text}");
        let places = [(lines[2], "5.500 4.000)"), (lines[3], "3.000 4.000)")];
        assert!(places.iter().all(|(line, place)| line.contains(place)), "{text}");
        assert!(lines[3].contains(r#"fill-opacity="0.500""#) && lines[3].matches("<stop").count() == 11, "{text}");
        assert!(lines[3].contains(r##"offset="0" stop-color="#ff0000" stop-opacity="1.000""##), "{text}");
    }

    #[test]
    fn straight_lines_between_the_stops_are_near_a_gaussian() {
        let weight = |r: f32| (-0.5 * r * r).exp();
        let step = RADIUS / STOPS as f32;
        for i in 0..1000 {
            let r = RADIUS * i as f32 / 1000.0;
            let (before, share) = ((r / step).floor(), (r / step).fract());
            let line = weight(before * step) * (1.0 - share) + weight((before + 1.0) * step) * share;
            assert!((line - weight(r)).abs() < 0.015, "{r}: {line}");
        }
    }

    #[test]
    fn the_widening_of_an_antialiased_scene_is_drawn() {
        let frame = Mat2::from_cols(Vec2::new(0.5, 0.2), Vec2::new(-0.1, 0.3));
        let (wide, share) = shown(frame, Antialias::Dilate);
        let expected = frame * frame.transpose() + Mat2::from_diagonal(Vec2::splat(0.3));
        assert!((wide * wide.transpose()).abs_diff_eq(expected, 1e-6) && share == 1.0);
        let (wide, share) = shown(frame, Antialias::Mip);
        assert!((share - (frame.determinant() / wide.determinant())).abs() < 1e-5 && share < 1.0);
        assert_eq!(shown(frame, Antialias::None), (frame, 1.0));
    }

    #[test]
    fn a_sum_is_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_svg(folder.path().join("a.svg"), &file(Blend::Sum)).unwrap_err().to_string();
        assert!(error.contains("a.svg") && error.contains("negative colours"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
