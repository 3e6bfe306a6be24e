//! [`Kind`] for 2D scenes, and the order in which tiles see their Gaussians.

use gs_core::{AdamRates, Binning, Blend, Canvas, Error, Penalty, RenderSettings, Scene2d};

use super::{
    adam,
    buffers::Buffers2d,
    project, project_bwd, solve_colors,
    splats::{Splats2d, VECTOR},
};
use crate::{
    bias::BiasTable,
    kind::{AllResources, Kind, Resources},
    level::Level,
    stage::Stage,
    target::Target,
    unsupported::{BACKEND, unsupported},
    workspace::Workspace,
};

impl Kind for Scene2d {
    type Splats = Splats2d;
    type Buffers = Buffers2d;
    type Bias = BiasTable<{ VECTOR + 1 }>;

    const BEFORE_BIN: [Stage; 2] = [Stage::Sort, Stage::Project];
    const REUSES_LISTS: bool = true;
    const AFTER_BLEND: &'static [Stage] = &[Stage::ProjectBwd, Stage::Adam];

    fn check_rates(rates: &AdamRates) -> Result<(), Error> {
        if rates.penalty != Penalty::NONE {
            return Err(unsupported("a penalty on the opacities and scales of a 2D scene"));
        }
        Ok(())
    }

    fn check(view: &Canvas, settings: &RenderSettings) -> Result<(), Error> {
        view.validate()?;
        settings.check_for_2d(BACKEND)
    }

    fn size(view: &Canvas) -> (u32, u32) {
        (view.width, view.height)
    }

    fn resources(all: &AllResources) -> &Resources<Self> {
        &all.for_2d
    }

    fn prepare(
        workspace: &mut Workspace<Buffers2d>,
        splats: &Splats2d,
        canvas: &Canvas,
        settings: &RenderSettings,
        binning: Binning,
        level: Level,
    ) -> Result<(), Error> {
        let version = Some(splats.shared.version);
        let same = workspace.buffers.canvas == *canvas
            && workspace.tiles.settings == *settings
            && workspace.version == version;
        let reuse = binning == Binning::Reuse && same;
        workspace.len = splats.shared.len();
        if !reuse {
            workspace.buffers.canvas = *canvas;
            workspace.tiles.set(Self::size(canvas), settings);
            // Sorted in each step: an order from earlier steps would be state that no checkpoint
            // has.
            workspace.version = None;
            Self::sort(workspace, splats);
        }
        Self::project(workspace, splats, level);
        if !reuse {
            Self::bin(workspace, level)?;
            workspace.version = version;
        }
        workspace.tiles.fit();
        Ok(())
    }

    fn project(workspace: &mut Workspace<Buffers2d>, splats: &Splats2d, _: Level) {
        let Workspace { tiles, buffers, .. } = workspace;
        project::project_all(splats, &buffers.canvas, &buffers.order, tiles);
    }

    fn bin(workspace: &mut Workspace<Buffers2d>, level: Level) -> Result<(), Error> {
        workspace.tiles.bin(level, workspace.len, |rank| rank)
    }

    /// Sorts by index under `Over`. Under `Sum`, sorts by row, so that neighbours in a tile's list
    /// are neighbours in memory.
    fn sort(workspace: &mut Workspace<Buffers2d>, splats: &Splats2d) {
        let Workspace { tiles, buffers, .. } = workspace;
        let n = splats.shared.len() as u32;
        buffers.rank_of.clear();
        match tiles.settings.effects.blend {
            Blend::Over => buffers.rank_of.extend(0..n),
            Blend::Sum => {
                // Counting sort, stable; NaN casts to row 0.
                let rows = tiles.grid.height;
                let row = |index: usize| (splats.means[index].y as usize).min(rows - 1);
                buffers.next_ranks.clear();
                buffers.next_ranks.resize(rows, 0);
                (0..n as usize).for_each(|index| buffers.next_ranks[row(index)] += 1);
                let mut next = 0;
                for rank in &mut buffers.next_ranks {
                    next += std::mem::replace(rank, next);
                }
                for index in 0..n as usize {
                    let rank = &mut buffers.next_ranks[row(index)];
                    buffers.rank_of.push(*rank);
                    *rank += 1;
                }
            }
        }
        buffers.order.resize(n as usize, 0);
        for (index, &rank) in buffers.rank_of.iter().enumerate() {
            buffers.order[rank as usize] = index as u32;
        }
    }

    fn project_bwd(workspace: &mut Workspace<Buffers2d>, splats: &Splats2d, _: Level, scale: f32) {
        project_bwd::all(workspace, splats, scale);
    }

    fn derivatives(workspace: &Workspace<Buffers2d>, splats: &Splats2d) -> Self {
        project_bwd::as_scene(splats, |index| workspace.gradient_of(index))
    }

    fn adam(
        splats: &mut Splats2d,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &Workspace<Buffers2d>,
    ) {
        let statistics = workspace.tiles.settings.effects.statistics;
        adam::step(splats, bias, rates, level, statistics, |index| workspace.gradient_of(index));
    }

    fn check_solve_colors(settings: &RenderSettings) -> Result<(), Error> {
        match settings.effects.blend {
            Blend::Sum => Ok(()),
            Blend::Over => Err(unsupported("solving for colours under `over`, where the image is not linear in them")),
        }
    }

    fn solve_colors(
        workspace: &mut Workspace<Buffers2d>,
        splats: &mut Splats2d,
        target: &Target,
        level: Level,
        iterations: u32,
    ) -> Result<(), Error> {
        solve_colors::solve(workspace, splats, target, level, iterations)
    }
}
