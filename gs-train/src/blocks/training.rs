//! The training of one block.

use std::collections::BTreeMap;

use gs_core::{Optimizer, Scene3d};

use super::{
    plan::{BlockView, BlocksPlan, SettledView},
    window::window_of,
};
use crate::{
    error::Error,
    train::{Exposures, PosedView, Poses, Start, Trainer3d, Views, pose_of, with_pose},
};

/// Gives views the cameras that a coarse model was trained with, and returns what was settled about its training
/// views. `metadata` are those of a checkpoint of that training, late enough that nothing changed afterwards.
///
/// # Errors
/// [`Error::Checkpoint`] where they are of other views; those of reading an image.
pub fn settle(views: &mut Views, metadata: &BTreeMap<String, String>) -> Result<Vec<SettledView>, Error> {
    let given: Vec<_> = views.train_cameras().copied().collect();
    Poses::from_metadata(metadata, &mut views.train)?;
    let exposures = Exposures::from_metadata(metadata, views.train.len())?;
    let digests = views.digests()?;
    let settled = |(index, view): (usize, &PosedView)| SettledView {
        name: view.name.clone(),
        digest: digests[index],
        pose: (view.camera != given[index]).then(|| pose_of(&view.camera)),
        colors: exposures.map(index).copied(),
    };
    Ok(views.train.iter().enumerate().map(settled).collect())
}

/// The views of a block, from all views of the data set at the size for the blocks.
///
/// # Errors
/// [`Error::OtherViews`] where these are not the views of the plan; [`Error::OtherImages`] where an image has changed;
/// those of reading an image.
pub fn block_views(plan: &BlocksPlan, block: usize, all: &Views) -> Result<Views, Error> {
    if !all.train.iter().map(|view| &view.name).eq(plan.views.iter().map(|view| &view.name)) {
        return Err(Error::OtherViews { expected: plan.views.len(), found: all.train.len() });
    }
    let of_block = |&BlockView { view: index, window }: &BlockView| {
        let (Some(settled), Some(view)) = (plan.views.get(index), all.train.get(index)) else { return None };
        let camera = settled.pose.map_or(view.camera, |pose| with_pose(&view.camera, &pose));
        let view = PosedView { camera, ..view.clone() };
        match window {
            None => Some(view),
            Some(window) => window.is_in((camera.width, camera.height)).then(|| window_of(&view, window)),
        }
    };
    let used = &plan.blocks[block].views;
    let train: Option<Vec<PosedView>> = used.iter().map(of_block).collect();
    let train = train.ok_or(Error::OtherViews { expected: plan.views.len(), found: all.train.len() })?;
    let views = Views { train, test: Vec::new(), ..all.clone() };
    let changed = |(digest, view): (&u32, &BlockView)| (*digest != plan.views[view.view].digest).then_some(view.view);
    let changed: Vec<usize> = views.digests()?.iter().zip(used).filter_map(changed).collect();
    match changed.first() {
        None => Ok(views),
        Some(&first) => Err(Error::OtherImages { count: changed.len(), first: plan.views[first].name.clone() }),
    }
}

/// Begins the training of a block with its [views](block_views) and its first Gaussians. A checkpoint of it is resumed
/// by [`Trainer3d::resume_views`] with the same views.
///
/// # Errors
/// Those of [`Trainer3d::from_views`].
pub async fn begin<'r, R: Optimizer<Scene3d>>(
    on: &'r R,
    plan: &BlocksPlan,
    block: usize,
    views: Views,
    start: Scene3d,
) -> Result<Trainer3d<'r, R>, Error> {
    let maps = plan.blocks[block].views.iter().map(|view| plan.views[view.view].colors).collect::<Option<_>>();
    let trainer = Trainer3d::from_views(on, views, Start::Scene(start), plan.settings_of(block)).await?;
    Ok(trainer.with_exposures(Exposures::settled(maps.unwrap_or_default())))
}
