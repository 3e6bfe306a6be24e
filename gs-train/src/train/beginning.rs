//! What a training of a 3D scene begins with.

use gs_core::{Camera, Optimizer, Parameterization, Scene as _, Scene3d};
use gs_io::dataset::AlphaMeaning;
use web_time::Instant;

use super::{
    exposure::{Exposure, Exposures},
    poses::{Poses, RefinePoses},
    settings::TrainSettings,
    task::ViewsTask,
};
use crate::{
    error::Error,
    run::{Record, Trainer, digest, random},
    start::Start,
    views::{Counting, PosedView, Views, extent_of},
};

/// A training before its first step.
#[derive(Debug)]
pub(super) struct Beginning {
    pub(super) views: Views,
    pub(super) scene: Scene3d,
    pub(super) extent: f32,
    /// They have the extent, and the number of Gaussians that points have raised.
    pub(super) settings: TrainSettings,
    /// What identifies the views as they were given.
    images: String,
    started: Instant,
}

impl Beginning {
    /// Makes the first scene.
    ///
    /// # Errors
    /// Those of [`Trainer3d::from_views`](super::Trainer3d::from_views), except for those of the backend.
    pub(super) fn new(views: Views, start: Start, mut settings: TrainSettings) -> Result<Self, Error> {
        let started = Instant::now();
        settings.validate()?;
        views.validate()?;
        if settings.exposure == Exposure::Affine && views.train.len() < 2 {
            let allowed = "off or auto with a single training view, whose exposure differs from no other";
            return Err(gs_core::Error::setting("exposure", "affine", allowed).into());
        }
        if settings.refine_poses != RefinePoses::Off && views.train.iter().any(|view| view.source.is_face()) {
            let allowed = "off with 360° images or wide fish-eyes, whose views share a camera";
            return Err(gs_core::Error::setting("refine-poses", settings.refine_poses, allowed).into());
        }
        if let Start::Scene(scene) = &start {
            settings = settings.for_scene(scene.len());
        }
        let cameras: Vec<Camera> = views.train_cameras().copied().collect();
        if settings.fixed > 0 && !matches!(start, Start::Scene(_)) {
            return Err(
                gs_core::Error::setting("number of fixed Gaussians", settings.fixed, "0 without a scene").into()
            );
        }
        let views = views.cached();
        let mut start = start.searched(&views.train)?;
        let points = start.points(&settings.init);
        settings = settings.for_points(points);
        if settings.init.far_points.unwrap_or_else(|| views.train.iter().any(|view| view.source.is_face())) {
            start = start.with_shell(&views.train)?;
        }
        let (budget, degree) = (settings.gaussians as usize, settings.render.effects.sh_degree);
        let scene = start.scene(&cameras, &settings.init, budget, degree, &mut random(settings.seed, 0))?;
        let mut gaussians = scene.means.iter().zip(&scene.log_scales);
        if !gaussians.any(|(mean, scales)| cameras.iter().any(|camera| sees(camera, *mean, scales.max_element()))) {
            return Err(Error::NothingInView { gaussians: scene.len(), views: cameras.len() });
        }
        check_fixed(&settings, scene.len())?;
        let extent = *settings.extent.get_or_insert_with(|| extent_of(&cameras, &scene.means));
        settings.validate()?;
        let images = fingerprint(&views);
        Ok(Self { views, scene, extent, settings, images, started })
    }

    /// Hands the scene to a backend. Its views are where these poses have them.
    ///
    /// # Errors
    /// Those of the backend.
    pub(super) fn trainer<R: Optimizer<Scene3d>>(
        self,
        rasterizer: &R,
        poses: Poses,
    ) -> Result<Trainer<'_, R, Scene3d>, Error> {
        let Self { views, scene, extent, settings, images, started } = self;
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        let record = Record::beginning(settings, images);
        let task = ViewsTask::new(views, &[], extent, (Exposures::default(), poses));
        let mut trainer = Trainer::assemble(rasterizer, record, splats, task);
        trainer.record.seconds = started.elapsed().as_secs_f64();
        Ok(trainer)
    }
}

/// Checks that not all of so many Gaussians are fixed.
pub(super) fn check_fixed(settings: &TrainSettings, gaussians: usize) -> Result<(), gs_core::Error> {
    match settings.fixed as usize {
        0 => Ok(()),
        fixed if fixed < gaussians => Ok(()),
        fixed => {
            let found = format!("{fixed} of {gaussians}");
            Err(gs_core::Error::setting("number of fixed Gaussians", found, "less than that of all"))
        }
    }
}

/// Smallest size of a Gaussian in a view that sees it, px: those of a scene in the coordinates of
/// another data set may be thousands of kilometres away.
const SMALLEST_PX: f32 = 1e-4;

fn sees(camera: &Camera, mean: glam::Vec3, log_scale: f32) -> bool {
    let size = glam::Vec2::new(camera.width as f32, camera.height as f32);
    camera.project(mean).is_some_and(|(at, depth)| {
        let is_inside = at.cmpge(glam::Vec2::ZERO).all() && at.cmple(size).all();
        is_inside && camera.focal.max_element() * log_scale.exp() >= SMALLEST_PX * depth
    })
}

/// Identifies the views by names, cameras, roles and which pixels count. Their images have
/// [checksums](Views::digests) of their own, so that an error can name those that differ.
pub(super) fn fingerprint(views: &Views) -> String {
    let mut bytes = Vec::new();
    for (role, views) in [(0, &views.train), (1, &views.test)] {
        for PosedView { name, camera, source } in views {
            bytes.push(role);
            let Counting { alpha, masked } = source.counting();
            match (alpha, masked) {
                (AlphaMeaning::Opacity, false) => {}
                (AlphaMeaning::Opacity, true) => bytes.push(1),
                (AlphaMeaning::Mask, masked) => bytes.push(2 + u8::from(masked)),
            }
            bytes.extend(name.as_bytes());
            let numbers = camera.rotation.to_cols_array().into_iter().chain(camera.translation.to_array());
            let intrinsics = camera.focal.to_array().into_iter().chain(camera.center.to_array()).chain([camera.near]);
            bytes.extend(numbers.chain(intrinsics).flat_map(f32::to_le_bytes));
            bytes.extend([camera.width, camera.height].into_iter().flat_map(u32::to_le_bytes));
        }
    }
    format!("{} views and {} held out, {:016x}", views.train.len(), views.test.len(), digest(bytes))
}
