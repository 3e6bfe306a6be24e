//! Evidence over several training views, for the policies that request it.
//!
//! The derivative of a pixel with respect to the colour of a Gaussian is the Gaussian's weight in
//! that pixel. The weighted sums of three maps over the pixels are therefore the gradient with
//! respect to the colours if the channels of ∂L/∂image are the three maps. The gradient is computed
//! on a copy of the scene with view-independent colours that are not clamped.
//!
//! For footprints, α is limited to [`FOOTPRINT_ALPHA`]. Every covered pixel then has this α, and no
//! Gaussian hides another.

mod maps;

use glam::Vec3;
use gs_core::{
    Blend, Camera, Image, Optimizer, Parameterization, RenderSettings, Scene, Scene3d,
    effects::{Order, Statistics},
    math::perspective::{Ellipsoid, Perspective},
};
use gs_density::{DensityGaussian, Evidence, EvidenceRequest, PixelSums, Rng, ViewEvidence};
use gs_io::dataset::PosedImage;
use rand::{SeedableRng, seq::index};

use self::maps::maps;
use crate::error::Error;
use crate::views::{FOOTPRINT_ALPHA, color_gradients, colorless, images};

/// Stream of random numbers for the views, independent of all others.
const EVIDENCE_STREAM: u64 = 0x6576_6964;

/// The views, of `count`, for the evidence of the round after `step` steps, by index.
pub(super) fn views_of_round(seed: u32, step: u32, count: usize, request: &EvidenceRequest) -> Vec<usize> {
    let wanted = if request.views == 0 { count } else { count.min(request.views as usize) };
    let state = (u64::from(seed) << 32 | u64::from(step)) ^ EVIDENCE_STREAM.rotate_left(16);
    let mut drawn = index::sample(&mut Rng::seed_from_u64(state), count, wanted).into_vec();
    drawn.sort_unstable();
    drawn
}

/// Gathers the evidence of a round, view by view.
pub(super) struct Gathering<'a, R: Optimizer<Scene3d>> {
    on: &'a R,
    scene: &'a Scene3d,
    splats: &'a R::Splats,
    /// The scene with view-independent colours.
    plain: R::Splats,
    /// The scene for splitting matrices.
    uneven: Option<Uneven<R::Splats>>,
    render: RenderSettings,
    request: EvidenceRequest,
    evidence: Evidence,
}

/// A scene without Gaussians of equal scales, whose gradients give their splitting matrices.
struct Uneven<Splats> {
    scene: Scene3d,
    splats: Splats,
    /// Number of views that show each Gaussian.
    shown: Vec<u32>,
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
        let mut evidence = Evidence::default();
        let uneven = match request.splitting {
            true => {
                evidence.splitting = vec![[0.0; 6]; scene.len()];
                let scene = uneven(scene);
                let splats = on.upload(&scene, Parameterization::ScaleRotation)?;
                Some(Uneven { shown: vec![0; scene.len()], scene, splats })
            }
            false => None,
        };
        Ok(Self { on, scene, splats, plain, uneven, render, request, evidence })
    }

    /// Adds a view: its camera and its image, both at the resolution of the step.
    pub(super) async fn add(&mut self, camera: &Camera, posed: PosedImage, loss: &gs_core::Loss) -> Result<(), Error> {
        let mask = posed.mask.clone();
        let mask = mask.as_deref();
        if self.request.splitting {
            self.add_splitting(camera, posed.clone(), loss).await?;
        }
        if self.request.needs_views() {
            let background = self.render.background_color();
            let pass = self.on.forward(self.splats, camera, &self.render).await?;
            let rendered = self.on.image(&pass).await?;
            let (target, _) = images::target(self.on, posed.clone(), background, true)?;
            let loss = self.on.loss(self.splats, pass, &target, loss).await?;
            let maps = maps(&rendered, &posed.over(background)?, mask, &self.request)?;
            let mut view = ViewEvidence { loss, ..ViewEvidence::default() };
            if self.request.blended {
                view.blended = self.sums(camera, &self.render, &maps, 1.0).await?;
            }
            if self.request.covered {
                let mut footprints = self.render;
                footprints.accuracy.alpha_max = FOOTPRINT_ALPHA;
                footprints.effects.blend = Blend::Over;
                footprints.effects.order = Order::Index;
                view.covered = self.sums(camera, &footprints, &maps, FOOTPRINT_ALPHA).await?;
            }
            if self.request.geometry {
                (view.depth, view.radius_px) = geometry(self.scene, camera, &self.render);
            }
            self.evidence.views.push(view);
        }
        Ok(())
    }

    /// Adds a view to the splitting matrices.
    async fn add_splitting(&mut self, camera: &Camera, posed: PosedImage, loss: &gs_core::Loss) -> Result<(), Error> {
        let Some(Uneven { scene, splats, shown }) = &mut self.uneven else { return Ok(()) };
        let render = self.render.with(|s| s.effects.statistics = Statistics::None);
        let pass = self.on.forward(splats, camera, &render).await?;
        let (target, _) = images::target(self.on, posed, render.background_color(), true)?;
        let (_, gradients) = self.on.backward(splats, pass, &target, loss).await?;
        let gradients = self.on.gradients(splats, &gradients).await?;
        let perspective = Perspective::new(camera, &render);
        for (index, (sums, shown)) in self.evidence.splitting.iter_mut().zip(shown).enumerate() {
            let g = ellipsoid(scene, index);
            // Gaussians that are not drawn have no gradient.
            if gradients.opacity_logits[index] == 0.0 || perspective.project(&g).is_err() {
                continue;
            }
            if let Some(found) = perspective.splitting_matrix(&g, &ellipsoid(&gradients, index)) {
                sums.iter_mut().zip(found).for_each(|(sum, value)| *sum += value);
                *shown += 1;
            }
        }
        Ok(())
    }

    /// The evidence of all views.
    pub(super) fn finish(mut self) -> Evidence {
        if let Some(Uneven { shown, .. }) = self.uneven {
            for (matrix, shown) in self.evidence.splitting.iter_mut().zip(shown) {
                *matrix = matrix.map(|sum| sum / shown.max(1) as f32);
            }
        }
        self.evidence
    }

    /// Sums of the three maps over the pixels, in units of the weight `unit`.
    async fn sums(
        &self,
        camera: &Camera,
        render: &RenderSettings,
        maps: &Image,
        unit: f32,
    ) -> Result<PixelSums, Error> {
        let sums = color_gradients((self.on, &self.plain), camera, &colorless(render), maps, unit).await?;
        let channel = |k: usize| sums.iter().map(|sum| sum[k]).collect();
        Ok(PixelSums { pixels: channel(0), error: channel(1), high_error: channel(2) })
    }
}

/// The scene in grey.
pub(crate) fn plain(scene: &Scene3d) -> Scene3d {
    let Scene3d { means, log_scales, rotations, opacity_logits, .. } = scene;
    invisible_where_broken(Scene3d {
        means: means.clone(),
        log_scales: log_scales.clone(),
        rotations: rotations.clone(),
        opacity_logits: opacity_logits.clone(),
        sh_degree: 0,
        sh: vec![Vec3::ZERO; scene.len()],
    })
}

/// The scene with scales that differ.
fn uneven(scene: &Scene3d) -> Scene3d {
    let mut uneven = invisible_where_broken(scene.clone());
    for index in 0..uneven.len() {
        uneven.log_scales[index] = ellipsoid(&uneven, index).without_equal_scales().log_scale;
    }
    uneven
}

/// The scene with invisible Gaussians in place of those that are not finite, which a backend
/// refuses.
fn invisible_where_broken(mut scene: Scene3d) -> Scene3d {
    let coefficients = scene.sh.len() / scene.len().max(1);
    let broken: Vec<usize> = (0..scene.len()).filter(|&index| !scene.gaussian(index).is_finite()).collect();
    for index in broken {
        scene.means[index] = Vec3::ZERO;
        scene.log_scales[index] = Vec3::ZERO;
        scene.rotations[index] = [1.0, 0.0, 0.0, 0.0];
        scene.opacity_logits[index] = f32::NEG_INFINITY;
        scene.sh[index * coefficients..][..coefficients].fill(Vec3::ZERO);
    }
    scene
}

/// The parameters of a Gaussian without its colour.
pub(super) fn ellipsoid(scene: &Scene3d, index: usize) -> Ellipsoid {
    Ellipsoid {
        mean: scene.means[index],
        log_scale: scene.log_scales[index],
        rotation: scene.rotations[index],
        opacity_logit: scene.opacity_logits[index],
    }
}

/// [`ViewEvidence::depth`] and [`ViewEvidence::radius_px`].
fn geometry(scene: &Scene3d, camera: &Camera, render: &RenderSettings) -> (Vec<f32>, Vec<f32>) {
    let perspective = Perspective::new(camera, render);
    let size = glam::Vec2::new(camera.width as f32, camera.height as f32);
    (0..scene.len())
        .map(|index| {
            let Ok(seen) = perspective.project(&ellipsoid(scene, index)) else { return (0.0, 0.0) };
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
        let request = EvidenceRequest::default().with(|s| (s.views, s.covered) = (4, true));
        let indices =
            |seed, step, count, request: &EvidenceRequest| -> Vec<usize> { views_of_round(seed, step, count, request) };
        let of = |seed, step| indices(seed, step, 30, &request);
        assert_eq!((of(1, 100).len(), of(1, 100)), (4, of(1, 100)));
        assert!(of(1, 100).windows(2).all(|pair| pair[0] < pair[1]));
        assert!(of(1, 100) != of(1, 200) && of(1, 100) != of(2, 100));
        let all = request.with(|s| s.views = 0);
        assert_eq!([indices(1, 100, 3, &all), indices(1, 100, 3, &request)], [[0, 1, 2], [0, 1, 2]]);
    }
}
