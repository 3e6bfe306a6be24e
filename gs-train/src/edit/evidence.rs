//! What views say about each Gaussian of a scene.
//!
//! A backward pass gives, for all Gaussians at once, sums over the pixels that are weighted as the Gaussian is blended.
//! Two kinds of weights are used: the blending weight T α, the derivative of the pixel by the Gaussian's colour; and
//! ∂C/∂o, the derivative by its opacity o. Under [`Blend::Over`](gs_core::Blend::Over) a pixel C is linear in the opacity of each single
//! Gaussian, so that adding one changes the pixel by exactly o ∂C/∂o.

use glam::Vec3;
use gs_core::{
    Image, Output, Parameterization, Rasterizer, RenderSettings, Scene as _, Scene3d, effects::Order, logit, sigmoid,
};
use gs_density::Rng;
use rand::{RngExt as _, SeedableRng as _};

use crate::{
    error::Error,
    train::{PosedView, plain},
    views::{FOOTPRINT_ALPHA, blending_weights, color_gradients, colorless},
};

/// A Gaussian that is farther than what a view shows by more than this share of its depth is hidden from the view.
const HIDDEN: f32 = 0.05;

/// An opacity that hides nothing.
const FAINT: f32 = 1e-3;

/// Random images for each view. The estimate of a Gaussian's harm over all views has a relative standard deviation of
/// about 1 / √views.
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
        let sums = blending_weights((on, &grey), &view.camera, &render).await?;
        largest.iter_mut().zip(sums).for_each(|(most, sum)| *most = most.max(sum));
    }
    if largest.iter().all(|sum| *sum == 0.0) {
        return Err(Error::NothingSeen { gaussians: scene.len(), views: views.len() });
    }
    Ok(largest)
}

/// How far each Gaussian hangs in front of what the views show of another scene, as a share of the depth there, `[N]`:
/// the mean over the views that it is not hidden from, weighted by the pixels that it reaches; 0 without such views.
pub(super) async fn in_front<R: Rasterizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    shown: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Vec<f32>, Error> {
    let grey = on.upload(&plain(scene), Parameterization::ScaleRotation)?;
    let shown = on.upload(shown, Parameterization::ScaleRotation)?;
    let covered = render.of_alpha();
    let inverse = covered.with(|s| s.output = Output::InverseDepth);
    // Every pixel that a Gaussian reaches has the same weight, and none hides another.
    let mut footprints = colorless(render);
    footprints.accuracy.alpha_max = FOOTPRINT_ALPHA;
    footprints.effects.order = Order::Index;
    let mut sums = vec![(0.0, 0.0); scene.len()];
    for view in views {
        let (alpha, _) = on.draw(&shown, &view.camera, &covered).await?;
        let (inverse, _) = on.draw(&shown, &view.camera, &inverse).await?;
        let maps = alpha.pixels().iter().zip(inverse.pixels()).map(|(a, i)| [a[0], i[0], 0.0]).collect();
        let maps = Image::from_pixels(alpha.width(), alpha.height(), maps)?;
        let of_view = color_gradients((on, &grey), &view.camera, &footprints, &maps, FOOTPRINT_ALPHA).await?;
        for (index, (sum, Vec3 { x: alpha, y: inverse, .. })) in sums.iter_mut().zip(of_view).enumerate() {
            let front = 1.0 - view.camera.to_camera(scene.means[index]).z * inverse / alpha;
            if front > -HIDDEN {
                *sum = (sum.0 + front.max(0.0) * alpha, sum.1 + alpha);
            }
        }
    }
    Ok(sums.into_iter().map(|(front, weight)| if weight > 0.0 { front / weight } else { 0.0 }).collect())
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
