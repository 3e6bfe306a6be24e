//! The Gaussians of a planar scene drawn as ellipses over its picture (paper Fig. 7): the outline at one standard
//! deviation, and the centre.
//!
//! An outline is drawn from its distance field, not as a polygon: pixel `p` lies about (|z| − 1) / |∇|z|| from the ellipse,
//! where z = L⁻¹ (p − μ) is the whitened offset. Each line is therefore smooth and of even width at any size, and the time
//! grows with the ellipses' area alone.

use glam::{Mat2, Vec2};
use gs_core::{Canvas, Image, PlanarGaussian, PlanarScene};

/// Above this many Gaussians lines are thin and centres are left out, or the picture would be all lines.
const DENSE: usize = 2_000;

/// The canvas to draw on: the fit's own, enlarged by a whole factor where it is so small that lines would hide the picture.
pub(crate) fn canvas_for(canvas: Canvas) -> Canvas {
    const READABLE_PX: u32 = 1024;
    let longest = canvas.width.max(canvas.height).max(1);
    let factor = READABLE_PX.div_ceil(longest).clamp(1, 8);
    canvas.resized(canvas.width * factor, canvas.height * factor)
}

/// Draws every Gaussian of `scene` onto `picture`, a rendering through `canvas`. Gaussians that are not finite are left out.
pub(crate) fn draw(picture: &mut Image, scene: &PlanarScene, canvas: &Canvas) {
    let pen = if scene.means.len() > DENSE {
        Pen { half_width_px: 0.3, dot_radius_px: 0.0, strength: 0.7 }
    } else {
        Pen { half_width_px: 0.6, dot_radius_px: 1.5, strength: 0.9 }
    };
    let grid = Mat2::from_diagonal(canvas.scale());
    // Contrast is judged against the picture, not against lines drawn before.
    let inks: Vec<Option<Ellipse>> = scene.iter().map(|g| Ellipse::of(&g, canvas, grid, picture)).collect();
    for ellipse in inks.iter().flatten() {
        pen.trace(picture, ellipse);
    }
}

/// One Gaussian in pixels of the picture.
struct Ellipse {
    mean: Vec2,
    /// L⁻¹, px⁻¹.
    whiten: Mat2,
    /// Half the sides of the bounding box, px: √Σxx, √Σyy.
    reach: Vec2,
    /// Black or white, whichever stands out.
    ink: f32,
}

impl Ellipse {
    fn of(gaussian: &PlanarGaussian, canvas: &Canvas, grid: Mat2, picture: &Image) -> Option<Self> {
        let mean = grid * (gaussian.mean - canvas.origin);
        let frame = grid * gaussian.frame();
        let whiten = frame.inverse();
        let rows = frame.transpose();
        let reach = Vec2::new(rows.x_axis.length(), rows.y_axis.length());
        let finite = mean.is_finite() && whiten.is_finite() && reach.is_finite();
        finite.then(|| Self { mean, whiten, reach, ink: contrasting_ink(picture, mean) })
    }
}

/// White on dark, black on bright, judged by the luma (ITU-R BT.709) of the picture at the nearest pixel to `at`.
fn contrasting_ink(picture: &Image, at: Vec2) -> f32 {
    let last = Vec2::new((picture.width() - 1) as f32, (picture.height() - 1) as f32);
    let nearest = at.floor().clamp(Vec2::ZERO, last);
    let [r, g, b] = picture.pixel(nearest.x as u32, nearest.y as u32);
    if 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.5 { 0.0 } else { 1.0 }
}

/// How lines look.
struct Pen {
    half_width_px: f32,
    /// 0 draws no centre.
    dot_radius_px: f32,
    /// How much of the ink covers the picture, 0 to 1.
    strength: f32,
}

impl Pen {
    fn trace(&self, picture: &mut Image, ellipse: &Ellipse) {
        let margin = Vec2::splat(2.0 + self.dot_radius_px);
        let size = Vec2::new(picture.width() as f32, picture.height() as f32);
        let from = (ellipse.mean - ellipse.reach - margin).floor().clamp(Vec2::ZERO, size);
        let to = (ellipse.mean + ellipse.reach + margin).ceil().clamp(Vec2::ZERO, size);
        let width = picture.width() as usize;
        for y in from.y as usize..to.y as usize {
            let row = &mut picture.pixels_mut()[y * width..][..width];
            for x in from.x as usize..to.x as usize {
                let cover = self.strength * self.coverage(ellipse, Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                if cover > 0.0 {
                    row[x] = row[x].map(|v| v + cover * (ellipse.ink - v));
                }
            }
        }
    }

    /// How much of the pixel centred at `p` the pen covers, 0 to 1.
    fn coverage(&self, ellipse: &Ellipse, p: Vec2) -> f32 {
        let offset = p - ellipse.mean;
        let z = ellipse.whiten * offset;
        let radius = z.length();
        // |z| changes by |L⁻ᵀ z| / |z| a pixel; at the centre, where it has no gradient, the outline is far.
        let gradient = (ellipse.whiten.transpose() * z).length() / radius;
        let outline = ((radius - 1.0).abs() / gradient).max(0.0);
        let line = self.half_width_px + 0.5 - outline;
        let dot = if self.dot_radius_px > 0.0 { self.dot_radius_px + 0.5 - offset.length() } else { 0.0 };
        line.max(dot).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn circle(x: f32, y: f32, sigma_px: f32) -> PlanarGaussian {
        PlanarGaussian {
            mean: Vec2::new(x, y),
            log_scale: Vec2::splat(sigma_px.ln()),
            rotation: 0.4,
            opacity_logit: f32::INFINITY,
            color: Vec3::ZERO,
        }
    }

    #[test]
    fn the_outline_lies_at_one_standard_deviation() {
        let canvas = Canvas::new(40, 40);
        let mut picture = Image::filled(40, 40, [1.0; 3]).unwrap();
        draw(&mut picture, &[circle(20.5, 20.5, 8.0)].into_iter().collect(), &canvas);
        let value = |x, y| picture.pixel(x, y)[0];
        assert!(value(28, 20) < 0.2 && value(20, 12) < 0.2, "the outline is dark on white");
        assert!(value(20, 20) < 0.2, "so is the centre");
        assert_eq!([value(24, 20), value(33, 20), value(0, 0)], [1.0; 3], "and nothing else");
    }

    #[test]
    fn ink_stands_out_and_what_is_not_finite_is_left_out() {
        let canvas = Canvas::new(16, 16);
        let mut dark = Image::filled(16, 16, [0.0; 3]).unwrap();
        let scene: PlanarScene =
            [circle(f32::NAN, 3.0, 2.0), circle(3.0, 3.0, 0.0), circle(8.5, 8.5, 4.0), circle(1e9, -1e9, 1e9)]
                .into_iter()
                .collect();
        draw(&mut dark, &scene, &canvas);
        assert!(dark.pixel(12, 8)[0] > 0.8);
        assert!(dark.pixels().iter().flatten().all(|v| (0.0..=1.0).contains(v)));
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
