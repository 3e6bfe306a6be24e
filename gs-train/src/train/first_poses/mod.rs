//! The poses that a run begins with.
//!
//! Where poses are refined, cameras first move in a short training before the run, with few Gaussians and on images
//! that are so small that a wrong pose is an error of a pixel or less ([`small`]). A scene of many Gaussians fits the
//! wrong poses of few views, and then no gradient corrects them, so the scene of this training is not used further.
//! A [`trial`] may decide before that whether there is anything to refine.

mod small;
mod trial;

use gs_core::{Optimizer, Scene3d};

use self::{small::Small, trial::Trial};
use super::{
    poses::{Motion, Poses, RefinePoses},
    settings::TrainSettings,
};
use crate::{error::Error, views::Views};

/// The poses of a run that begins with this scene. With [`RefinePoses::Auto`], a trial decides about them. Where
/// they are refined, the cameras of the training views have moved on small images afterwards, and the scene
/// with them, as far as they moved together.
///
/// # Errors
/// Those of the backend, of training, and of reading an image.
pub(super) async fn first_poses<R: Optimizer<Scene3d>>(
    on: &R,
    views: &mut Views,
    (scene, extent): (&mut Scene3d, f32),
    settings: &TrainSettings,
) -> Result<Poses, Error> {
    let refine = settings.refine_poses;
    if refine.is_off() {
        return Ok(Poses::default());
    }
    let mut poses = Poses::moving(&views.train, scene, Motion::IN_RUN);
    if !poses.is_moving(settings.iterations) {
        return Ok(poses);
    }
    let small = Small::of(&views.train, scene)?;
    if refine == RefinePoses::Auto {
        let trial = Trial::run(on, views, &small, settings).await?;
        poses.tried(trial.gain() as f32);
        if !trial.shows_wrong_poses() {
            return Ok(poses.rejected(&trial.aligned, extent));
        }
    }
    let cameras = small.moved(on, views.train_cameras(), settings).await?;
    poses.begin_at(cameras, &mut views.train, (scene, extent));
    Ok(poses)
}
