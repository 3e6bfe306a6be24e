//! Draws the Gaussians of a scene as ellipses over its picture (paper Fig. 7): the outline at one
//! standard deviation and the centre.
//!
//! An outline is drawn from its distance field, not as a polygon: pixel `p` lies about (|z| − 1) /
//! |∇|z|| from the ellipse, where z = L⁻¹ (p − μ) is the whitened offset. Each line is therefore
//! smooth and of even width at any size, and the time grows with the ellipses' area alone. All
//! lines have one colour and a dark seam, so that they are seen on any picture and no change of
//! their colour is taken for an edge.

use std::collections::HashSet;

use glam::{Mat2, Vec2};
use gs_core::{Canvas, Image, Scene2d, sigmoid};

/// Pixels per Gaussian of a picture below which only a part of the Gaussians is drawn.
const PIXELS_EACH: usize = 1_000;

/// Side of the squares, px, in each of which only the most important Gaussian is then drawn.
const SQUARE_PX: f32 = 28.0;

/// The number of ellipses above which lines are thin and centres are left out.
const DENSE: usize = 500;

/// Colour of lines and centres: rare in images, and brighter than the seam.
const INK: [f32; 3] = [1.0, 0.86, 0.1];

/// Colour of the seam around lines.
const SEAM: [f32; 3] = [0.0; 3];

/// The canvas to draw on: the fit's own, enlarged by a whole factor if it is so small that lines
/// would hide the picture.
pub fn canvas_for(canvas: Canvas) -> Canvas {
    const READABLE_PX: u32 = 1024;
    let longest = canvas.width.max(canvas.height).max(1);
    let factor = READABLE_PX.div_ceil(longest).clamp(1, 8);
    canvas.resized(canvas.width * factor, canvas.height * factor)
}

/// Draws the most important Gaussians of `scene` onto `picture`, a rendering through `canvas`.
/// Importance is area × opacity, or area × colour for `Blend::Sum`.
pub fn draw(picture: &mut Image, scene: &Scene2d, canvas: &Canvas) {
    let grid = Mat2::from_diagonal(canvas.scale());
    let outline = |g: gs_core::Gaussian2d| {
        let factor = grid * g.factor();
        // Gaussians that are summed have no opacity.
        let strength = if g.opacity_logit == f32::INFINITY { g.color.length() } else { sigmoid(g.opacity_logit) };
        Outline { mean: grid * (g.mean - canvas.origin), factor, matters: factor.determinant().abs() * strength }
    };
    draw_outlines(picture, scene.iter().map(outline).collect());
}

/// A Gaussian in px of the picture.
struct Outline {
    mean: Vec2,
    /// A matrix L with L Lᵀ = Σ.
    factor: Mat2,
    /// How much the Gaussian adds to the picture, relative to others.
    matters: f32,
}

/// Draws the ellipses whose centre is in the picture. Of too many, the most important in each
/// square are drawn.
fn draw_outlines(picture: &mut Image, mut outlines: Vec<Outline>) {
    let size = Vec2::new(picture.width() as f32, picture.height() as f32);
    let is_there = |mean: Vec2| mean.cmpge(Vec2::ZERO).all() && mean.cmplt(size).all();
    outlines.retain(|outline| outline.matters.is_finite() && is_there(outline.mean));
    outlines.sort_by(|a, b| b.matters.total_cmp(&a.matters));
    if outlines.len() > picture.pixels().len().div_ceil(PIXELS_EACH) {
        let mut taken = HashSet::new();
        outlines.retain(|outline| taken.insert((outline.mean / SQUARE_PX).as_ivec2()));
    }
    let pen = if outlines.len() > DENSE {
        Pen { half_width_px: 0.4, dot_radius_px: 0.0 }
    } else {
        Pen { half_width_px: 0.7, dot_radius_px: 1.5 }
    };
    // Where lines cross, the pixel is as dark or bright as under one line.
    let mut cover = vec![Cover::default(); picture.pixels().len()];
    for ellipse in outlines.iter().filter_map(Ellipse::of) {
        pen.trace(&mut cover, picture.size(), &ellipse);
    }
    for (pixel, Cover { ink, seam }) in picture.pixels_mut().iter_mut().zip(cover) {
        let over = |v: f32, color: f32, part: f32| v + part * (color - v);
        for (channel, v) in pixel.iter_mut().enumerate() {
            *v = over(over(*v, SEAM[channel], 0.55 * seam), INK[channel], ink);
        }
    }
}

/// Coverage of a pixel by lines and by their seams, 0 to 1.
#[derive(Clone, Copy, Default)]
struct Cover {
    ink: f32,
    seam: f32,
}

/// A Gaussian in pixels of the picture.
struct Ellipse {
    mean: Vec2,
    /// L⁻¹, px⁻¹.
    whiten: Mat2,
    /// Half the sides of the bounding box, px: √Σxx, √Σyy.
    reach: Vec2,
}

impl Ellipse {
    fn of(&Outline { mean, factor, .. }: &Outline) -> Option<Self> {
        let whiten = factor.inverse();
        let rows = factor.transpose();
        let reach = Vec2::new(rows.x_axis.length(), rows.y_axis.length());
        let finite = mean.is_finite() && whiten.is_finite() && reach.is_finite();
        finite.then_some(Self { mean, whiten, reach })
    }
}

/// The look of lines.
struct Pen {
    half_width_px: f32,
    /// Radius of the centre's dot; 0 for none.
    dot_radius_px: f32,
}

impl Pen {
    /// Width of the seam beyond the line, px.
    const SEAM_PX: f32 = 0.9;

    fn trace(&self, cover: &mut [Cover], (width, height): (u32, u32), ellipse: &Ellipse) {
        let margin = Vec2::splat(3.0 + self.dot_radius_px);
        let size = Vec2::new(width as f32, height as f32);
        let from = (ellipse.mean - ellipse.reach - margin).floor().clamp(Vec2::ZERO, size);
        let to = (ellipse.mean + ellipse.reach + margin).ceil().clamp(Vec2::ZERO, size);
        for y in from.y as usize..to.y as usize {
            let row = &mut cover[y * width as usize..][..width as usize];
            for x in from.x as usize..to.x as usize {
                let inside = self.inside(ellipse, Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                let Cover { ink, seam } = &mut row[x];
                *ink = ink.max(inside.clamp(0.0, 1.0));
                *seam = seam.max((inside + Self::SEAM_PX).clamp(0.0, 1.0));
            }
        }
    }

    /// Depth of the pixel centre `p` inside the line or the dot, px. From 0 to 1, it is the pixel's
    /// coverage.
    fn inside(&self, ellipse: &Ellipse, p: Vec2) -> f32 {
        let offset = p - ellipse.mean;
        let z = ellipse.whiten * offset;
        let radius = z.length();
        // |z| changes by |L⁻ᵀ z| / |z| a pixel; at the centre, where it has no gradient, the outline
        // is far.
        let gradient = (ellipse.whiten.transpose() * z).length() / radius;
        let outline = ((radius - 1.0).abs() / gradient).max(0.0);
        let line = self.half_width_px + 0.5 - outline;
        let dot = if self.dot_radius_px > 0.0 { self.dot_radius_px + 0.5 - offset.length() } else { f32::NEG_INFINITY };
        line.max(dot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use gs_core::{Gaussian2d, Scene as _};

    fn is_ink(picture: &Image, x: u32, y: u32) -> bool {
        picture.pixel(x, y).iter().zip(INK).all(|(v, ink)| (v - ink).abs() < 0.2)
    }

    fn circle(x: f32, y: f32, sigma_px: f32) -> Gaussian2d {
        Gaussian2d {
            mean: Vec2::new(x, y),
            log_scale: Vec2::splat(sigma_px.ln()),
            rotation: 0.4,
            opacity_logit: f32::INFINITY,
            color: Vec3::ONE,
        }
    }

    #[test]
    fn the_outline_lies_at_one_standard_deviation() {
        let canvas = Canvas::new(40, 40);
        let mut picture = Image::filled(40, 40, [1.0; 3]).unwrap();
        draw(&mut picture, &[circle(20.5, 20.5, 8.0)].into_iter().collect(), &canvas);
        assert!(is_ink(&picture, 28, 20) && is_ink(&picture, 20, 12), "the outline");
        assert!(is_ink(&picture, 20, 20), "the centre");
        assert!(picture.pixel(29, 20)[2] < 0.6, "the seam around the line");
        let value = |x, y| picture.pixel(x, y);
        assert_eq!([value(24, 20), value(33, 20), value(0, 0)], [[1.0; 3]; 3], "and nothing else");
    }

    #[test]
    fn ink_is_of_one_colour_and_what_is_not_finite_is_left_out() {
        let canvas = Canvas::new(16, 16);
        let scene: Scene2d =
            [circle(f32::NAN, 3.0, 2.0), circle(3.0, 3.0, 0.0), circle(8.5, 8.5, 4.0), circle(1e9, -1e9, 1e9)]
                .into_iter()
                .collect();
        for ground in [0.0, 0.5, 1.0] {
            let mut picture = Image::filled(16, 16, [ground; 3]).unwrap();
            draw(&mut picture, &scene, &canvas);
            assert!(is_ink(&picture, 12, 8), "{ground}");
            assert!(picture.pixels().iter().flatten().all(|v| (0.0..=1.0).contains(v)));
        }
    }

    #[test]
    fn the_most_visible_of_many_gaussians_are_drawn() {
        let mut picture = Image::filled(64, 64, [1.0; 3]).unwrap();
        let faint = |x, y, sigma| Gaussian2d { opacity_logit: -9.0, ..circle(x, y, sigma) };
        let mut scene: Scene2d = (0..4000).map(|i| circle((i % 64) as f32, (i / 64) as f32, 0.3)).collect();
        [faint(32.5, 32.5, 30.0), circle(32.5, 32.5, 12.0)].into_iter().for_each(|gaussian| scene.push(gaussian));
        draw(&mut picture, &scene, &Canvas::new(64, 64));
        assert!(is_ink(&picture, 44, 32) && !is_ink(&picture, 62, 32), "the large one, and not what is hardly there");
        let drawn = picture.pixels().iter().filter(|pixel| **pixel != [1.0; 3]).count();
        assert!(drawn < 900, "a picture of this size has nine squares: {drawn}");
    }

    #[test]
    fn small_pictures_are_enlarged_and_large_ones_are_not() {
        let drawn = |width, height| {
            let canvas = canvas_for(Canvas::new(width, height));
            (canvas.width, canvas.height)
        };
        assert_eq!(drawn(1, 1), (8, 8));
        assert_eq!(drawn(128, 128), (1024, 1024));
        assert_eq!(drawn(768, 512), (1536, 1024));
        assert_eq!(drawn(4096, 2160), (4096, 2160));
    }
}
