//! The trait's implementation: checks what comes in, and runs the stages inside the rasterizer's own threads.

use std::{fmt, sync::PoisonError};

use fearless_simd::Level;
use gs_core::{
    AdamRates, Binning, Chart, CloudState, DensityStatistics, EditPlan, Error, Image, Loss, PlanarScene, Rasterizer,
    RenderSettings, SpatialScene, TrainStep, counted, effects::Outputs, profile::Profiler, settings::Cut,
    statistics::Culled,
};

use crate::{
    PlanarCloud, PlanarFrame, PlanarGradients, SimdLevel, SpatialCloud, SpatialFrame, SpatialGradients, Target,
    kind::{Kind, Resources},
    loss,
    tiles::Tiles,
    tuning::CpuTuning,
    workspace::{Frame, Gradients},
};

/// The backend's name in errors.
pub(crate) const BACKEND: &str = "cpu";

/// How a [`CpuRasterizer`] runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CpuSettings {
    /// Threads; `None`: as many as the machine offers.
    pub threads: Option<usize>,
    /// Instruction set; `None`: the fastest this machine has.
    pub level: Option<SimdLevel>,
}

/// The CPU backend: owns its threads, and the buffers that its frames use in turn.
pub struct CpuRasterizer {
    pub(crate) threads: rayon::ThreadPool,
    simd: SimdLevel,
    pub(crate) level: Level,
    pub(crate) tuning: CpuTuning,
    pub(crate) planar: Resources<PlanarScene>,
    pub(crate) spatial: Resources<SpatialScene>,
}

impl CpuRasterizer {
    /// A rasterizer with threads of its own.
    ///
    /// # Errors
    /// [`Error::Setting`] for 0 threads or a SIMD level that this machine lacks, [`Error::Backend`] where threads cannot be
    /// started.
    pub fn new(settings: CpuSettings) -> Result<Self, Error> {
        if settings.threads == Some(0) {
            return Err(Error::setting("threads", 0, "at least 1"));
        }
        let simd = settings.level.unwrap_or_else(SimdLevel::best);
        let Some(level) = simd.token() else {
            return Err(Error::setting("SIMD level", simd, "one that this machine has; see `SimdLevel::available`"));
        };
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(settings.threads.unwrap_or(0))
            .thread_name(|i| format!("gs-cpu-{i}"))
            .build()
            .map_err(|e| Error::Backend { backend: BACKEND, message: format!("threads cannot be started: {e}") })?;
        Ok(Self {
            threads,
            simd,
            level,
            tuning: CpuTuning::default(),
            planar: Resources::default(),
            spatial: Resources::default(),
        })
    }

    /// The same rasterizer, going about its work in another way.
    ///
    /// # Errors
    /// [`Error::Setting`] where a number of the tuning is outside its range.
    pub fn with_tuning(self, tuning: CpuTuning) -> Result<Self, Error> {
        tuning.validate()?;
        Ok(Self { tuning, ..self })
    }

    /// How it goes about its work.
    pub fn tuning(&self) -> CpuTuning {
        self.tuning
    }

    /// This rasterizer for planar scenes alone, where the types of the arguments do not say which kind of scene is meant.
    pub fn planar(
        &self,
    ) -> &impl Profiler<PlanarScene, Cloud = PlanarCloud, Frame = PlanarFrame, Gradients = PlanarGradients, Target = Target>
    {
        self
    }

    /// This rasterizer for spatial scenes alone, as [`Self::planar`].
    pub fn spatial(
        &self,
    ) -> &impl Profiler<
        SpatialScene,
        Cloud = SpatialCloud,
        Frame = SpatialFrame,
        Gradients = SpatialGradients,
        Target = Target,
    > {
        self
    }

    /// Threads in use.
    pub fn threads(&self) -> usize {
        self.threads.current_num_threads()
    }

    /// Instruction set in use.
    pub fn simd_level(&self) -> SimdLevel {
        self.simd
    }
}

impl fmt::Debug for CpuRasterizer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CpuRasterizer").field("threads", &self.threads()).field("simd", &self.simd).finish()
    }
}

/// An error for an effect that this backend does not offer.
pub(crate) fn unsupported(effect: impl Into<String>) -> Error {
    Error::Unsupported { backend: BACKEND, effect: effect.into() }
}

/// Fails where a setting is not possible for any kind of scene.
pub(crate) fn check_settings(settings: &RenderSettings) -> Result<(), Error> {
    settings.validate()?;
    if settings.effects.outputs != Outputs::Color {
        return Err(unsupported(format!("outputs {:?}", settings.effects.outputs)));
    }
    if settings.accuracy.cut != Cut::Hard {
        return Err(unsupported("a smooth cut, which would touch every pixel"));
    }
    Ok(())
}

impl<S: Kind> Rasterizer<S> for CpuRasterizer {
    type Cloud = S::Cloud;
    type Frame = Frame<S>;
    type Gradients = Gradients<S>;
    type Target = Target;

    fn describe(&self) -> String {
        format!("cpu ({}, {})", self.simd, counted(self.threads(), "thread"))
    }

    fn upload(&self, scene: &S, chart: Chart) -> Result<S::Cloud, Error> {
        S::upload(scene, chart)
    }

    fn download(&self, cloud: &S::Cloud) -> Result<S, Error> {
        Ok(S::download(cloud))
    }

    fn len(&self, cloud: &S::Cloud) -> usize {
        S::shared(cloud).len()
    }

    fn upload_target(&self, image: &Image) -> Result<Target, Error> {
        image.check_finite("the target")?;
        Target::new(image)
    }

    fn save(&self, cloud: &S::Cloud) -> Result<CloudState, Error> {
        Ok(S::save(cloud))
    }

    fn restore(&self, state: &CloudState) -> Result<S::Cloud, Error> {
        S::restore(state)
    }

    fn forward(&self, cloud: &S::Cloud, view: &S::View, settings: &RenderSettings) -> Result<Frame<S>, Error> {
        S::check(view, settings)?;
        let pool = &S::resources(self).pool;
        let mut workspace = pool.take().tuned(self.tuning);
        self.threads.install(|| {
            S::prepare(&mut workspace, cloud, view, settings, Binning::Fresh)?;
            workspace.tiles.blend(self.level)
        })?;
        Ok(Frame::new(workspace, pool))
    }

    fn image(&self, frame: &Frame<S>) -> Result<Image, Error> {
        frame.image()
    }

    fn draw(&self, cloud: &S::Cloud, view: &S::View, settings: &RenderSettings) -> Result<(Image, Culled), Error> {
        S::check(view, settings)?;
        let pool = &S::resources(self).pool;
        let mut workspace = pool.take().tuned(self.tuning);
        let image = self.threads.install(|| {
            S::prepare(&mut workspace, cloud, view, settings, Binning::Fresh)?;
            workspace.tiles.draw(self.level)
        })?;
        let culled = workspace.tiles.culled();
        pool.give(workspace);
        Ok((image, culled))
    }

    fn culled(&self, frame: &Frame<S>) -> Result<Culled, Error> {
        Ok(frame.workspace().tiles.culled())
    }

    fn backward(
        &self,
        cloud: &S::Cloud,
        mut frame: Frame<S>,
        target: &Target,
        loss: &Loss,
    ) -> Result<(f32, Gradients<S>), Error> {
        loss.validate()?;
        let workspace = frame.workspace_mut();
        target.check_size(workspace.tiles.grid.size())?;
        if workspace.edition != Some(S::shared(cloud).edition) {
            return Err(Error::State("the frame is of another cloud, or of this one before an edit".to_owned()));
        }
        let value = self.threads.install(|| {
            let value = loss::loss(&mut workspace.tiles, target, loss, self.level)?;
            workspace.tiles.blend_bwd(self.level)?;
            S::project_bwd(workspace, cloud, 1.0);
            Ok::<f64, Error>(value)
        })?;
        Ok((value as f32, frame.into_gradients()))
    }

    fn download_gradients(&self, cloud: &S::Cloud, gradients: &Gradients<S>) -> Result<S, Error> {
        check_len::<S>(gradients, cloud)?;
        Ok(S::derivatives(gradients.workspace(), cloud))
    }

    fn step(&self, cloud: &mut S::Cloud, gradients: &Gradients<S>, rates: &AdamRates) -> Result<(), Error> {
        check_len::<S>(gradients, cloud)?;
        rates.validate()?;
        S::check_rates(rates)?;
        let mut bias = S::resources(self).bias.lock().unwrap_or_else(PoisonError::into_inner);
        let bias = &mut *bias;
        self.threads.install(|| S::adam(cloud, bias, rates, self.level, gradients.workspace()));
        Ok(())
    }

    fn train_step(
        &self,
        cloud: &mut S::Cloud,
        view: &S::View,
        target: &Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        S::check(view, step.settings)?;
        step.rates.validate()?;
        S::check_rates(step.rates)?;
        step.loss.validate()?;
        target.check_size(S::size(view))?;
        let Resources { pool, bias } = S::resources(self);
        let workspace = S::shared_mut(cloud).workspace.take().unwrap_or_else(|| pool.take());
        let mut workspace = workspace.tuned(self.tuning);
        let mut bias = bias.lock().unwrap_or_else(PoisonError::into_inner);
        let bias = &mut *bias;
        let value = self.threads.install(|| {
            S::prepare(&mut workspace, cloud, view, step.settings, step.binning)?;
            let tiles = &mut workspace.tiles;
            let (value, scale) = if Tiles::is_fused(&step.settings.effects, step.loss) {
                let count = 3.0 * tiles.grid.width as f64 * tiles.grid.height as f64;
                (tiles.blend_l2_fused(self.level, &target.rows)? / count, (2.0 / count) as f32)
            } else {
                tiles.blend(self.level)?;
                let value = loss::loss(tiles, target, &step.loss, self.level)?;
                tiles.blend_bwd(self.level)?;
                (value, 1.0)
            };
            S::project_bwd(&mut workspace, cloud, scale);
            S::adam(cloud, bias, step.rates, self.level, &workspace);
            Ok::<f64, Error>(value)
        })?;
        let shared = S::shared_mut(cloud);
        shared.workspace = Some(workspace);
        shared.losses.push(value as f32);
        Ok(())
    }

    fn unread_losses<'c>(&self, cloud: &'c mut S::Cloud) -> &'c mut Vec<f32> {
        &mut S::shared_mut(cloud).losses
    }

    fn solve_colors(
        &self,
        cloud: &mut S::Cloud,
        view: &S::View,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        S::check(view, settings)?;
        target.check_size(S::size(view))?;
        S::solve_colors(self, cloud, view, target, settings, iterations)
    }

    fn statistics(&self, cloud: &S::Cloud) -> Result<DensityStatistics, Error> {
        Ok(S::shared(cloud).statistics.clone())
    }

    fn shift_means(&self, cloud: &mut S::Cloud, shifts: &[f32]) -> Result<(), Error> {
        S::shift_means(cloud, shifts)
    }

    fn edit(&self, cloud: &mut S::Cloud, plan: &EditPlan<S::Gaussian>) -> Result<(), Error> {
        S::edit(cloud, plan)
    }
}

/// Fails unless the gradients are of as many Gaussians as the cloud has.
fn check_len<S: Kind>(gradients: &Gradients<S>, cloud: &S::Cloud) -> Result<(), Error> {
    let (found, expected) = (gradients.workspace().len, S::shared(cloud).len());
    if found == expected {
        return Ok(());
    }
    Err(Error::State(format!("gradients of {found} Gaussians do not fit a cloud of {expected}")))
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Adam, Blend, Canvas, Participants, PlanarGaussian, Scene, Wait};

    use super::*;
    use crate::workspace::Workspace;

    #[test]
    #[cfg_attr(miri, ignore = "minutes: thousands of pixels, blended again and again")]
    fn too_many_tile_entries_are_an_error_and_leave_the_cloud_as_it_was() {
        let rasterizer = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let cpu = rasterizer.planar();
        let gaussian = PlanarGaussian {
            mean: Vec2::splat(20.0),
            log_scale: Vec2::splat(2.0),
            rotation: 0.0,
            opacity_logit: f32::INFINITY,
            color: Vec3::splat(0.5),
        };
        let scene: PlanarScene = [gaussian; 4].into_iter().collect();
        let (view, settings) = (Canvas::new(40, 40), RenderSettings::blended(Blend::Sum));
        let target = cpu.upload_target(&Image::filled(40, 40, [0.3; 3]).unwrap()).unwrap();
        let rates = Adam::default().at(0.0);
        let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Reuse };
        // Four Gaussians in three strips each: twelve entries.
        let next_takes = |most_entries: u32| {
            let mut workspace = Workspace::<PlanarScene>::default();
            workspace.tiles.bins.most_entries = most_entries;
            rasterizer.planar.pool.give(workspace);
        };
        let refused = |result: Result<(), Error>| {
            let message = result.unwrap_err().to_string();
            assert!(message.contains("12 pairs") && message.contains("at most 11"), "{message}");
        };

        let mut cloud = cpu.upload(&scene, Chart::default()).unwrap();
        let before = cpu.save(&cloud).unwrap();
        next_takes(11);
        refused(cpu.forward(&cloud, &view, &settings).map(drop));
        next_takes(11);
        refused(cpu.solve_colors(&mut cloud, &view, &target, &settings, 1));
        next_takes(11);
        refused(cpu.train_step(&mut cloud, &view, &target, &step));
        assert_eq!(cpu.save(&cloud).unwrap(), before);

        let mut fresh = cpu.upload(&scene, Chart::default()).unwrap();
        let [mut found, mut expected] = [Vec::new(), Vec::new()];
        for (cloud, losses) in [(&mut cloud, &mut found), (&mut fresh, &mut expected)] {
            next_takes(12);
            cpu.train_step(cloud, &view, &target, &step).unwrap();
            cpu.losses(cloud, Wait::All, losses).unwrap();
        }
        assert_eq!((found.len(), &found), (1, &expected), "what was refused has no loss");
        assert_eq!(cpu.save(&cloud).unwrap(), cpu.save(&fresh).unwrap());
    }

    #[test]
    #[cfg_attr(miri, ignore = "minutes: images of 1024 px")]
    fn those_out_of_view_take_part_only_if_all_do() {
        let rasterizer = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let cpu = rasterizer.planar();
        let at = |x: f32| PlanarGaussian {
            mean: Vec2::new(x, 9.0),
            log_scale: Vec2::splat(1.0),
            rotation: 0.3,
            opacity_logit: 0.5,
            color: Vec3::splat(0.5),
        };
        let scene: PlanarScene = [at(8.0), at(900.0)].into_iter().collect();
        let target = cpu.upload_target(&Image::filled(16, 16, [0.2; 3]).unwrap()).unwrap();
        let settings = RenderSettings::blended(Blend::Over);
        for (participants, steps) in [(Participants::All, [2, 2]), (Participants::Visible, [2, 1])] {
            let mut cloud = cpu.upload(&scene, Chart::default()).unwrap();
            // In view of the first step, and with moments from then on.
            let wide = Canvas::new(1024, 16);
            let wide_target = cpu.upload_target(&Image::filled(1024, 16, [0.2; 3]).unwrap()).unwrap();
            let rates = Adam { participants, ..Adam::default() }.at(0.0);
            let step = TrainStep { settings: &settings, loss: Loss::L1, rates: &rates, binning: Binning::Fresh };
            cpu.train_step(&mut cloud, &wide, &wide_target, &step).unwrap();
            let before = cpu.download(&cloud).unwrap();
            cpu.train_step(&mut cloud, &Canvas::new(16, 16), &target, &step).unwrap();
            let after = cpu.download(&cloud).unwrap();
            assert_eq!(cpu.save(&cloud).unwrap().integers("steps").unwrap(), steps);
            assert_ne!(after.gaussian(0), before.gaussian(0));
            assert_eq!(after.gaussian(1) == before.gaussian(1), participants == Participants::Visible);
        }
    }
}
