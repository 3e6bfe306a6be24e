//! What views say about each Gaussian of a scene.
//!
//! A backward pass gives, for all Gaussians at once, sums over the pixels that are weighted as the Gaussian is blended.
//! Two kinds of weights are used: the blending weight T α, the derivative of the pixel by the Gaussian's colour; and
//! ∂C/∂o, the derivative by its opacity o. Under [`Blend::Over`](gs_core::Blend::Over) a pixel C is linear in the opacity of each single
//! Gaussian, so that adding one changes the pixel by exactly o ∂C/∂o.

use glam::Vec3;
use gs_core::{
    Camera, Image, Parameterization, Rasterizer, RenderSettings, Scene as _, Scene3d, constants::SH_C0,
    effects::Background, logit, sigmoid,
};
use gs_density::Rng;
use rand::{RngExt as _, SeedableRng as _};

use crate::{
    error::Error,
    train::{PosedView, plain},
};

/// A Gaussian that is farther than what a view shows by more than this share of its depth is hidden from the view.
const HIDDEN: f32 = 0.05;

/// Number of depths at which the blending weights of a view are summed up; a multiple of three, the channels of a picture.
const DEPTHS: usize = 15;

/// An opacity that hides nothing.
const FAINT: f32 = 1e-3;

/// Random images for each view. The sum over all views has an error of √(2 / (2 · views)) of it.
const PROBES: usize = 2;

/// The sum of each Gaussian's blending weights in the view where it is largest, px, `[N]`.
///
/// # Errors
/// [`Error::NothingSeen`] where all are 0; those of the backend.
pub(super) async fn contribution<R: Rasterizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Vec<f32>, Error> {
    let grey = on.upload(&plain(scene), Parameterization::ScaleRotation)?;
    let render = colorless(render);
    let mut largest = vec![0.0_f32; scene.len()];
    for view in views {
        let ones = Image::filled(view.camera.width, view.camera.height, [1.0; 3])?;
        let pass = on.forward(&grey, &view.camera, &render).await?;
        let gradients = on.image_vjp(&grey, pass, &ones).await?;
        let sums = on.gradients(&grey, &gradients).await?.sh;
        largest.iter_mut().zip(sums).for_each(|(most, sum)| *most = most.max(sum.x / SH_C0));
    }
    if largest.iter().all(|sum| *sum == 0.0) {
        return Err(Error::NothingSeen { gaussians: scene.len(), views: views.len() });
    }
    Ok(largest)
}

/// How far each Gaussian hangs in front of what the views show of another scene, as a share of the depth there, `[N]`:
/// the mean over the views that it is not hidden from; 0 without such views.
pub(super) async fn in_front<R: Rasterizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    shown: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Vec<f32>, Error> {
    let mut sums = vec![(0.0, 0_u32); scene.len()];
    for view in views {
        let camera = &view.camera;
        let depths = median_depths(on, shown, camera, render).await?;
        for (sum, mean) in sums.iter_mut().zip(&scene.means) {
            let Some((at, z)) = camera.project(*mean) else { continue };
            let (x, y) = (at.x.floor(), at.y.floor());
            if !(x >= 0.0 && y >= 0.0 && x < camera.width as f32 && y < camera.height as f32) {
                continue;
            }
            // Of a pixel that shows nothing, this is NaN.
            let front = 1.0 - z / depths[y as usize * camera.width as usize + x as usize];
            if front > -HIDDEN {
                *sum = (sum.0 + front.max(0.0), sum.1 + 1);
            }
        }
    }
    Ok(sums.into_iter().map(|(front, views)| front / views.max(1) as f32).collect())
}

/// The depth, pixel by pixel, in front of which half of the blending weights lie, world units; NaN where the weights add
/// up to less than a half. A mean would be that of no surface where something faint hangs in front of one.
///
/// It is interpolated between [`DEPTHS`] depths, between each two of which as many Gaussians lie.
async fn median_depths<R: Rasterizer<Scene3d>>(
    on: &R,
    shown: &Scene3d,
    camera: &Camera,
    render: &RenderSettings,
) -> Result<Vec<f32>, Error> {
    let z: Vec<f32> = shown.means.iter().map(|mean| camera.to_camera(*mean).z).collect();
    let mut ahead: Vec<f32> = z.iter().copied().filter(|z| *z >= camera.near).collect();
    ahead.sort_by(f32::total_cmp);
    let quantile =
        |k: usize| ahead.get(k * ahead.len().saturating_sub(1) / (DEPTHS - 1)).copied().unwrap_or(camera.near);
    let limits: Vec<f32> = (0..DEPTHS).map(quantile).collect();
    let mut nearer: Vec<Vec<f32>> = Vec::new();
    let mut colored = plain(shown);
    let render = colorless(render);
    for limits in limits.chunks(3) {
        for (sh, z) in colored.sh.iter_mut().zip(&z) {
            let color = [0, 1, 2].map(|k| if limits.get(k).is_some_and(|limit| z <= limit) { 1.0 } else { 0.0 });
            *sh = (Vec3::from(color) - 0.5) / SH_C0;
        }
        let splats = on.upload(&colored, Parameterization::ScaleRotation)?;
        let (image, _) = on.draw(&splats, camera, &render).await?;
        nearer.extend((0..limits.len()).map(|k| image.pixels().iter().map(|pixel| pixel[k]).collect()));
    }
    let depth = |pixel: usize| {
        // All Gaussians are nearer than the last limit.
        let half = 0.5 * nearer[DEPTHS - 1][pixel];
        let k = (0..DEPTHS).find(|&k| nearer[k][pixel] >= half)?;
        let Some(before) = k.checked_sub(1) else { return Some(limits[0]) };
        let share = (half - nearer[before][pixel]) / (nearer[k][pixel] - nearer[before][pixel]);
        Some(limits[before] * (limits[k] / limits[before]).powf(share))
    };
    let pixels = 0..camera.width as usize * camera.height as usize;
    Ok(pixels.map(|pixel| depth(pixel).filter(|_| nearer[DEPTHS - 1][pixel] >= 0.5).unwrap_or(f32::NAN)).collect())
}

/// By how much the squared error over all views is larger with each of the marked Gaussians than without it, `[N]`; 0 for
/// others. Negative where the views need the Gaussian. All others have the opacities of `shown`, which has the same
/// Gaussians.
///
/// With r = C − Y, c = ∂C/∂o, and o′ the opacity in `shown`, it is Σ 2 r c o + c² o (o − 2 o′) over the pixels. Σ r c takes a
/// backward pass. Σ c² is the mean of (Σ ±c)² over random signs.
pub(super) async fn harm<R: Rasterizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    shown: &Scene3d,
    marked: &[bool],
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Vec<f64>, Error> {
    let mut shown = shown.clone();
    // Even transparent Gaussians have a derivative.
    let faint = shown.opacity_logits.iter_mut().zip(marked).filter(|(_, marked)| **marked);
    faint.for_each(|(value, _)| *value = value.max(logit(FAINT)));
    let opacity = |scene: &Scene3d, index: usize| f64::from(sigmoid(scene.opacity_logits[index]));
    let splats = on.upload(&shown, Parameterization::ScaleRotation)?;
    let mut render = *render;
    render.accuracy.alpha_cut = 1e-6;
    render.accuracy.alpha_max = 0.9999;
    let mut rng = Rng::seed_from_u64(0);
    let mut harm = vec![0.0; scene.len()];
    for view in views {
        let posed = view.image()?;
        let mask = posed.mask.clone();
        let counts = |index: usize| mask.as_ref().is_none_or(|mask| mask[index]);
        let target = posed.over(render.background_color())?;
        let (image, _) = on.draw(&splats, &view.camera, &render).await?;
        let mut maps = vec![Image::from_fn(image.width(), image.height(), |x, y| {
            let (c, y) = (image.pixel(x, y), target.pixel(x, y));
            [c[0] - y[0], c[1] - y[1], c[2] - y[2]]
        })?];
        for _ in 0..PROBES {
            let sign = |_, _| [(); 3].map(|()| if rng.random::<bool>() { 1.0 } else { -1.0 });
            maps.push(Image::from_fn(image.width(), image.height(), sign)?);
        }
        for (number, mut map) in maps.into_iter().enumerate() {
            map.pixels_mut()
                .iter_mut()
                .enumerate()
                .filter(|(i, _)| !counts(*i))
                .for_each(|(_, pixel)| *pixel = [0.0; 3]);
            let pass = on.forward(&splats, &view.camera, &render).await?;
            let gradients = on.image_vjp(&splats, pass, &map).await?;
            let gradients = on.gradients(&splats, &gradients).await?.opacity_logits;
            for index in (0..scene.len()).filter(|&index| marked[index]) {
                let (o, o_shown) = (opacity(scene, index), opacity(&shown, index));
                let logit = f64::from(shown.opacity_logits[index]);
                // The derivative of the logit by the opacity is 1 / (o′ (1 − o′)).
                let sum = f64::from(gradients[index]) * (1.0 + logit.exp()) / o_shown;
                harm[index] += match number {
                    0 => 2.0 * sum * o,
                    _ => sum * sum / PROBES as f64 * o * (o - 2.0 * o_shown),
                };
            }
        }
    }
    Ok(harm)
}

/// Settings under which colours are constants, and their gradients are sums of weights.
fn colorless(render: &RenderSettings) -> RenderSettings {
    render.with(|s| (s.effects.sh_degree, s.effects.background) = (0, Background::None))
}
