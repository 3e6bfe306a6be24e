//! The plan of a training in blocks: what each block trains, from which views, and for how long.

use gs_core::{Camera, Error as CoreError, Optimizer, Scene as _, Scene3d, examination::Examinable as _};
use gs_io::dataset::Window;
use serde::{Deserialize, Serialize};

use super::{
    assignment::{Coarse, Contribution},
    cells::{Cell, Grid, Ground, divide},
};
use crate::{
    error::Error,
    run::Recovery,
    train::{Exposure, RefinePoses, TrainSettings, Views, extent_of, shown},
    views::{ColorMap, possible, reduced_camera},
};

/// Longer side of the views at which contributions are measured, px, at most twice as many.
const LOOK_PX: u32 = 200;

/// Work between the edge of a cell and what is near it, as a share of the cell's work.
const NEAR: f64 = 0.05;

/// Standard deviations up to which a Gaussian outside of a cell reaches into it.
const REACH: f64 = 2.0;

/// Share of the mean blending weights, over all that a block's windows show, below which a Gaussian outside of the
/// block is left out.
const VISIBLE: f64 = 0.01;

/// How a scene is divided into blocks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct BlocksSettings {
    /// Columns and rows of cells.
    pub grid: Grid,
    /// Work in the margin at each side of a cell, in which its block trains Gaussians, too, as a share of the cell's
    /// work; 0..=1.
    pub margin: f64,
    /// Share of a view's blending weights from which a block uses the view, 0..=1. A view that no block uses goes to
    /// the block that contributes most to it.
    pub threshold: f64,
}

impl BlocksSettings {
    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] naming the first value outside its range.
    pub fn validate(&self) -> Result<(), CoreError> {
        let Self { grid: Grid { columns, rows }, margin, threshold } = *self;
        if columns == 0 || rows == 0 {
            return Err(CoreError::setting("the number of blocks", format!("{columns}x{rows}"), "at least 1x1"));
        }
        for (what, value) in [("margin", margin), ("threshold", threshold)] {
            CoreError::within(what, value, 0.0..=1.0, "0 to 1")?;
        }
        Ok(())
    }
}

/// What the coarse model has settled about a training view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct SettledView {
    /// Its name.
    pub name: String,
    /// A checksum of its image.
    pub digest: u32,
    /// The columns of the camera's world-to-camera rotation, and its translation, where poses were refined.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<[f32; 12]>,
    /// The map from its colours to those of the scene, where exposure was corrected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) colors: Option<ColorMap>,
}

/// A view of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockView {
    /// Its number among the training views.
    pub view: usize,
    /// The part that the block uses; `None` for all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
}

/// What a block trains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct BlockPlan {
    /// The cell.
    pub cell: Cell,
    /// The cell and what is near its edges: strips with 5 % of its work at each side.
    pub near: Cell,
    /// The views that it trains with, in the order of their numbers.
    pub views: Vec<BlockView>,
    /// Number of Gaussians of the coarse model that stay as they are.
    pub fixed: u32,
    /// Number of Gaussians of the coarse model in the cell and its margin, or so large that they reach into the
    /// cell.
    pub own: u32,
    /// Largest number of Gaussians, the fixed ones included.
    pub gaussians: u32,
    /// Number of steps.
    pub steps: u32,
    /// Estimate of the peak memory of its training on the CPU, bytes.
    pub memory: u64,
}

/// The plan of a training in blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct BlocksPlan {
    /// How the scene was divided.
    pub division: BlocksSettings,
    /// The settings that one training of the whole would have.
    pub settings: TrainSettings,
    /// The directions along the ground.
    pub ground: Ground,
    /// The training views.
    pub views: Vec<SettledView>,
    /// Names of the training views that show nothing of the coarse model. No block uses them.
    pub unused: Vec<String>,
    /// For each held-out view, the block that contributes most to it.
    pub held_out: Vec<usize>,
    /// The blocks, column by column.
    pub blocks: Vec<BlockPlan>,
}

impl BlocksPlan {
    /// Divides a scene by its coarse model. `views` have the cameras that the model was trained with, at the size for
    /// the blocks; `settled` is what was [settled](super::settle) about them. `settings` are those that one training
    /// of the whole would have. `store` receives the Gaussians that each block begins with: the fixed ones, then its
    /// own.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] for settings that are not possible, and where a block would have no Gaussian or no
    /// view; those of the backend and of `store`.
    pub async fn new<R: Optimizer<Scene3d>>(
        on: &R,
        model: &Scene3d,
        views: &Views,
        settled: Vec<SettledView>,
        mut settings: TrainSettings,
        division: BlocksSettings,
        mut store: impl FnMut(usize, &Scene3d) -> Result<(), Error>,
    ) -> Result<Self, Error> {
        division.validate()?;
        let all: Vec<Camera> = views.train_cameras().copied().collect();
        settings.extent.get_or_insert_with(|| extent_of(&all, &model.means));
        settings.validate()?;
        let ground = Ground::of(model);
        let places: Vec<_> = model.means.iter().map(|mean| ground.place(*mean)).collect();
        let coarse = Coarse::new(on, model, &shown(&settings, &settings.render.effects))?;
        let looks = |camera: &Camera| reduced_camera(camera, possible(camera, look_factor(camera)));
        let cameras: Vec<Camera> = views.train_cameras().map(looks).collect();
        let work = coarse.weights(&cameras).await?;
        let cells = divide(division.grid, &places, &work)?;
        let widened =
            |share: f64| -> Vec<Cell> { cells.iter().map(|cell| cell.widened(share, &places, &work)).collect() };
        let (wide, near) = (widened(division.margin), widened(NEAR));
        let contributions =
            coarse.contributions(cells.len(), |set, index| wide[set].contains(places[index]), &cameras).await?;
        let (used, unused) = used_by(&contributions, division.threshold);
        let mut plan = Self {
            division,
            ground,
            unused: unused.into_iter().map(|view| views.train[view].name.clone()).collect(),
            views: settled,
            held_out: Vec::new(),
            blocks: Vec::with_capacity(cells.len()),
            settings,
        };
        let total: f64 = work.iter().sum();
        for (number, (cell, of_views)) in cells.iter().zip(&contributions).enumerate() {
            let chosen: Vec<usize> = (0..cameras.len()).filter(|&view| used[view].contains(&number)).collect();
            if chosen.is_empty() {
                let found = format!("0 for block {} of {}", number + 1, cells.len());
                let allowed = "at least 1: choose fewer blocks or a lower threshold";
                return Err(CoreError::setting("number of views", found, allowed).into());
            }
            let windows: Vec<Camera> = chosen
                .iter()
                .map(|&view| {
                    of_views[view].window_of(&cameras[view]).map_or(cameras[view], |w| w.camera(&cameras[view]))
                })
                .collect();
            let seen = coarse.weights(&windows).await?;
            let reach = |index: usize| REACH * f64::from(model.log_scales[index].max_element().exp());
            let is_own =
                |index: usize| wide[number].contains(places[index]) || cell.distance(places[index]) <= reach(index);
            let (mut fixed, mut own) = (model.clone(), model.clone());
            let shown = seen.iter().filter(|weight| **weight > 0.0).count();
            let visible = VISIBLE * seen.iter().sum::<f64>() / shown.max(1) as f64;
            fixed.retain(&(0..model.len()).map(|index| seen[index] > visible && !is_own(index)).collect::<Vec<_>>());
            own.retain(&(0..model.len()).map(is_own).collect::<Vec<_>>());
            // Large Gaussians reach into many cells: their work counts only where they lie.
            let in_margin = |index: &usize| wide[number].contains(places[*index]);
            let share = (0..model.len()).filter(in_margin).map(|index| work[index]).sum::<f64>() / total;
            let (of_fixed, of_own) = (fixed.len() as u32, own.len() as u32);
            let most = ((share * f64::from(plan.settings.gaussians)).round() as u32).max(of_own);
            let steps = f64::from(plan.settings.iterations) * chosen.len() as f64 / cameras.len() as f64;
            fixed.append(own);
            store(number, &fixed)?;
            let view = |view: usize| {
                let window = of_views[view].window_of(&views.train[view].camera);
                BlockView { view, window }
            };
            plan.blocks.push(BlockPlan {
                cell: *cell,
                near: near[number],
                views: chosen.into_iter().map(view).collect(),
                fixed: of_fixed,
                own: of_own,
                gaussians: of_fixed + most,
                steps: (steps.round() as u32).max(1),
                memory: 0,
            });
            let memory = plan.memory(number, views);
            plan.blocks[number].memory = memory;
        }
        let held_out: Vec<Camera> = views.test.iter().map(|view| looks(&view.camera)).collect();
        let of_cells =
            coarse.contributions(cells.len(), |set, index| cells[set].contains(places[index]), &held_out).await?;
        plan.held_out = (0..held_out.len()).map(|view| most_of(&of_cells, view)).collect();
        Ok(plan)
    }

    /// The settings of a block's training.
    ///
    /// # Panics
    /// Where there is no such block.
    pub fn settings_of(&self, block: usize) -> TrainSettings {
        let BlockPlan { fixed, gaussians, steps, .. } = self.blocks[block];
        let mut settings = self.settings.clone().lasting(steps).with_gaussians(gaussians);
        settings.adam = settings.adam.standing_for(self.settings.iterations as f32 / steps as f32);
        settings.fixed = fixed;
        // The model that it begins with has all degrees, and is not to be left for another.
        settings.sh_degree_every = 0;
        settings.recovery = Recovery::Never;
        settings.remove_unseen = false;
        settings.exposure = Exposure::Off;
        settings.refine_poses = RefinePoses::Off;
        settings
    }

    /// The name of the first view whose pose or exposure the coarse model has corrected.
    pub fn first_corrected(&self) -> Option<&String> {
        self.views.iter().find(|view| view.pose.is_some() || view.colors.is_some()).map(|view| &view.name)
    }

    fn memory(&self, block: usize, views: &Views) -> u64 {
        let size = |view: &BlockView| {
            let camera = &views.train[view.view].camera;
            view.window.map_or((camera.width, camera.height), |window| (window.width, window.height))
        };
        let BlockPlan { views: used, gaussians, .. } = &self.blocks[block];
        self.settings_of(block).peak_bytes(used.iter().map(size), views.keep_bytes, u64::from(*gaussians))
    }
}

/// The divisor of a view's sides for a look at contributions.
fn look_factor(camera: &Camera) -> u32 {
    let longer = camera.width.max(camera.height);
    (longer / LOOK_PX).max(1).next_power_of_two().min(longer / LOOK_PX).max(1)
}

/// The blocks that use each view, and the views that show nothing.
fn used_by(contributions: &[Vec<Contribution>], threshold: f64) -> (Vec<Vec<usize>>, Vec<usize>) {
    let views = contributions.first().map_or(0, Vec::len);
    let (mut used, mut unused) = (Vec::with_capacity(views), Vec::new());
    for view in 0..views {
        let share = |block: usize| contributions[block][view].share;
        let enough = |&block: &usize| share(block) > 0.0 && share(block) >= threshold;
        let mut blocks: Vec<usize> = (0..contributions.len()).filter(enough).collect();
        if blocks.is_empty() {
            match most_of(contributions, view) {
                most if share(most) > 0.0 => blocks.push(most),
                _ => unused.push(view),
            }
        }
        used.push(blocks);
    }
    (used, unused)
}

/// The block that contributes most to a view, the first of equals.
fn most_of(contributions: &[Vec<Contribution>], view: usize) -> usize {
    let better = |best: usize, block: usize| {
        if contributions[block][view].share > contributions[best][view].share { block } else { best }
    };
    (0..contributions.len()).reduce(better).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_go_to_all_blocks_that_contribute_enough_and_at_least_to_one() {
        let of = |shares: [f64; 3]| shares.map(|share| Contribution { share, window: None }).to_vec();
        let contributions = [of([0.5, 0.01, 0.0]), of([0.2, 0.03, 0.0])];
        let (used, unused) = used_by(&contributions, 0.1);
        assert_eq!((used, unused), (vec![vec![0, 1], vec![1], vec![]], vec![2]));
        assert_eq!(used_by(&contributions, 0.0).0, [vec![0, 1], vec![0, 1], vec![]]);
    }
}
