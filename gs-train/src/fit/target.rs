//! The paper's target and variations of it.

use glam::Vec2;
use gs_core::Image;

/// Side of the paper's target, px.
pub const PAPER_SIDE_PX: u32 = 128;

/// Top-left and bottom-right corner of the paper's square, px.
pub const PAPER_SQUARE: (Vec2, Vec2) = (Vec2::new(72.0, 68.0), Vec2::new(112.0, 108.0));

/// Centre of the paper's disc and the radius at which it covers half of a pixel, px.
pub const PAPER_DISC: (Vec2, f32) = (Vec2::new(44.0, 48.0), 24.0);

/// The paper's target (§3.1), 128×128 px: a red disc with a soft edge, and a blue square with a
/// hard one, on white.
///
/// The disc, (0.9, 0.1, 0.1), is centred at (44, 48) and covers sigmoid((24 − r)/2) of a pixel at
/// distance r; the square, (0.1, 0.2, 0.9), fills 72 < x < 112, 68 < y < 108. Pixel centres lie at
/// j + ½.
pub fn paper_target() -> Image {
    DiscAndSquare::PAPER.image().expect("128x128 px is a possible size")
}

/// The paper's target with other sizes, contrasts and frequencies; the default is the paper's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiscAndSquare {
    /// Side of the image, px; all lengths below are scaled by side / 128.
    pub side_px: u32,
    /// Distance of the shapes' colours from white; 1 is the paper's.
    pub contrast: f32,
    /// Fill of the square.
    pub fill: Fill,
    /// Softness of the square's edge, px of an image of 128 px: half the distance over which it
    /// rises from 27 % to 73 %; 0 is hard.
    pub softness_px: f32,
}

/// Fill of the square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fill {
    /// Blue.
    Plain,
    /// Blue and white stripes down the square: a sine.
    Stripes {
        /// Distance of the stripes, px of an image of 128 px.
        period_px: f32,
    },
}

impl Default for DiscAndSquare {
    fn default() -> Self {
        Self::PAPER
    }
}

impl DiscAndSquare {
    /// The paper's target.
    pub const PAPER: Self = Self { side_px: PAPER_SIDE_PX, contrast: 1.0, fill: Fill::Plain, softness_px: 0.0 };

    /// Draws the image.
    ///
    /// # Errors
    /// [`gs_core::Error::Size`] where the side is not possible.
    pub fn image(&self) -> Result<Image, gs_core::Error> {
        let per_px = PAPER_SIDE_PX as f32 / self.side_px as f32;
        let color = |column: u32, row: u32| {
            let place = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) * per_px;
            let toward = |color: [f32; 3], coverage: f32| {
                let share = self.contrast * coverage;
                color.map(|c| (1.0 - share) + share * c)
            };
            match self.square_coverage(place) {
                square if square > 1e-4 => toward([0.1, 0.2, 0.9], square),
                _ => toward([0.9, 0.1, 0.1], rise(PAPER_DISC.1 - place.distance(PAPER_DISC.0), 2.0)),
            }
        };
        Image::from_fn(self.side_px, self.side_px, color)
    }

    /// Share of the square's colour at a place of the paper's plane.
    fn square_coverage(&self, place: Vec2) -> f32 {
        let inside = (place - PAPER_SQUARE.0).min(PAPER_SQUARE.1 - place);
        let stripes = match self.fill {
            Fill::Plain => 1.0,
            Fill::Stripes { period_px } => 0.5 + 0.5 * (std::f32::consts::TAU * place.x / period_px).cos(),
        };
        match self.softness_px {
            soft if soft > 0.0 => rise(inside.x, soft) * rise(inside.y, soft) * stripes,
            _ if inside.min_element() > 0.0 => stripes,
            _ => 0.0,
        }
    }
}

/// 1 / (1 + exp(−x / width)).
fn rise(x: f32, width: f32) -> f32 {
    1.0 / (1.0 + (-x / width).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disc_square_and_background_are_where_the_paper_has_them() {
        let target = paper_target();
        let near = |x, y, c: [f32; 3]| target.pixel(x, y).iter().zip(c).all(|(a, b)| (a - b).abs() < 2e-3);
        assert!(near(44, 48, [0.9, 0.1, 0.1]));
        assert!(near(127, 0, [1.0; 3]));
        assert_eq!(target.pixel(72, 68), [0.1, 0.2, 0.9]);
        assert_eq!(target.pixel(111, 107), [0.1, 0.2, 0.9]);
        assert!(target.pixel(71, 68)[0] > 0.2 && target.pixel(112, 107)[0] > 0.9);
        // Half covered on the circle itself: r = 24 at (44 + 24, 48), between two pixel centres.
        let edge = (target.pixel(67, 48)[1] + target.pixel(68, 48)[1]) / 2.0;
        assert!((edge - 0.55).abs() < 0.01, "{edge}");
    }

    #[test]
    fn variations_change_what_they_say() {
        let paper = paper_target();
        let image = |varied: DiscAndSquare| varied.image().unwrap();
        let of = DiscAndSquare::default();
        let small = image(DiscAndSquare { side_px: 64, ..of });
        assert_eq!((small.size(), small.pixel(46, 44)), ((64, 64), [0.1, 0.2, 0.9]));
        let pale = image(DiscAndSquare { contrast: 0.25, ..of });
        for (p, q) in pale.pixels().iter().zip(paper.pixels()) {
            assert!(p.iter().zip(q).all(|(p, q)| ((1.0 - p) - 0.25 * (1.0 - q)).abs() < 1e-6));
        }
        let striped = image(DiscAndSquare { fill: Fill::Stripes { period_px: 8.0 }, ..of });
        let changes =
            (73..110).filter(|&x| (striped.pixel(x, 88)[0] - striped.pixel(x + 1, 88)[0]).abs() > 0.2).count();
        assert!(changes > 10, "{changes}");
        let soft = image(DiscAndSquare { softness_px: 4.0, ..of });
        assert!(soft.pixel(70, 88)[0] < 0.9 && soft.pixel(74, 88)[0] > 0.2);
        assert_eq!(soft.pixel(44, 48), paper.pixel(44, 48));
    }
}
