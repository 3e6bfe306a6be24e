//! The Gaussians of a scene drawn as ellipses over its picture (paper Fig. 7): the outline at one standard deviation, and the centre; of a scene in
//! space, of its projection.
//!
//! An outline is drawn from its distance field, not as a polygon: pixel `p` lies about (|z| − 1) / |∇|z|| from the ellipse,
//! where z = L⁻¹ (p − μ) is the whitened offset. Each line is therefore smooth and of even width at any size, and the time
//! grows with the ellipses' area alone.

use glam::{Mat2, Vec2};
use gs_core::{
    Camera, Canvas, Image, PlanarScene, RenderSettings, Scene, SpatialScene,
    perspective::{Ellipsoid, Perspective, Projection},
};

/// Above this many Gaussians lines are thin and centres are left out, or the picture would be all lines.
const DENSE: usize = 2_000;

/// Most Gaussians that are drawn of a scene in space, where they lie behind each other; of more, every n-th of those in sight.
const MOST_IN_SPACE: usize = 2_000;

/// What is fainter than this is not drawn in space.
const FAINT: f32 = 0.1;

/// The canvas to draw on: the fit's own, enlarged by a whole factor where it is so small that lines would hide the picture.
pub(crate) fn canvas_for(canvas: Canvas) -> Canvas {
    const READABLE_PX: u32 = 1024;
    let longest = canvas.width.max(canvas.height).max(1);
    let factor = READABLE_PX.div_ceil(longest).clamp(1, 8);
    canvas.resized(canvas.width * factor, canvas.height * factor)
}

/// Draws every Gaussian of `scene` onto `picture`, a rendering through `canvas`. Gaussians that are not finite are left out.
pub(crate) fn draw(picture: &mut Image, scene: &PlanarScene, canvas: &Canvas) {
    let grid = Mat2::from_diagonal(canvas.scale());
    let outlines = scene.iter().map(|g| (grid * (g.mean - canvas.origin), grid * g.frame()));
    draw_outlines(picture, outlines.collect());
}

/// Draws Gaussians of `scene` that are to be seen onto `picture`, a rendering through `camera` with `render`: all that are not faint and whose
/// mean is in it, or an even choice of [`MOST_IN_SPACE`] of them at most.
pub(crate) fn draw_in_space(picture: &mut Image, scene: &SpatialScene, camera: &Camera, render: &RenderSettings) {
    let perspective = Perspective::new(camera, render);
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let seen = |index: usize| {
        let (log_scale, rotation) = (scene.log_scales[index], scene.rotations[index]);
        let ellipsoid =
            Ellipsoid { mean: scene.means[index], log_scale, rotation, opacity_logit: scene.opacity_logits[index] };
        let Projection { mean, covariance: [a, b, c], opacity, .. } = perspective.project(&ellipsoid).ok()?;
        // Cholesky's factor of the covariance.
        let (width, shear) = (a.sqrt(), b / a.sqrt());
        let frame = Mat2::from_cols(Vec2::new(width, shear), Vec2::new(0.0, (c - shear * shear).sqrt()));
        let inside = mean.cmpge(Vec2::ZERO).all() && mean.cmplt(size).all();
        (inside && opacity > FAINT).then_some((mean, frame))
    };
    let outlines: Vec<(Vec2, Mat2)> = (0..scene.len()).filter_map(seen).collect();
    let every = outlines.len().div_ceil(MOST_IN_SPACE).max(1);
    draw_outlines(picture, outlines.into_iter().step_by(every).collect());
}

/// Draws ellipses of these means and frames L, with L Lᵀ the covariance, in px of the picture.
fn draw_outlines(picture: &mut Image, outlines: Vec<(Vec2, Mat2)>) {
    let pen = if outlines.len() > DENSE {
        Pen { half_width_px: 0.3, dot_radius_px: 0.0, strength: 0.7 }
    } else {
        Pen { half_width_px: 0.6, dot_radius_px: 1.5, strength: 0.9 }
    };
    // Contrast is judged against the picture, not against lines drawn before.
    let inks: Vec<Option<Ellipse>> =
        outlines.into_iter().map(|(mean, frame)| Ellipse::of(mean, frame, picture)).collect();
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
    fn of(mean: Vec2, frame: Mat2, picture: &Image) -> Option<Self> {
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
    use gs_core::{Blend, PlanarGaussian, SpatialGaussian};

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
    fn a_scene_in_space_is_outlined_as_it_is_projected() {
        let mut camera = Camera::looking_forward(40, 40, 1.0);
        camera.center = Vec2::splat(20.5);
        // A disc of 8 px on its axis, and one that is too faint.
        let sigma = 8.0 / camera.focal.x * 5.0;
        let disc = |x, opacity_logit| SpatialGaussian {
            mean: Vec3::new(x, 0.0, 5.0),
            log_scale: Vec3::new(sigma, sigma, 1e-3).map(f32::ln),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit,
            sh: vec![Vec3::ZERO],
        };
        let mut scene = SpatialScene::default();
        [disc(0.0, 3.0), disc(0.3, -6.0)].into_iter().for_each(|gaussian| scene.push(gaussian));
        let mut picture = Image::filled(40, 40, [1.0; 3]).unwrap();
        draw_in_space(&mut picture, &scene, &camera, &RenderSettings::blended(Blend::Over));
        let value = |x, y| picture.pixel(x, y)[0];
        assert!(value(28, 20) < 0.2 && value(20, 12) < 0.2 && value(20, 20) < 0.2);
        assert_eq!([value(24, 20), value(35, 20), value(2, 2)], [1.0; 3]);
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
