//! Refinement of camera poses: a few times in a run, the camera of each training view is aligned to its image.
//!
//! The camera of each view is aligned to its image with the scene as it is ([`align`]), and later steps use
//! the new cameras, so that scene and cameras become consistent in turns. The common motion of the cameras,
//! which no image shows, is taken out ([`gauge`]). *Source:* BARF (Lin et al. 2021) and SplaTAM (Keetha et
//! al. 2024) refine poses by gradient descent in every step. Here they are aligned as in direct
//! visual odometry, which needs fewer looks at each image and only forward passes.

pub(super) mod align;
mod gauge;

use std::collections::BTreeMap;

use gs_core::{Camera, Rasterizer, RenderSettings, Scene3d};
use gs_io::dataset::PosedImage;
use serde::{Deserialize, Serialize};

use self::align::{Part, Sight, align, divisor};
use crate::error::Error;
use crate::run::{table, to_table};
use crate::train::exposure::Exposures;
use crate::views::{PosedView, training_image};

gs_core::choices! {
    /// Whether the poses of the training views' cameras are refined along with the scene.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum RefinePoses {
        /// The cameras stay as they are given.
        #[default]
        Off = "off": "Train with the cameras as they are",
        /// The cameras are aligned to their images a few times in the run.
        On = "on": "Align each camera to its image a few times during the training",
        /// Like [`Self::On`] if an alignment with half of the squares of each image, as on a chessboard, brings
        /// the renderings closer to the other squares, and otherwise like [`Self::Off`].
        Auto = "auto": "As on if an alignment with half of each image improves the other half, otherwise as off",
    }
}

impl RefinePoses {
    pub(super) fn is_off(&self) -> bool {
        *self == Self::Off
    }

    /// Fewest steps of a run in which the cameras of this many training views are aligned.
    pub fn least_steps(views: usize) -> u32 {
        let last = ALIGNED_AT.iter().map(|(share, _)| *share).fold(0.0, f64::max);
        (f64::from(LEAST_STEPS_PER_VIEW) * views as f64 / last).ceil() as u32
    }
}

/// Shares of a run after which cameras are aligned, and numbers of pixels for it: late enough for sharp
/// renderings, early enough for the scene to adapt.
const ALIGNED_AT: [(f64, u64); 5] = [(0.2, 10_000), (0.28, 40_000), (0.36, 40_000), (0.45, 160_000), (0.55, 160_000)];

/// Least number of steps for each training view before the first alignment.
const LEAST_STEPS_PER_VIEW: u32 = 4;

/// Least gain of the pixels that an alignment did not use, dB, with which [`RefinePoses::Auto`] refines the poses.
const LEAST_GAIN_DB: f64 = 0.5;

/// Motion of a camera, relative to the median of all, from which its alignment went astray.
const ASTRAY: f32 = 4.0;

/// Key of the cameras in the metadata of checkpoints.
const KEY: &str = "refined-poses";

/// A world-to-camera pose: the columns of the rotation, and the translation.
type Pose = [f32; 12];

fn pose_of(camera: &Camera) -> Pose {
    let mut pose = [0.0; 12];
    pose[..9].copy_from_slice(&camera.rotation.to_cols_array());
    pose[9..].copy_from_slice(&camera.translation.to_array());
    pose
}

fn with_pose(camera: &Camera, pose: &Pose) -> Camera {
    let rotation = glam::Mat3::from_cols_slice(&pose[..9]);
    Camera { rotation, translation: glam::Vec3::from_slice(&pose[9..]), ..*camera }
}

/// Report on the refinement of the poses of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct PosesReport {
    /// Whether the refined poses are used: with [`RefinePoses::Auto`], only if they gain enough.
    pub used: bool,
    /// How much closer the first alignment with half of the squares of each image brought the renderings to
    /// the other squares; median over the training views, dB.
    pub gain_db: f64,
    /// Median turn of a camera, degrees.
    pub median_degrees: f32,
    /// Largest turn of a camera, degrees.
    pub most_degrees: f32,
    /// Median distance of a camera from its given position, % of the scene's extent.
    pub median_percent: f32,
    /// Largest distance of a camera from its given position, % of the scene's extent.
    pub most_percent: f32,
}

/// The refined poses of a run, as stored in its checkpoints.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
struct State {
    /// For each training view; empty before the first alignment, and where they are not used.
    of_views: Vec<Pose>,
    report: Option<PosesReport>,
}

/// The poses of a run.
#[derive(Debug, Default)]
pub(super) struct Poses {
    /// The cameras of the training views as they were given; empty before the first alignment of this process.
    given: Vec<Camera>,
    state: State,
}

impl Poses {
    /// The poses of a checkpoint with this metadata, which the training views receive.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where they are not those of such a run.
    pub(super) fn from_metadata(metadata: &BTreeMap<String, String>, views: &mut [PosedView]) -> Result<Self, Error> {
        if !metadata.contains_key(KEY) {
            return Ok(Self::default());
        }
        let state: State = table(metadata, KEY)?;
        let given: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        let found = state.of_views.len();
        if found != 0 && found != views.len() {
            return Err(Error::Checkpoint(format!("its `{KEY}` are of {found} views, not of {}", views.len())));
        }
        for (view, pose) in views.iter_mut().zip(&state.of_views) {
            view.camera = with_pose(&view.camera, pose);
            view.camera.validate().map_err(|error| Error::Checkpoint(format!("its `{KEY}`: {error}")))?;
        }
        Ok(Self { given, state })
    }

    /// The metadata for a checkpoint; `None` before the first alignment.
    pub(super) fn to_metadata(&self) -> Result<Option<(&'static str, String)>, Error> {
        if self.state == State::default() {
            return Ok(None);
        }
        Ok(Some((KEY, to_table(KEY, &self.state)?)))
    }

    /// Report of the last alignment.
    pub(super) fn report(&self) -> Option<PosesReport> {
        self.state.report
    }

    /// Number of pixels with which the cameras of a run with this many views are to be aligned before the step
    /// after `step` of `iterations` steps; `None` if they are not.
    pub(super) fn due(&self, refine: RefinePoses, views: u32, step: u32, iterations: u32) -> Option<u64> {
        let rejected = self.state.report.is_some_and(|report| !report.used);
        if refine.is_off() || rejected || step < LEAST_STEPS_PER_VIEW.saturating_mul(views) {
            return None;
        }
        let at = |share: f64| (share * f64::from(iterations)).round() as u32 == step;
        ALIGNED_AT.into_iter().find(|(share, _)| at(*share)).map(|(_, pixels)| pixels)
    }

    /// Aligns the cameras of these views to their images, from renderings whose sides are divided by `factor`
    /// or more.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    pub(super) async fn refine<R: Rasterizer<Scene3d>>(
        &mut self,
        scene: (&R, &R::Splats),
        views: &mut [PosedView],
        (render, extent, exposures): (&RenderSettings, f32, &Exposures),
        (refine, pixels, factor): (RefinePoses, u64, u32),
    ) -> Result<(), Error> {
        if self.given.is_empty() {
            self.given = views.iter().map(|view| view.camera).collect();
        }
        // The first motions are the largest.
        let levels: &[(u64, u32)] = match self.state.report {
            None => &[(pixels / 4, 2), (pixels, 2)],
            Some(_) => &[(pixels, 1)],
        };
        let mut cameras = Vec::with_capacity(views.len());
        let mut gains = Vec::new();
        for (index, view) in views.iter().enumerate() {
            let image = training_image(view, 1, exposures.map(index))?;
            let camera = &view.camera;
            if self.state.report.is_none() {
                gains.extend(gain_db(scene, (camera, &image), render, (levels, factor)).await?);
            }
            cameras.push(align(scene, (camera, &image), render, (Part::Whole, levels, factor)).await?);
        }
        let gain_db = match self.state.report {
            Some(report) => report.gain_db,
            None if gains.is_empty() => 0.0,
            None => median(gains),
        };
        let used = refine == RefinePoses::On || gain_db >= LEAST_GAIN_DB;
        if used {
            leave_astray(&self.given, &mut cameras, extent);
            gauge::keep(&self.given, &mut cameras, f64::from(extent));
            views.iter_mut().zip(&cameras).for_each(|(view, camera)| view.camera = *camera);
        }
        let of_views = if used { cameras.iter().map(pose_of).collect() } else { Vec::new() };
        let moves = self.given.iter().zip(if used { &cameras } else { &self.given });
        let moves: Vec<[f32; 2]> = moves.map(|(from, to)| motion(from, to, extent)).collect();
        let [degrees, percent] = [0, 1].map(|k| moves.iter().map(|motion| motion[k]).collect());
        let [(median_degrees, most_degrees), (median_percent, most_percent)] = [degrees, percent].map(median_and_most);
        let report = PosesReport { used, gain_db, median_degrees, most_degrees, median_percent, most_percent };
        self.state = State { of_views, report: Some(report) };
        Ok(())
    }
}

/// Gain in every other square of an image by an alignment with the other squares, dB; `None` where too few
/// pixels count.
async fn gain_db<R: Rasterizer<Scene3d>>(
    scene: (&R, &R::Splats),
    (camera, image): (&Camera, &PosedImage),
    render: &RenderSettings,
    (levels, least): (&[(u64, u32)], u32),
) -> Result<Option<f64>, Error> {
    let aligned = align(scene, (camera, image), render, (Part::Squares(false), levels, least)).await?;
    let pixels = levels.last().map_or(1, |(pixels, _)| *pixels);
    let sight = Sight::new(image, divisor(camera, pixels, least), render)?;
    let before = sight.squared_error(scene, camera, render, Part::Squares(true)).await?;
    let after = sight.squared_error(scene, &aligned, render, Part::Squares(true)).await?;
    let gain = before.zip(after).map(|(before, after)| 10.0 * (before / after).log10());
    Ok(gain.filter(|gain| gain.is_finite()))
}

/// Turn of a camera, degrees, and its distance from where it was, % of the extent.
fn motion(from: &Camera, to: &Camera, extent: f32) -> [f32; 2] {
    let turn = glam::DQuat::from_mat3(&(to.rotation * from.rotation.transpose()).as_dmat3());
    let degrees = turn.normalize().to_scaled_axis().length().to_degrees() as f32;
    [degrees, 100.0 * to.position().distance(from.position()) / extent]
}

/// Puts cameras back that were moved much farther than the others: their alignment went astray.
fn leave_astray(given: &[Camera], cameras: &mut [Camera], extent: f32) {
    let moves: Vec<f32> = given.iter().zip(&*cameras).map(|(a, b)| motion(a, b, extent).into_iter().sum()).collect();
    let (median, _) = median_and_most(moves.clone());
    for ((camera, given), moved) in cameras.iter_mut().zip(given).zip(moves) {
        // True for NaN.
        if !(moved <= ASTRAY * median) {
            *camera = *given;
        }
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn median_and_most(mut values: Vec<f32>) -> (f32, f32) {
    values.sort_by(f32::total_cmp);
    (values[values.len() / 2], values[values.len() - 1])
}
