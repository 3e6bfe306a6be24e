//! Refinement of camera poses: the cameras of the training views move while the scene is trained.
//!
//! They first move in a short training before the run ([`first_poses`](super::first_poses)). In the run, they move
//! by little. In both, each step also gives the gradient of its loss by the camera, and after each epoch, every
//! camera moves against its gradient ([`descent`]). The common motion of the cameras, which no
//! image shows, is taken out ([`gauge`]).
//!
//! *Source:* gradients by the pose as in gsplat, from coarse to fine as in BARF (Lin et al. 2021).

pub(super) mod align;
mod descent;
mod gauge;
mod refine_poses;

use std::collections::BTreeMap;

use gs_core::{Camera, Optimizer, Scene3d, Wait, math::similarity::Similarity};
use serde::{Deserialize, Serialize};

use self::descent::{Descent, by_pose};
pub use self::refine_poses::RefinePoses;
use crate::error::Error;
use crate::run::{table, to_table};
use crate::views::PosedView;

/// How the cameras of a training move.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    /// Share of the training until which they move.
    until: f64,
    /// The way that a camera would go if all its steps had the same direction, as a share of the longer side of
    /// its image. Steps become shorter at a constant rate until they are 0.
    way: f64,
    /// Whether their common motion is taken out after each epoch.
    keeps_mean: bool,
}

impl Motion {
    /// On small images, before the run. The first Gaussians hold the cameras in place together.
    pub(super) const BEFORE_RUN: Self = Self { until: 1.0, way: 0.05, keeps_mean: false };

    pub(super) const IN_RUN: Self = Self { until: 0.7, way: 0.015, keeps_mean: true };
}

/// Share of a training after which its cameras begin to move, when its scene shows something.
const FROM: f64 = 0.1;

/// Key of the cameras in the metadata of checkpoints.
const KEY: &str = "refined-poses";

/// A world-to-camera pose: the columns of the rotation, and the translation.
pub(crate) type Pose = [f32; 12];

pub(crate) fn pose_of(camera: &Camera) -> Pose {
    let mut pose = [0.0; 12];
    pose[..9].copy_from_slice(&camera.rotation.to_cols_array());
    pose[9..].copy_from_slice(&camera.translation.to_array());
    pose
}

pub(crate) fn with_pose(camera: &Camera, pose: &Pose) -> Camera {
    let rotation = glam::Mat3::from_cols_slice(&pose[..9]);
    Camera { rotation, translation: glam::Vec3::from_slice(&pose[9..]), ..*camera }
}

/// Report on the refinement of the poses of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct PosesReport {
    /// Whether poses are refined: with [`RefinePoses::Auto`], only if the trial showed that they are wrong.
    /// Otherwise the motions below are those of the views that the trial aligned.
    pub used: bool,
    /// Mean gain of the views that the trial of [`RefinePoses::Auto`] aligned, dB, in the halves of the images
    /// that they were not aligned to; `None` without a trial.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trial_db: Option<f32>,
    /// Motion of the first Gaussians in a view by the refinement, root mean square, px; median over the views.
    pub median_px: f32,
    /// Median turn of a camera, degrees.
    pub median_degrees: f32,
    /// Largest turn of a camera, degrees.
    pub most_degrees: f32,
    /// Median distance of a camera from its given position, % of the scene's extent.
    pub median_percent: f32,
    /// Largest distance of a camera from its given position, % of the scene's extent.
    pub most_percent: f32,
}

/// The refinement of the poses of a run, as stored in its checkpoints.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
struct State {
    /// Report on where the cameras are since the start, or the last epoch.
    report: Option<PosesReport>,
    /// What the trial of [`RefinePoses::Auto`] found: [`PosesReport::trial_db`].
    trial_db: Option<f32>,
    /// Views of the steps since then, and the gradients of these steps by the pose.
    gradients: Vec<(usize, [f32; 6])>,
    /// For each training view; empty where poses are not refined, or no longer after a trial.
    of_views: Vec<OfView>,
}

/// The state of a camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct OfView {
    pose: Pose,
    descent: Descent,
}

/// The poses of a training.
#[derive(Debug)]
pub(crate) struct Poses {
    /// The cameras of the training views as they were given; empty where poses are not refined.
    given: Vec<Camera>,
    state: State,
    /// Views of the steps whose gradients have not been collected.
    sent: Vec<usize>,
    motion: Motion,
}

impl Default for Poses {
    /// Those of a run that does not refine them.
    fn default() -> Self {
        Self { given: Vec::new(), state: State::default(), sent: Vec::new(), motion: Motion::IN_RUN }
    }
}

impl Poses {
    /// Those of views whose cameras move like this, with a scene.
    pub(super) fn moving(views: &[PosedView], scene: &Scene3d, motion: Motion) -> Self {
        let of_view = |PosedView { camera, .. }: &PosedView| OfView {
            pose: pose_of(camera),
            descent: Descent::of(camera, &scene.means),
        };
        let state = State { of_views: views.iter().map(of_view).collect(), ..State::default() };
        Self { motion, ..Self::with(views, state) }
    }

    fn with(views: &[PosedView], state: State) -> Self {
        Self { given: views.iter().map(|view| view.camera).collect(), state, ..Self::default() }
    }

    /// Notes what the trial of [`RefinePoses::Auto`] found: [`PosesReport::trial_db`].
    pub(super) fn tried(&mut self, gain_db: f32) {
        self.state.trial_db = Some(gain_db);
    }

    /// The poses of a run that does not refine them, because a trial has aligned these cameras, which have these
    /// numbers, and views did not match better.
    pub(super) fn rejected(self, aligned: &[(usize, Camera)], extent: f32) -> Self {
        let report = PosesReport { used: false, ..self.report_on(aligned, extent) };
        Self { state: State { report: Some(report), ..State::default() }, ..self }
    }

    /// Puts the cameras of the training views where a training before the run has moved them, and the scene, as far
    /// as they moved together.
    pub(super) fn begin_at(
        &mut self,
        mut cameras: Vec<Camera>,
        views: &mut [PosedView],
        (scene, extent): (&mut Scene3d, f32),
    ) {
        if let Some(common) = self.keep(&mut cameras, extent) {
            // Turns and scales lose nothing.
            let _lost = gs_io::transform_scene(scene, &common.to_affine());
        }
        self.put(views, cameras, extent);
        for (view, of_view) in views.iter().zip(&mut self.state.of_views) {
            of_view.descent = Descent::of(&view.camera, &scene.means);
        }
    }

    /// The poses of a checkpoint with this metadata, which the training views receive.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where they are not those of such a run.
    pub(crate) fn from_metadata(metadata: &BTreeMap<String, String>, views: &mut [PosedView]) -> Result<Self, Error> {
        if !metadata.contains_key(KEY) {
            return Ok(Self::default());
        }
        let poses = Self::with(views, table(metadata, KEY)?);
        let State { gradients, of_views, report, .. } = &poses.state;
        let found = of_views.len();
        let is_rejected = found == 0 && report.is_some_and(|report| !report.used);
        if found != views.len() && !is_rejected {
            return Err(Error::Checkpoint(format!("its `{KEY}` are of {found} views, not of {}", views.len())));
        }
        let are_valid = of_views.iter().all(|view| view.descent.is_valid());
        if !are_valid || gradients.iter().any(|(index, _)| *index >= found) {
            return Err(Error::Checkpoint(format!("its `{KEY}` are damaged")));
        }
        for (view, OfView { pose, .. }) in views.iter_mut().zip(of_views) {
            view.camera = with_pose(&view.camera, pose);
            view.camera.validate().map_err(|error| Error::Checkpoint(format!("its `{KEY}`: {error}")))?;
        }
        Ok(poses)
    }

    /// The metadata for a checkpoint; `None` where poses are not refined.
    pub(super) fn to_metadata(&self) -> Result<Option<(&'static str, String)>, Error> {
        if self.state == State::default() {
            return Ok(None);
        }
        Ok(Some((KEY, to_table(KEY, &self.state)?)))
    }

    /// Report on where the cameras are; `None` where poses are not refined.
    pub(super) fn report(&self) -> Option<PosesReport> {
        self.state.report
    }

    /// Whether the cameras of a run of `iterations` steps move.
    pub(super) fn is_moving(&self, iterations: u32) -> bool {
        !self.state.of_views.is_empty() && iterations >= RefinePoses::least_steps(self.given.len())
    }

    /// Whether the step after `step` of `iterations` steps is to give the gradient by its camera.
    pub(super) fn needs_gradient(&self, step: u32, iterations: u32) -> bool {
        let progress = f64::from(step) / f64::from(iterations);
        self.is_moving(iterations) && progress >= FROM && progress < self.motion.until
    }

    /// Notes that a step with this view gives a gradient.
    pub(super) fn sent(&mut self, index: usize) {
        self.sent.push(index);
    }

    /// Collects the gradients of all steps.
    ///
    /// # Errors
    /// Those of the backend.
    pub(super) async fn collect<R: Optimizer<Scene3d>>(&mut self, on: &R, splats: &mut R::Splats) -> Result<(), Error> {
        if self.sent.is_empty() {
            return Ok(());
        }
        let mut gradients = Vec::with_capacity(self.sent.len());
        on.camera_gradients(splats, Wait::All, &mut gradients).await?;
        // A restart after divergence loses those of the steps before it.
        self.sent.drain(..self.sent.len().saturating_sub(gradients.len()));
        self.state.gradients.extend(self.sent.drain(..).zip(gradients.iter().map(by_pose)));
        Ok(())
    }

    /// Moves the cameras of the training views by the gradients of an epoch, which ends with `step` of
    /// `iterations` steps.
    ///
    /// # Errors
    /// Those of the backend.
    pub(super) async fn move_cameras<R: Optimizer<Scene3d>>(
        &mut self,
        (on, splats): (&R, &mut R::Splats),
        views: &mut [PosedView],
        extent: f32,
        (step, iterations): (u32, u32),
    ) -> Result<(), Error> {
        self.collect(on, splats).await?;
        let gradients = std::mem::take(&mut self.state.gradients);
        if gradients.is_empty() {
            return Ok(());
        }
        let Motion { until, way, keeps_mean } = self.motion;
        let progress = f64::from(step) / f64::from(iterations);
        let steps = (until - FROM) * f64::from(iterations) / views.len() as f64;
        let share = 2.0 * way / steps * ((until - progress) / (until - FROM)).clamp(0.0, 1.0);
        let mut cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        for (index, gradient) in gradients {
            let camera = &mut cameras[index];
            let length = share * f64::from(camera.width.max(camera.height));
            *camera = self.state.of_views[index].descent.step(camera, &gradient, length);
        }
        if keeps_mean {
            self.keep(&mut cameras, extent);
        }
        self.put(views, cameras, extent);
        Ok(())
    }

    /// Takes the common motion out of moved cameras, and returns it.
    fn keep(&self, cameras: &mut [Camera], extent: f32) -> Option<Similarity> {
        let given = self.given.iter().zip(&self.state.of_views).map(|(camera, view)| (*camera, &view.descent));
        gauge::keep(cameras, &given.collect::<Vec<_>>(), f64::from(extent))
    }

    /// Puts the cameras of the training views where these ones are.
    fn put(&mut self, views: &mut [PosedView], cameras: Vec<Camera>, extent: f32) {
        for ((view, camera), of_view) in views.iter_mut().zip(&cameras).zip(&mut self.state.of_views) {
            of_view.pose = pose_of(camera);
            view.camera = with_pose(&view.camera, &of_view.pose);
        }
        let moved: Vec<(usize, Camera)> = cameras.into_iter().enumerate().collect();
        self.state.report = Some(self.report_on(&moved, extent));
    }

    /// The report on cameras of training views with these numbers.
    fn report_on(&self, moved: &[(usize, Camera)], extent: f32) -> PosesReport {
        let State { of_views, trial_db, .. } = &self.state;
        let pixels = moved.iter().map(|&(i, to)| of_views[i].descent.distance(&self.given[i], &to) as f32);
        let (median_px, _) = median_and_most(pixels.collect());
        let moves: Vec<[f32; 2]> = moved.iter().map(|&(i, to)| motion(&self.given[i], &to, extent)).collect();
        let [degrees, percent] = [0, 1].map(|k| moves.iter().map(|motion| motion[k]).collect());
        let [(median_degrees, most_degrees), (median_percent, most_percent)] = [degrees, percent].map(median_and_most);
        let trial_db = *trial_db;
        PosesReport { used: true, trial_db, median_px, median_degrees, most_degrees, median_percent, most_percent }
    }
}

/// Turn of a camera, degrees, and its distance from where it was, % of the extent.
fn motion(from: &Camera, to: &Camera, extent: f32) -> [f32; 2] {
    let turn = glam::DQuat::from_mat3(&(to.rotation * from.rotation.transpose()).as_dmat3());
    let degrees = turn.normalize().to_scaled_axis().length().to_degrees() as f32;
    [degrees, 100.0 * to.position().distance(from.position()) / extent]
}

fn median_and_most(mut values: Vec<f32>) -> (f32, f32) {
    values.sort_by(f32::total_cmp);
    (values.get(values.len() / 2).copied().unwrap_or_default(), values.last().copied().unwrap_or_default())
}
