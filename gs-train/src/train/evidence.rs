//! Evidence over several training views, for the policies that request it.
//!
//! The derivative of a pixel with respect to the colour of a Gaussian is the Gaussian's weight in
//! that pixel. The weighted sums of three maps over the pixels are therefore the gradient with
//! respect to the colours if the channels of ∂L/∂image are the three maps. The gradient is computed
//! on a copy of the scene with view-independent colours that are not clamped.
//!
//! For footprints, α is limited to [`FOOTPRINT_ALPHA`]. Every covered pixel then has this α, and no
//! Gaussian hides another.

use glam::Vec3;
use gs_core::{
    Blend, Camera, Image, Optimizer, Parameterization, RenderSettings, Scene, Scene3d,
    constants::SH_C0,
    effects::{Background, Order, Statistics},
    math::perspective::{Ellipsoid, Perspective},
};
use gs_density::{DensityGaussian, Evidence, EvidenceRequest, PixelSums, Rng, ViewEvidence};
use gs_io::dataset::PosedImage;
use rand::{SeedableRng, seq::index};

use super::images;
use crate::error::Error;

/// Stream of random numbers for the views, independent of all others.
const EVIDENCE_STREAM: u64 = 0x6576_6964;

/// α in every pixel of a footprint. A thousand Gaussians in front hide a thousandth of a pixel.
const FOOTPRINT_ALPHA: f32 = 1e-6;

/// Indices of the views, of `count`, for the evidence of the round after `step` steps, ascending.
pub(super) fn views_of_round(seed: u32, step: u32, count: usize, request: &EvidenceRequest) -> Vec<usize> {
    let wanted = if request.views == 0 { count } else { count.min(request.views as usize) };
    let state = (u64::from(seed) << 32 | u64::from(step)) ^ EVIDENCE_STREAM.rotate_left(16);
    let mut views = index::sample(&mut Rng::seed_from_u64(state), count, wanted).into_vec();
    views.sort_unstable();
    views
}

/// Gathers the evidence of a round, view by view.
pub(super) struct Gathering<'a, R: Optimizer<Scene3d>> {
    on: &'a R,
    scene: &'a Scene3d,
    splats: &'a R::Splats,
    /// The scene with view-independent colours.
    plain: R::Splats,
    render: RenderSettings,
    request: EvidenceRequest,
    evidence: Evidence,
}

impl<'a, R: Optimizer<Scene3d>> Gathering<'a, R> {
    /// `scene` is that of `splats`; `render` draws it.
    pub(super) fn new(
        on: &'a R,
        (scene, splats): (&'a Scene3d, &'a R::Splats),
        render: RenderSettings,
        request: EvidenceRequest,
    ) -> Result<Self, Error> {
        let plain = on.upload(&plain(scene), Parameterization::ScaleRotation)?;
        Ok(Self { on, scene, splats, plain, render, request, evidence: Evidence::default() })
    }

    /// Adds a view: its camera and its image, both at the resolution of the step.
    pub(super) async fn add(&mut self, camera: &Camera, posed: PosedImage, loss: &gs_core::Loss) -> Result<(), Error> {
        let background = self.render.background_color();
        let pass = self.on.forward(self.splats, camera, &self.render).await?;
        let rendered = self.on.image(&pass).await?;
        let (target, _) = images::target(self.on, posed.clone(), Some(background), true)?;
        let (loss, _) = self.on.backward(self.splats, pass, &target, loss).await?;
        let mask = posed.mask.clone();
        let maps = maps(&rendered, &posed.over(background), mask.as_deref(), &self.request)?;
        let mut view = ViewEvidence { loss, ..ViewEvidence::default() };
        if self.request.blended {
            view.blended = self.sums(camera, self.render, &maps, 1.0).await?;
        }
        if self.request.covered {
            let mut footprints = self.render;
            footprints.accuracy.alpha_max = FOOTPRINT_ALPHA;
            footprints.effects.blend = Blend::Over;
            footprints.effects.order = Order::Index;
            view.covered = self.sums(camera, footprints, &maps, FOOTPRINT_ALPHA).await?;
        }
        if self.request.geometry {
            (view.depth, view.radius_px) = geometry(self.scene, camera, &self.render);
        }
        self.evidence.views.push(view);
        Ok(())
    }

    /// The evidence of all views.
    pub(super) fn finish(self) -> Evidence {
        self.evidence
    }

    /// Sums of the three maps over the pixels, in units of `weight`.
    async fn sums(
        &self,
        camera: &Camera,
        mut render: RenderSettings,
        maps: &Image,
        weight: f32,
    ) -> Result<PixelSums, Error> {
        render.effects.sh_degree = 0;
        render.effects.background = Background::None;
        render.effects.statistics = Statistics::None;
        let pass = self.on.forward(&self.plain, camera, &render).await?;
        let gradients = self.on.image_vjp(&self.plain, pass, maps).await?;
        let by_color = self.on.gradients(&self.plain, &gradients).await?.sh;
        let channel = |k: usize| by_color.iter().map(|sh| sh[k] / (SH_C0 * weight)).collect();
        Ok(PixelSums { pixels: channel(0), error: channel(1), high_error: channel(2) })
    }
}

/// The scene in grey. Gaussians that are not finite become invisible, as a backend refuses them.
fn plain(scene: &Scene3d) -> Scene3d {
    let mut plain = Scene3d { sh_degree: 0, sh: vec![Vec3::ZERO; scene.len()], ..scene.clone() };
    for index in (0..scene.len()).filter(|&index| !scene.gaussian(index).is_finite()) {
        plain.means[index] = Vec3::ZERO;
        plain.log_scales[index] = Vec3::ZERO;
        plain.rotations[index] = [1.0, 0.0, 0.0, 0.0];
        plain.opacity_logits[index] = f32::NEG_INFINITY;
    }
    plain
}

/// The maps of [`PixelSums`]: 1, e, and whether the error is high; 0 where the mask leaves a pixel
/// out.
fn maps(
    rendered: &Image,
    target: &Image,
    mask: Option<&[bool]>,
    request: &EvidenceRequest,
) -> Result<Image, gs_core::Error> {
    let (width, height) = rendered.size();
    let counts = |at: usize| mask.is_none_or(|mask| mask[at]);
    let error = |at: usize| {
        let (c, y) = (rendered.pixels()[at], target.pixels()[at]);
        (0..3).map(|k| (c[k] - y[k]).abs()).sum::<f32>() / 3.0
    };
    let errors = scaled((0..target.pixels().len()).map(error).collect(), counts);
    let edges = if request.edges > 0.0 { scaled(edges(target), counts) } else { vec![0.0; errors.len()] };
    Image::from_fn(width, height, |x, y| {
        let at = (y * width + x) as usize;
        if !counts(at) {
            return [0.0; 3];
        }
        let high = if errors[at] > request.high_error { 1.0 } else { 0.0 };
        [1.0, request.l1 * errors[at] + request.edges * edges[at], high]
    })
}

/// The values, scaled to 0..=1 between the smallest and the largest that count; 0 if all are equal,
/// and for values that are not finite.
fn scaled(mut values: Vec<f32>, counts: impl Fn(usize) -> bool) -> Vec<f32> {
    let (least, most) = (values.iter().enumerate().filter(|&(at, v)| counts(at) && v.is_finite()))
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(least, most), (_, &v)| (least.min(v), most.max(v)));
    let range = most - least;
    for value in &mut values {
        let share = (*value - least) / range;
        *value = if share.is_finite() { share } else { 0.0 };
    }
    values
}

/// The response of the edge filter of [`EvidenceRequest`]; 0 at the border.
fn edges(target: &Image) -> Vec<f32> {
    let (width, height) = (target.width() as usize, target.height() as usize);
    let grey: Vec<f32> = target.pixels().iter().map(|&[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect();
    let mut edges = vec![0.0; grey.len()];
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let around = (y - 1..=y + 1).flat_map(|row| &grey[row * width + x - 1..=row * width + x + 1]);
            edges[y * width + x] = (9.0 * grey[y * width + x] - around.sum::<f32>()).clamp(0.0, 1.0);
        }
    }
    edges
}

/// [`ViewEvidence::depth`] and [`ViewEvidence::radius_px`].
fn geometry(scene: &Scene3d, camera: &Camera, render: &RenderSettings) -> (Vec<f32>, Vec<f32>) {
    let perspective = Perspective::new(camera, render);
    let size = glam::Vec2::new(camera.width as f32, camera.height as f32);
    (0..scene.len())
        .map(|index| {
            let ellipsoid = Ellipsoid {
                mean: scene.means[index],
                log_scale: scene.log_scales[index],
                rotation: scene.rotations[index],
                opacity_logit: scene.opacity_logits[index],
            };
            let Ok(seen) = perspective.project(&ellipsoid) else { return (0.0, 0.0) };
            let [xx, xy, yy] = seen.covariance;
            let middle = 0.5 * (xx + yy);
            let radius = 3.0 * (middle + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt()).sqrt();
            let inside = (seen.mean + radius).cmpge(glam::Vec2::ZERO).all() && (seen.mean - radius).cmple(size).all();
            if inside { (seen.depth, radius) } else { (0.0, 0.0) }
        })
        .unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_drawn_anew_in_each_round_and_repeat_with_the_seed() {
        let request = EvidenceRequest::default().with(|s| s.views = 4);
        let of = |seed, step| views_of_round(seed, step, 30, &request);
        assert_eq!((of(1, 100).len(), of(1, 100)), (4, of(1, 100)));
        assert!(of(1, 100).windows(2).all(|pair| pair[0] < pair[1]));
        assert!(of(1, 100) != of(1, 200) && of(1, 100) != of(2, 100));
        let all = request.with(|s| s.views = 0);
        assert_eq!(views_of_round(1, 100, 3, &all), [0, 1, 2]);
        assert_eq!(views_of_round(1, 100, 3, &request), [0, 1, 2]);
    }

    #[test]
    fn maps_are_scaled_within_the_pixels_that_count() {
        let request = EvidenceRequest::default().with(|s| s.high_error = 0.4);
        let rendered = Image::filled(4, 1, [0.5; 3]).unwrap();
        let target = Image::from_fn(4, 1, |x, _| [[0.5; 3], [0.6, 0.5, 0.5], [0.8, 0.5, 0.5], [9.0; 3]][x as usize]);
        let mask = [true, true, true, false];
        let found = maps(&rendered, &target.unwrap(), Some(&mask), &request).unwrap();
        let expected = [[1.0, 0.0, 0.0], [1.0, 1.0 / 3.0, 0.0], [1.0, 1.0, 1.0], [0.0; 3]];
        for (found, expected) in found.pixels().as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-6, "{found} instead of {expected}");
        }
        let exact = maps(&rendered, &rendered, None, &request).unwrap();
        assert!(exact.pixels().iter().all(|&pixel| pixel == [1.0, 0.0, 0.0]));
    }

    #[test]
    fn edges_are_where_the_grey_value_is_above_that_of_its_neighbours() {
        let step = Image::from_fn(5, 3, |x, _| if x < 2 { [0.0; 3] } else { [0.1; 3] }).unwrap();
        let found = edges(&step);
        let expected = [0.0, 0.0, 0.3, 0.0, 0.0];
        assert!(
            found[5..10].iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6),
            "{found:?}"
        );
        assert!(found[..5].iter().chain(&found[10..]).all(|&v| v == 0.0));
    }
}
