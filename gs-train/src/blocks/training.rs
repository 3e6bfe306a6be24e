//! The training of one block.

use std::collections::BTreeMap;

use gs_core::{Optimizer, Rasterizer, Scene3d};

use super::{
    assignment::counts,
    plan::{BlockPlan, BlockView, BlocksPlan, SettledView, look_factor},
    window::Window,
};
use crate::{
    error::Error,
    train::{Exposures, PosedView, Poses, Start, Trainer3d, Views, pose_of, shown, with_pose},
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

/// The views of a block, from all views of the data set at the size for the blocks. `start` are the Gaussians that the
/// block begins with: pixels that mostly show fixed ones do not count.
///
/// # Errors
/// [`Error::OtherViews`] where these are not the views of the plan; [`Error::OtherImages`] where an image has changed;
/// those of the backend and of reading an image.
pub async fn block_views<R: Rasterizer<Scene3d>>(
    on: &R,
    plan: &BlocksPlan,
    block: usize,
    all: &Views,
    start: &Scene3d,
) -> Result<Views, Error> {
    let others = || Error::OtherViews { expected: plan.views.len(), found: all.train.len() };
    if !all.train.iter().map(|view| &view.name).eq(plan.views.iter().map(|view| &view.name)) {
        return Err(others());
    }
    let BlockPlan { views: used, fixed, .. } = &plan.blocks[block];
    let whole = |&BlockView { view, window }: &BlockView| {
        let (settled, view) = (plan.views.get(view)?, all.train.get(view)?);
        let camera = settled.pose.map_or(view.camera, |pose| with_pose(&view.camera, &pose));
        let window = window.unwrap_or(Window::whole(&camera));
        window.is_in(&camera).then(|| (PosedView { camera, ..view.clone() }, window))
    };
    let mut parts = used.iter().map(whole).collect::<Option<Vec<_>>>().ok_or_else(others)?;
    if *fixed > 0 || used.iter().any(|view| view.window.is_some()) {
        let looks: Vec<_> =
            parts.iter().map(|(view, window)| (window.camera(&view.camera), look_factor(&view.camera))).collect();
        let counts =
            counts(on, start, *fixed as usize, &shown(&plan.settings, &plan.settings.render.effects), looks).await?;
        parts.iter_mut().zip(counts).for_each(|((view, window), counts)| *view = window.of(view, counts));
    }
    let train = parts.into_iter().map(|(view, _)| view).collect();
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
    let maps = plan.blocks[block].views.iter().filter_map(|view| plan.views[view.view].colors).collect();
    let trainer = Trainer3d::from_views(on, views, Start::Scene(start), plan.settings_of(block)).await?;
    Ok(trainer.with_exposures(Exposures::settled(maps)))
}
