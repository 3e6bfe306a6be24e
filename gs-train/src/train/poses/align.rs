//! Alignment of a camera to its image, in a scene that stays as it is: direct image alignment with rendered
//! depths.
//!
//! The scene is rendered from the camera, in colours and in inverse depths, which say how each pixel moves
//! with the camera. A few steps of Gauss-Newton then find the motion that takes the rendering to the
//! image. *Source:* Lucas and Kanade 1981; with depths, Kerl et al. 2013, *Robust Odometry Estimation
//! for RGB-D Cameras*.

use glam::{DVec2, DVec3, Vec3};
use gs_core::{Camera, Image, Rasterizer, RenderSettings, Scene3d};
use gs_io::dataset::PosedImage;

use crate::error::Error;
use crate::train::rendered_depths::depths_and_gaps;
use crate::views::{PosedView, possible, reduced, reduced_camera};

/// Largest motion of the image in a step of Gauss-Newton, root mean square, px.
const MOST_PX: f64 = 2.0;

/// Damping of a step of Gauss-Newton, relative to the diagonal of its matrix.
const DAMPING: f64 = 1e-6;

/// Factor of a step that did not bring the rendering closer to the image.
const SHORTER: f64 = 0.3;

/// Least opacity of a rendered pixel whose depth is used.
const LEAST_OPACITY: f32 = 0.5;

/// Least number of pixels to align with.
const LEAST_PIXELS: usize = 50;

/// A half of an image: a camera is aligned to one, and the other judges it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::train) enum Half {
    Left,
    Right,
}

impl Half {
    /// The columns of an image of this width.
    pub(in crate::train) fn columns(self, width: usize) -> std::ops::Range<usize> {
        match self {
            Self::Left => 0..width / 2,
            Self::Right => width / 2..width,
        }
    }
}

/// An image at a reduced size, over the background of renderings.
#[derive(Debug)]
struct Sight {
    factor: u32,
    image: Image,
    mask: Option<Vec<bool>>,
}

/// The divisor of a camera's sides that leaves about this many pixels, a power of two.
pub(in crate::train) fn divisor(camera: &Camera, pixels: u64) -> u32 {
    let all = u64::from(camera.width) * u64::from(camera.height);
    possible(camera, (all / pixels).isqrt().max(1).next_power_of_two() as u32)
}

impl Sight {
    /// The image of a view at 1/`factor` of its size.
    ///
    /// # Errors
    /// [`gs_core::Error`] where the size is not possible.
    fn new(posed: &PosedImage, factor: u32, render: &RenderSettings) -> Result<Self, Error> {
        let posed = if factor > 1 { &reduced(posed, factor)? } else { posed };
        let mask = posed.mask.clone();
        Ok(Self { factor, image: posed.clone().over(render.background_color())?, mask })
    }

    fn counts(&self, index: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask[index])
    }

    /// Renders the scene for a full-size camera at the size of the image.
    async fn draw<R: Rasterizer<Scene3d>>(
        &self,
        (on, splats): (&R, &R::Splats),
        camera: &Camera,
        render: &RenderSettings,
    ) -> Result<Image, Error> {
        Ok(on.draw(splats, &reduced_camera(camera, self.factor), render).await?.0)
    }

    /// The camera after at most `steps` steps of Gauss-Newton towards a half of the image. Steps
    /// that do not bring the rendering closer to the image are undone, and end the alignment.
    async fn aligned<R: Rasterizer<Scene3d>>(
        &self,
        scene: (&R, &R::Splats),
        camera: &Camera,
        render: &RenderSettings,
        (half, steps): (Half, u32),
    ) -> Result<Camera, Error> {
        let depths = self.draw(scene, camera, &depths_and_gaps(render)).await?;
        let mut rendered = self.draw(scene, camera, render).await?;
        let rows = self.rows(half, &reduced_camera(camera, self.factor), (&rendered, &depths));
        if rows.len() < LEAST_PIXELS {
            return Ok(*camera);
        }
        let (mut best, mut least, mut by, mut twist) = (*camera, f64::INFINITY, 1.0, [0.0; 6]);
        let mut scale = None;
        for step in 0..=steps {
            let next = moved(&best, twist.map(|value: f64| by * value));
            if step > 0 {
                rendered = self.draw(scene, &next, render).await?;
            }
            let residual = |row: &Row| difference(rendered.pixels()[row.index], self.image.pixels()[row.index]);
            let residuals: Vec<DVec3> = rows.iter().map(residual).collect();
            let scale = *scale.get_or_insert_with(|| scale_of(&residuals));
            let cost = residuals.iter().map(|r| (r.length_squared() / scale).ln_1p()).sum::<f64>();
            // True for NaN.
            if !(cost < least) {
                by *= SHORTER;
                continue;
            }
            (best, least, by) = (next, cost, 1.0);
            let Some(found) = motion(&rows, &residuals, scale) else { break };
            twist = found;
        }
        Ok(best)
    }

    /// The pixels of a half that say something about the camera, which has the size of the image.
    fn rows(&self, half: Half, camera: &Camera, (rendered, depths): (&Image, &Image)) -> Vec<Row> {
        let (width, height) = (self.image.width() as usize, self.image.height() as usize);
        let pixels = self.image.pixels();
        let (inverse, columns) = (nearby(depths), half.columns(width));
        let mut rows = Vec::new();
        for y in 1..height.saturating_sub(1) {
            for x in columns.start.max(1)..columns.end.min(width.saturating_sub(1)) {
                let index = y * width + x;
                let around = [index - 1, index + 1, index - width, index + width];
                if !(self.counts(index) && around.iter().all(|&next| self.counts(next))) {
                    continue;
                }
                // Means of the gradients of both images.
                let slope = |a: usize, b: usize| {
                    0.25 * (difference(pixels[a], pixels[b]) + difference(rendered.pixels()[a], rendered.pixels()[b]))
                };
                let (by_x, by_y) = (slope(index + 1, index - 1), slope(index + width, index - width));
                let at = (DVec2::new(x as f64, y as f64) + 0.5 - camera.center.as_dvec2()) / camera.focal.as_dvec2();
                let [du, dv] = flow(at, camera.focal.as_dvec2(), f64::from(inverse[index]));
                rows.push(Row { index, by_x, by_y, du, dv });
            }
        }
        rows
    }
}

/// Numbers of pixels with which a view is aligned, one after the other, and steps for each. A repeated number
/// measures slopes and depths again, at the camera that the steps before found.
const FINER: [(u64, u32); 7] =
    [(2_500, NUDGES), (10_000, 4), (10_000, 4), (10_000, 4), (40_000, 3), (40_000, 3), (160_000, 3)];

/// Steps with a small image.
const NUDGES: u32 = 4;

/// The camera of a view, aligned to the left half of its image.
///
/// # Errors
/// Those of the backend, and of reading the image.
pub(crate) async fn to_left_half<R: Rasterizer<Scene3d>>(
    scene: (&R, &R::Splats),
    view: &PosedView,
    render: &RenderSettings,
) -> Result<Camera, Error> {
    let (mut aligned, posed) = (view.camera, view.image()?);
    for (pixels, steps) in FINER {
        let sight = Sight::new(&posed, divisor(&view.camera, pixels), render)?;
        aligned = sight.aligned(scene, &aligned, render, (Half::Left, steps)).await?;
    }
    Ok(aligned)
}

/// The camera of a view with a small image after a few steps towards a half of it.
///
/// # Errors
/// Those of the backend, and of reading the image.
pub(in crate::train) async fn nudged<R: Rasterizer<Scene3d>>(
    scene: (&R, &R::Splats),
    view: &PosedView,
    render: &RenderSettings,
    half: Half,
) -> Result<Camera, Error> {
    Sight::new(&view.image()?, 1, render)?.aligned(scene, &view.camera, render, (half, NUDGES)).await
}

/// A camera moved by a twist (v, ω).
fn moved(camera: &Camera, twist: [f64; 6]) -> Camera {
    let [v, w] = [0, 3].map(|k| Vec3::from_array([0, 1, 2].map(|axis| twist[k + axis] as f32)));
    camera.moved(v, w)
}

/// A pixel: its gradients along the image's axes, and how it moves with the camera's twist.
struct Row {
    index: usize,
    by_x: DVec3,
    by_y: DVec3,
    du: [f64; 6],
    dv: [f64; 6],
}

fn difference(a: [f32; 3], b: [f32; 3]) -> DVec3 {
    (Vec3::from(a) - Vec3::from(b)).as_dvec3()
}

/// ∂(u, v)/∂ the twist (v, ω) of [`Camera::moved`], px, of the point at (X/Z, Y/Z) with inverse depth `q`.
pub(super) fn flow(at: DVec2, focal: DVec2, q: f64) -> [[f64; 6]; 2] {
    let DVec2 { x: a, y: b } = at;
    let du = [q, 0.0, -a * q, -a * b, 1.0 + a * a, -b];
    let dv = [0.0, q, -b * q, -1.0 - b * b, a * b, a];
    [du.map(|value| focal.x * value), dv.map(|value| focal.y * value)]
}

/// Inverse depths of the opaque pixels; of others that of the nearest surface next to them, whose edge moves
/// over them, or else 0. `depths` has inverse depths in its first channel, and these plus the transmittance
/// in its second.
fn nearby(depths: &Image) -> Vec<f32> {
    let (width, height) = (depths.width() as usize, depths.height() as usize);
    let known: Vec<f32> = depths
        .pixels()
        .iter()
        .map(|&[inverse, beside, _]| {
            let opacity = 1.0 - (beside - inverse);
            if opacity >= LEAST_OPACITY { (inverse / opacity).max(0.0) } else { 0.0 }
        })
        .collect();
    let dilated = |index: usize| {
        if known[index] > 0.0 {
            return known[index];
        }
        let (x, y) = (index % width, index / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let around = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
        around.map(|next| known[next]).fold(0.0, f32::max)
    };
    (0..known.len()).map(dilated).collect()
}

/// The squared residual at which a pixel has half the weight.
fn scale_of(residuals: &[DVec3]) -> f64 {
    (OUTLYING * residuals.iter().map(|r| r.length_squared()).sum::<f64>() / residuals.len() as f64).max(LEAST_SCALE)
}

/// Multiple of the mean squared residual at which a pixel has half the weight. The median is no measure of
/// images with a plain background.
const OUTLYING: f64 = 10.0;

/// Least such squared residual: a level of 255.
const LEAST_SCALE: f64 = 1.5e-5;

/// The twist of a step of Gauss-Newton with Cauchy weights; `None` where the pixels do not determine it.
fn motion(rows: &[Row], residuals: &[DVec3], scale: f64) -> Option<[f64; 6]> {
    let (mut matrix, mut right, mut motions) = ([[0.0; 6]; 6], [0.0; 6], [[0.0; 6]; 6]);
    for (row, residual) in rows.iter().zip(residuals) {
        let weight = 1.0 / (1.0 + residual.length_squared() / scale);
        let (xx, xy, yy) = (row.by_x.length_squared(), row.by_x.dot(row.by_y), row.by_y.length_squared());
        let (x, y) = (row.by_x.dot(*residual), row.by_y.dot(*residual));
        for i in 0..6 {
            let (along_x, along_y) = (xx * row.du[i] + xy * row.dv[i], xy * row.du[i] + yy * row.dv[i]);
            right[i] += weight * (x * row.du[i] + y * row.dv[i]);
            for j in 0..=i {
                matrix[i][j] += weight * (along_x * row.du[j] + along_y * row.dv[j]);
                motions[i][j] += row.du[i] * row.du[j] + row.dv[i] * row.dv[j];
            }
        }
    }
    (0..6).for_each(|i| matrix[i][i] *= 1.0 + DAMPING);
    let twist = solve(matrix, right)?;
    let squared: f64 = (0..6)
        .flat_map(|i| (0..=i).map(move |j| (i, j)))
        .map(|(i, j)| if i == j { 1.0 } else { 2.0 } * motions[i][j] * twist[i] * twist[j])
        .sum();
    let pixels = (squared / rows.len() as f64).max(0.0).sqrt();
    let by = if pixels > MOST_PX { MOST_PX / pixels } else { 1.0 };
    Some(twist.map(|value| by * value)).filter(|twist| twist.iter().all(|value| value.is_finite()))
}

/// The factor L of a symmetric matrix L Lᵀ, of which the lower triangle is given, by Cholesky; `None` where
/// it is not positive definite.
pub(super) fn factored<const N: usize>(mut a: [[f64; N]; N]) -> Option<[[f64; N]; N]> {
    for i in 0..N {
        for j in 0..=i {
            let rest = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
            a[i][j] = match i == j {
                true if rest > 0.0 && rest.is_finite() => rest.sqrt(),
                true => return None,
                false => rest / a[j][j],
            };
        }
    }
    Some(a)
}

/// x of the system A x = b with the lower triangle of a symmetric A; `None` where A is not positive definite.
pub(super) fn solve<const N: usize>(a: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    let a = factored(a)?;
    for i in 0..N {
        b[i] = (b[i] - (0..i).map(|k| a[i][k] * b[k]).sum::<f64>()) / a[i][i];
    }
    for i in (0..N).rev() {
        b[i] = (b[i] - (i + 1..N).map(|k| a[k][i] * b[k]).sum::<f64>()) / a[i][i];
    }
    Some(b)
}
