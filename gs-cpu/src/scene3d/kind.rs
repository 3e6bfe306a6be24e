//! 3D scenes as a [`Kind`]: their own buffers, and the order of depth in which tiles see their Gaussians.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use fearless_simd::Level;
use gs_core::{
    AdamRates, Binning, Blend, Camera, EditPlan, Error, Gaussian3d, MeanNoise, Parameterization, RenderSettings,
    Scene3d, SplatsState,
    effects::Order,
    perspective::{Ellipsoid, Perspective},
};
use rayon::prelude::*;

use super::{
    Splats3d, adam,
    depth_sort::DepthSort,
    project::{self, Depth, Eye},
    project_bwd,
    splats::pitch_of,
};
use crate::{
    CpuRasterizer, Target,
    bias::BiasTable,
    blend_per_pixel::PixelDepth,
    kind::{Resources, SceneKind, Shared},
    profile::Stage,
    rasterizer::{check_settings, unsupported},
    splat::{CHUNK, Splat},
    workspace::Workspace,
};

/// The place of a Gaussian that is not drawn.
pub(crate) const NO_PLACE: u32 = u32::MAX;

/// A 3D scene's own buffers.
#[derive(Debug, Default)]
pub struct Own3d {
    pub(crate) eye: Option<Eye>,
    /// By index; of those that are not drawn, anything.
    pub(crate) projected: Vec<Splat>,
    /// By index.
    pub(crate) depths: Vec<Depth>,
    pub(crate) depth_sort: DepthSort,
    /// Gaussian → place, or [`NO_PLACE`].
    pub(crate) place_of: Vec<AtomicU32>,
    /// By index, each row the beginning of one of the splats' parameters, up to the harmonics that are evaluated; of those that no tile lists,
    /// anything.
    pub(crate) gradients: Vec<f32>,
    /// This step's shares of the statistic that is asked for, by index; of those that no tile lists, anything.
    pub(crate) shares: Vec<f32>,
}

impl Own3d {
    /// Numbers of a row of gradients: what stands behind them in a row of parameters is not moved.
    pub(crate) fn gradient_pitch(&self) -> usize {
        pitch_of(self.eye.map_or(0, |eye| eye.degree))
    }

    /// The gradient of a Gaussian that some tile lists.
    #[inline(always)]
    pub(crate) fn gradient(&self, index: usize) -> &[f32] {
        let pitch = self.gradient_pitch();
        &self.gradients[index * pitch..][..pitch]
    }
}

impl Workspace<Scene3d> {
    /// Whether some tile lists Gaussian `index`.
    #[inline(always)]
    pub(crate) fn lists(&self, index: usize) -> bool {
        let place = self.own.place_of[index].load(Relaxed);
        place != NO_PLACE && !self.tiles.bins.slots_of(place as usize).is_empty()
    }
}

impl SceneKind for Scene3d {
    type Splats = Splats3d;
    type Own = Own3d;
    type Bias = BiasTable<{ adam::GROUPS }>;

    const BEFORE_BIN: [Stage; 2] = [Stage::Project, Stage::Sort];

    fn check(camera: &Camera, settings: &RenderSettings) -> Result<(), Error> {
        camera.validate()?;
        check_settings(settings)?;
        Ok(())
    }

    fn check_rates(_: &AdamRates) -> Result<(), Error> {
        Ok(())
    }

    fn size(camera: &Camera) -> (u32, u32) {
        (camera.width, camera.height)
    }

    fn resources(rasterizer: &CpuRasterizer) -> &Resources<Self> {
        &rasterizer.pool_3d
    }

    fn upload(scene: &Self, parameterization: Parameterization) -> Result<Splats3d, Error> {
        Splats3d::new(scene, parameterization)
    }

    fn download(splats: &Splats3d) -> Self {
        splats.scene()
    }

    fn save(splats: &Splats3d) -> SplatsState {
        splats.save()
    }

    fn restore(state: &SplatsState) -> Result<Splats3d, Error> {
        Splats3d::restore(state)
    }

    fn edit(splats: &mut Splats3d, plan: &EditPlan<Gaussian3d>) -> Result<(), Error> {
        splats.edit(plan)
    }

    fn add_noise(splats: &mut Splats3d, noise: &MeanNoise) {
        splats.add_noise(noise);
    }

    fn shared(splats: &Splats3d) -> &Shared<Self> {
        &splats.shared
    }

    fn shared_mut(splats: &mut Splats3d) -> &mut Shared<Self> {
        &mut splats.shared
    }

    /// Lists are never used again: the next step looks through another camera.
    fn prepare(
        workspace: &mut Workspace<Self>,
        splats: &Splats3d,
        camera: &Camera,
        settings: &RenderSettings,
        _: Binning,
    ) -> Result<(), Error> {
        workspace.edition = None;
        workspace.len = splats.len();
        workspace.tiles.set(Self::size(camera), settings);
        let degree = settings.effects.sh_degree.min(splats.sh_degree);
        workspace.own.eye = Some(Eye {
            perspective: Perspective::new(camera, settings),
            degree,
            parameterization: splats.parameterization,
        });
        Self::project(workspace, splats);
        Self::sort(workspace, splats);
        workspace.tiles.bin()?;
        workspace.edition = Some(splats.shared.edition);
        workspace.tiles.fit();
        Ok(())
    }

    fn project(workspace: &mut Workspace<Self>, splats: &Splats3d) {
        let Workspace { tiles, own, .. } = workspace;
        let Some(eye) = &own.eye else { return };
        let (projected, depths) = (&mut own.projected, &mut own.depths);
        tiles.culled = project::project_all(splats, eye, tiles, projected, depths);
    }

    fn sort(workspace: &mut Workspace<Self>, _: &Splats3d) {
        let Workspace { tiles, own, .. } = workspace;
        let Own3d { projected, depths, depth_sort, place_of, .. } = own;
        let blend = tiles.settings.effects.blend;
        let order = tiles.settings.effects.order;
        let depth = |index: usize| depths[index][0];
        match (blend, order) {
            (Blend::Sum, _) | (Blend::Over, Order::Index) => depth_sort.collect(&depth, depths.len()),
            (Blend::Over, Order::Global | Order::PerPixel) => depth_sort.sort(depth, depths.len()),
        }
        place_of.resize_with(depths.len(), AtomicU32::default);
        place_of.par_iter().with_min_len(CHUNK).for_each(|place| place.store(NO_PLACE, Relaxed));
        tiles.projected.resize(depth_sort.len(), Splat::CULLED);
        tiles.projected.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, ordered)| {
            for (i, splat) in ordered.iter_mut().enumerate() {
                let place = chunk * CHUNK + i;
                let index = depth_sort.at(place) as usize;
                *splat = projected[index];
                place_of[index].store(place as u32, Relaxed);
            }
        });
        tiles.depths.clear();
        if (blend, order) == (Blend::Over, Order::PerPixel) {
            let at = |place| {
                let index = depth_sort.at(place);
                let [depth, x, y] = depths[index as usize];
                PixelDepth { depth, slope: [x, y], index }
            };
            tiles.depths.par_extend((0..depth_sort.len()).into_par_iter().map(at));
        }
    }

    fn project_bwd(workspace: &mut Workspace<Self>, splats: &Splats3d, scale: f32) {
        project_bwd::all(&workspace.tiles, &mut workspace.own, splats, scale);
    }

    fn derivatives(workspace: &Workspace<Self>, splats: &Splats3d) -> Self {
        let zeros = vec![0.0; splats.pitch()];
        let row = |index: usize| match workspace.lists(index) {
            true => {
                let row = workspace.own.gradient(index);
                (splats.seen_gradient(index, row), row)
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
        workspace: &Workspace<Self>,
    ) {
        adam::step(splats, bias, rates, level, workspace);
    }

    fn solve_colors(
        _: &CpuRasterizer,
        _: &mut Splats3d,
        _: &Camera,
        _: &Target,
        _: &RenderSettings,
        _: u32,
    ) -> Result<(), Error> {
        Err(unsupported("solving for the colours of 3D scenes"))
    }
}
