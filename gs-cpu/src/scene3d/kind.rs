//! [`Kind`] for 3D scenes, and the order of depth in which tiles see their Gaussians.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use gs_core::{
    AdamRates, Binning, Blend, Camera, Error, Output, RenderSettings, Scene3d,
    effects::Order,
    math::perspective::{Ellipsoid, Perspective},
};
use rayon::prelude::*;

use super::{
    adam,
    own::{NO_PLACE, Own3d},
    project::{self, Eye},
    project_bwd,
    splats::{Splats3d, ellipsoid},
};
use crate::{
    bias::BiasTable,
    kind::{AllResources, Kind, Resources},
    level::Level,
    splat::CHUNK,
    stage::Stage,
    unsupported::check_settings,
    workspace::Workspace,
};

impl Kind for Scene3d {
    type Splats = Splats3d;
    type Own = Own3d;
    type Bias = BiasTable<{ adam::GROUPS }>;

    const BEFORE_BIN: [Stage; 2] = [Stage::Project, Stage::Sort];
    const REUSES_LISTS: bool = false;
    const AFTER_BLEND: &'static [Stage] = &[Stage::ProjectBwd, Stage::Adam, Stage::Update];

    fn check(camera: &Camera, settings: &RenderSettings) -> Result<(), Error> {
        camera.validate()?;
        check_settings(settings)
    }

    fn size(camera: &Camera) -> (u32, u32) {
        (camera.width, camera.height)
    }

    fn resources(all: &AllResources) -> &Resources<Self> {
        &all.for_3d
    }

    /// `Binning::Reuse` has no effect, because the next step has another camera.
    fn prepare(
        workspace: &mut Workspace<Own3d>,
        splats: &Splats3d,
        camera: &Camera,
        settings: &RenderSettings,
        _: Binning,
    ) -> Result<(), Error> {
        workspace.edition = None;
        workspace.len = splats.len();
        workspace.tiles.set(Self::size(camera), settings);
        let degree = match settings.output {
            Output::Color => settings.effects.sh_degree.min(splats.sh_degree),
            Output::InverseDepth | Output::Alpha => 0,
        };
        workspace.own.eye =
            Some(Eye { perspective: Perspective::new(camera, settings), degree, output: settings.output });
        Self::project(workspace, splats);
        Self::sort(workspace, splats);
        Self::bin(workspace)?;
        workspace.edition = Some(splats.shared.edition);
        workspace.tiles.fit();
        Ok(())
    }

    fn project(workspace: &mut Workspace<Own3d>, splats: &Splats3d) {
        let Workspace { tiles, own, .. } = workspace;
        let Some(eye) = &own.eye else { return };
        project::project_all(splats, eye, tiles);
    }

    fn bin(workspace: &mut Workspace<Own3d>) -> Result<(), Error> {
        let Workspace { tiles, own, .. } = workspace;
        tiles.bin(own.depth_sort.len(), |place| own.depth_sort.at(place) as usize)
    }

    fn sort(workspace: &mut Workspace<Own3d>, _: &Splats3d) {
        let Workspace { tiles, own, .. } = workspace;
        let Own3d { depth_sort, place_of, .. } = own;
        let depths = &tiles.depths;
        let blend = tiles.settings.effects.blend;
        let order = tiles.settings.effects.order;
        let depth = |index: usize| depths[index].depth;
        match (blend, order) {
            (Blend::Sum, _) | (Blend::Over, Order::Index) => depth_sort.collect(&depth, depths.len()),
            (Blend::Over, Order::Global | Order::PerPixel) => depth_sort.sort(depth, depths.len()),
        }
        place_of.resize_with(depths.len(), AtomicU32::default);
        place_of.par_iter().with_min_len(CHUNK).for_each(|place| place.store(NO_PLACE, Relaxed));
        (0..depth_sort.len()).into_par_iter().with_min_len(CHUNK).for_each(|place| {
            place_of[depth_sort.at(place) as usize].store(place as u32, Relaxed);
        });
    }

    fn project_bwd(workspace: &mut Workspace<Own3d>, splats: &Splats3d, scale: f32) {
        project_bwd::all(workspace, splats, scale);
    }

    fn add_gradients(workspace: &mut Workspace<Own3d>, added: &Workspace<Own3d>, weight: f32) -> Result<(), Error> {
        project_bwd::add(workspace, added, weight);
        Ok(())
    }

    fn derivatives(workspace: &Workspace<Own3d>, splats: &Splats3d) -> Self {
        let zeros = vec![0.0; splats.pitch()];
        let row = |index: usize| match workspace.lists(index) {
            true => {
                let row = workspace.own.gradient(index);
                (ellipsoid(row), row)
            }
            false => (Ellipsoid::default(), &zeros[..]),
        };
        splats.scene_of((0..splats.len()).map(row))
    }

    fn adam(
        splats: &mut Splats3d,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &Workspace<Own3d>,
    ) {
        adam::step(splats, bias, rates, level, workspace);
    }
    fn update(
        splats: &mut Splats3d,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &mut Workspace<Own3d>,
        scale: f32,
    ) {
        adam::update(splats, bias, rates, level, workspace, scale);
    }
}
