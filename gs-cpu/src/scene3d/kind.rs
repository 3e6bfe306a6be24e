//! [`Kind`] for 3D scenes, and the order of depth in which tiles see their Gaussians.

use gs_core::{
    AdamRates, Binning, Blend, Camera, CameraGradient, Error, Output, RenderSettings, Scene3d, effects::Order,
    math::perspective::Ellipsoid,
};

use super::{
    adam,
    buffers::Buffers3d,
    project::{self, Eye},
    project_bwd::{self, Backward},
    splats::{Splats3d, ellipsoid},
};
use crate::{
    bias::BiasTable,
    kind::{AllResources, Kind, Resources},
    level::Level,
    stage::Stage,
    unsupported::BACKEND,
    workspace::Workspace,
};

impl Kind for Scene3d {
    type Splats = Splats3d;
    type Buffers = Buffers3d;
    type Bias = BiasTable<{ adam::GROUPS }>;

    const BEFORE_BIN: [Stage; 2] = [Stage::Project, Stage::Sort];
    const REUSES_LISTS: bool = false;
    const AFTER_BLEND: &'static [Stage] = &[Stage::ProjectBwd, Stage::Adam, Stage::Update];

    fn check(camera: &Camera, settings: &RenderSettings) -> Result<(), Error> {
        camera.validate()?;
        settings.check_for(BACKEND)
    }

    fn size(camera: &Camera) -> (u32, u32) {
        (camera.width, camera.height)
    }

    fn resources(all: &AllResources) -> &Resources<Self> {
        &all.for_3d
    }

    /// `Binning::Reuse` has no effect, because the next step has another camera.
    fn prepare(
        workspace: &mut Workspace<Buffers3d>,
        splats: &Splats3d,
        camera: &Camera,
        settings: &RenderSettings,
        _: Binning,
        level: Level,
    ) -> Result<(), Error> {
        workspace.version = None;
        workspace.len = splats.len();
        workspace.tiles.set(Self::size(camera), settings);
        let degree = match settings.output {
            Output::Color => settings.effects.sh_degree.min(splats.sh_degree),
            Output::InverseDepth | Output::Alpha => 0,
        };
        workspace.buffers.eye = Some(Eye::new(camera, settings, degree));
        workspace.buffers.camera_gradient = None;
        Self::project(workspace, splats, level);
        Self::sort(workspace, splats);
        Self::bin(workspace, level)?;
        workspace.version = Some(splats.shared.version);
        workspace.tiles.fit();
        Ok(())
    }

    fn project(workspace: &mut Workspace<Buffers3d>, splats: &Splats3d, level: Level) {
        let Workspace { tiles, buffers, .. } = workspace;
        let Some(eye) = &buffers.eye else { return };
        project::project_all(splats, eye, tiles, level);
    }

    fn bin(workspace: &mut Workspace<Buffers3d>, level: Level) -> Result<(), Error> {
        let Workspace { tiles, buffers, .. } = workspace;
        tiles.bin(level, buffers.depth_sort.len(), |rank| buffers.depth_sort.at(rank) as usize)
    }

    fn sort(workspace: &mut Workspace<Buffers3d>, _: &Splats3d) {
        let Workspace { tiles, buffers, .. } = workspace;
        let depth_sort = &mut buffers.depth_sort;
        let depths = &tiles.depths;
        let blend = tiles.settings.effects.blend;
        let order = tiles.settings.effects.order;
        let depth = |index: usize| depths[index].depth;
        match (blend, order) {
            (Blend::Sum, _) | (Blend::Over, Order::Index) => depth_sort.collect(&depth, depths.len()),
            (Blend::Over, Order::Global | Order::PerPixel) => depth_sort.sort(depth, depths.len()),
        }
    }

    fn project_bwd(workspace: &mut Workspace<Buffers3d>, splats: &Splats3d, level: Level, scale: f32) {
        project_bwd::all(workspace, splats, level, scale);
    }

    fn derivatives(workspace: &Workspace<Buffers3d>, splats: &Splats3d) -> Self {
        let zeros = vec![0.0; splats.pitch()];
        let row = |index: usize| match workspace.tiles.lists(index) {
            true => {
                let row = workspace.buffers.gradient(index);
                (ellipsoid(row), row)
            }
            false => (Ellipsoid::default(), &zeros[..]),
        };
        splats.scene_of((0..splats.len()).map(row))
    }

    fn camera_gradient(workspace: &Workspace<Buffers3d>) -> Option<CameraGradient> {
        workspace.buffers.camera_gradient
    }

    /// Whole vectors of SH above the evaluated degree keep their values and moments, and cost nothing.
    fn adam(
        splats: &mut Splats3d,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &Workspace<Buffers3d>,
    ) {
        let Workspace { tiles, buffers, .. } = workspace;
        let (width, pitch) = (buffers.gradient_pitch(), splats.pitch());
        adam::step_along(splats, bias, rates, level, workspace, |(first, from), parameters, block| {
            let end = block.find(tiles, first, from..parameters.len() / pitch);
            for (lane, place) in block.members[..block.len].iter().enumerate() {
                block.rows[lane][..width].copy_from_slice(buffers.gradient(first + place));
                block.shares[lane] = buffers.shares[first + place];
            }
            end
        });
    }

    /// The gradients are never written to memory, and parameters are read once.
    fn update(
        splats: &mut Splats3d,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &mut Workspace<Buffers3d>,
        scale: f32,
    ) {
        let Some(backward) = Backward::new(workspace, splats, scale) else { return };
        let sum = adam::step_along(splats, bias, rates, level, workspace, |at, parameters, block| {
            backward.block(level, at, parameters, block)
        });
        workspace.set_camera_gradient(sum);
    }
}
