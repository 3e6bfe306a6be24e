//! The implementation of the traits: checks the arguments and runs the stages on the rasterizer's
//! own threads.

#[cfg(test)]
mod tests;

use std::{fmt, sync::PoisonError};

use gs_core::{
    AdamRates, Backend, Binning, CameraGradient, Culled, DensityStatistics, EditPlan, Error, Image, Loss, MeanNoise,
    Optimizer, Parameterization, Rasterizer, RenderSettings, SavedState, SplatsState, TargetImage, TrainStep, Wait,
    check_same_size, counted,
};

use crate::{
    forward_pass::{ForwardPass, Gradients},
    kind::{AllResources, Kind, Resources, Splats as _},
    level::Level,
    level::SimdLevel,
    loss,
    target::Target,
    tiles::Tiles,
    unsupported::{BACKEND, unsupported},
    workspace::Workspace,
};

/// How a [`CpuRasterizer`] runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct CpuSettings {
    /// Number of threads; `None`: one for each core of the machine.
    pub threads: Option<usize>,
    /// Instruction set; `None`: the fastest that this machine has.
    pub level: Option<SimdLevel>,
}

gs_core::impl_with!(CpuSettings);

/// The CPU backend. It owns its threads and the buffers that its forward passes use in turn.
pub struct CpuRasterizer {
    /// `None` where no threads can be started, for example in a browser page. Passes then run on
    /// rayon's global pool: the calling thread, and those that the program has added to it.
    threads: Option<rayon::ThreadPool>,
    simd: SimdLevel,
    pub(crate) level: Level,
    pub(crate) resources: AllResources,
}

impl CpuRasterizer {
    /// A rasterizer with threads of its own.
    ///
    /// # Errors
    /// [`Error::Setting`] for 0 threads or a SIMD level that this machine lacks, [`Error::Backend`]
    /// where threads cannot be started.
    pub fn new(settings: CpuSettings) -> Result<Self, Error> {
        Error::within("threads", settings.threads.unwrap_or(1), 1.., "at least 1")?;
        let simd = settings.level.unwrap_or_else(SimdLevel::best);
        let Some(level) = simd.instructions() else {
            return Err(Error::setting("SIMD level", simd, "one that this machine has; see `SimdLevel::available`"));
        };
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(settings.threads.unwrap_or(0))
            .thread_name(|i| format!("gs-cpu-{i}"))
            .build();
        let threads = match threads {
            Ok(threads) => Some(threads),
            Err(_) if cfg!(target_family = "wasm") => None,
            Err(e) => {
                return Err(Error::Backend { backend: BACKEND, message: format!("threads cannot be started: {e}") });
            }
        };
        Ok(Self { threads, simd, level, resources: AllResources::default() })
    }

    /// Number of threads in use.
    pub fn threads(&self) -> usize {
        self.threads.as_ref().map_or_else(rayon::current_num_threads, rayon::ThreadPool::current_num_threads)
    }

    /// Runs work on this rasterizer's threads.
    pub(crate) fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.threads {
            Some(threads) => threads.install(work),
            None => work(),
        }
    }

    /// Instruction set in use.
    pub fn simd_level(&self) -> SimdLevel {
        self.simd
    }
}

gs_core::impl_for_kinds!(CpuRasterizer);

impl fmt::Debug for CpuRasterizer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CpuRasterizer").field("threads", &self.threads()).field("simd", &self.simd).finish()
    }
}

impl Backend for CpuRasterizer {
    fn describe(&self) -> String {
        format!("cpu ({}, {})", self.simd, counted(self.threads(), "thread"))
    }
}

/// Every future does its work when it is first polled, and is ready then.
impl<S: Kind> Rasterizer<S> for CpuRasterizer {
    type Splats = S::Splats;
    type ForwardPass = ForwardPass<S>;
    type Gradients = Gradients<S>;
    type Target = Target;

    fn upload(&self, scene: &S, parameterization: Parameterization) -> Result<S::Splats, Error> {
        S::Splats::new(scene, parameterization)
    }

    async fn forward(
        &self,
        splats: &S::Splats,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<ForwardPass<S>, Error> {
        S::check(view, settings)?;
        let pool = &S::resources(&self.resources).pool;
        let mut workspace = pool.take();
        self.install(|| {
            S::prepare(&mut workspace, splats, view, settings, Binning::Fresh, self.level)?;
            workspace.tiles.blend(self.level)
        })?;
        Ok(ForwardPass::new(workspace, pool))
    }

    async fn image(&self, pass: &ForwardPass<S>) -> Result<Image, Error> {
        pass.image()
    }

    fn culled(&self, pass: &ForwardPass<S>) -> Culled {
        pass.workspace().tiles.culled()
    }

    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Target, Error> {
        Target::new(&target.into())
    }

    async fn backward(
        &self,
        splats: &S::Splats,
        mut pass: ForwardPass<S>,
        target: &Target,
        loss: &Loss,
    ) -> Result<(f32, Gradients<S>), Error> {
        target.check_loss(*loss)?;
        let workspace = pass.workspace_mut();
        target.check_size(workspace.tiles.grid.size())?;
        check_version::<S>(workspace, splats)?;
        let value = self.install(|| {
            let value = loss::loss(&mut workspace.tiles, target, loss, self.level)?;
            workspace.tiles.blend_bwd(self.level)?;
            S::project_bwd(workspace, splats, self.level, 1.0);
            Ok::<f64, Error>(value)
        })?;
        Ok((value as f32, pass.into_gradients()))
    }

    async fn loss(
        &self,
        splats: &S::Splats,
        mut pass: ForwardPass<S>,
        target: &Target,
        loss: &Loss,
    ) -> Result<f32, Error> {
        target.check_loss(*loss)?;
        let workspace = pass.workspace_mut();
        target.check_size(workspace.tiles.grid.size())?;
        check_version::<S>(workspace, splats)?;
        Ok(self.install(|| loss::loss(&mut workspace.tiles, target, loss, self.level))? as f32)
    }

    async fn image_vjp(
        &self,
        splats: &S::Splats,
        mut pass: ForwardPass<S>,
        v_image: &Image,
    ) -> Result<Gradients<S>, Error> {
        let workspace = pass.workspace_mut();
        check_same_size(workspace.tiles.grid.size(), v_image.size())?;
        v_image.check_finite("the gradient of an image")?;
        check_version::<S>(workspace, splats)?;
        self.install(|| {
            loss::take(&mut workspace.tiles, v_image)?;
            workspace.tiles.blend_bwd(self.level)?;
            S::project_bwd(workspace, splats, self.level, 1.0);
            Ok::<(), Error>(())
        })?;
        Ok(pass.into_gradients())
    }

    async fn gradients(&self, splats: &S::Splats, gradients: &Gradients<S>) -> Result<S, Error> {
        check_len::<S>(gradients, splats)?;
        Ok(S::derivatives(gradients.workspace(), splats))
    }

    async fn camera_gradient(&self, gradients: &Gradients<S>) -> Result<CameraGradient, Error> {
        S::camera_gradient(gradients.workspace()).ok_or_else(CameraGradient::not_requested)
    }

    /// Also frees the buffers of passes, so that the scene does not add to them: a round of density
    /// control would else be the peak of a training's memory.
    async fn download(&self, splats: &S::Splats) -> Result<S, Error> {
        S::resources(&self.resources).pool.clear();
        Ok(splats.scene())
    }

    fn len(&self, splats: &S::Splats) -> usize {
        splats.shared().len()
    }

    async fn draw(
        &self,
        splats: &S::Splats,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<(Image, Culled), Error> {
        S::check(view, settings)?;
        let pool = &S::resources(&self.resources).pool;
        let mut workspace = pool.take();
        let image = self.install(|| {
            S::prepare(&mut workspace, splats, view, settings, Binning::Fresh, self.level)?;
            workspace.tiles.draw(self.level)
        })?;
        let culled = workspace.tiles.culled();
        pool.give(workspace);
        Ok((image, culled))
    }
}

impl<S: Kind> Optimizer<S> for CpuRasterizer {
    async fn train_step(
        &self,
        splats: &mut S::Splats,
        view: &S::View,
        target: &Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        S::check(view, step.settings)?;
        step.rates.validate()?;
        S::check_rates(step.rates)?;
        target.check_loss(step.loss)?;
        target.check_size(S::size(view))?;
        let Resources { pool, bias } = S::resources(&self.resources);
        let mut workspace = splats.shared_mut().workspace.take().unwrap_or_else(|| pool.take());
        let mut bias = bias.lock().unwrap_or_else(PoisonError::into_inner);
        let bias = &mut *bias;
        let value = self.install(|| {
            S::prepare(&mut workspace, splats, view, step.settings, step.binning, self.level)?;
            let tiles = &mut workspace.tiles;
            let (value, scale) = if target.is_complete() && Tiles::is_fused(&step.settings.effects, step.loss) {
                let count = 3.0 * tiles.grid.width as f64 * tiles.grid.height as f64;
                (tiles.blend_l2_fused(self.level, target)? / count, (2.0 / count) as f32)
            } else {
                tiles.blend(self.level)?;
                let value = loss::loss(tiles, target, &step.loss, self.level)?;
                tiles.blend_bwd(self.level)?;
                (value, 1.0)
            };
            S::update(splats, bias, step.rates, self.level, &mut workspace, scale);
            Ok::<f64, Error>(value)
        })?;
        let by_camera = S::camera_gradient(&workspace);
        let shared = splats.shared_mut();
        if S::REUSES_LISTS {
            shared.workspace = Some(workspace);
        } else {
            pool.give(workspace);
        }
        shared.losses.push(value as f32);
        shared.camera_gradients.extend(by_camera);
        Ok(())
    }

    async fn losses(&self, splats: &mut S::Splats, _: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        losses.append(&mut splats.shared_mut().losses);
        Ok(())
    }

    async fn camera_gradients(
        &self,
        splats: &mut S::Splats,
        _: Wait,
        gradients: &mut Vec<CameraGradient>,
    ) -> Result<(), Error> {
        gradients.append(&mut splats.shared_mut().camera_gradients);
        Ok(())
    }

    async fn step(&self, splats: &mut S::Splats, gradients: &Gradients<S>, rates: &AdamRates) -> Result<(), Error> {
        check_len::<S>(gradients, splats)?;
        rates.validate()?;
        S::check_rates(rates)?;
        let mut bias = S::resources(&self.resources).bias.lock().unwrap_or_else(PoisonError::into_inner);
        let bias = &mut *bias;
        self.install(|| S::adam(splats, bias, rates, self.level, gradients.workspace()));
        Ok(())
    }

    async fn statistics(&self, splats: &S::Splats) -> Result<DensityStatistics, Error> {
        Ok(splats.shared().statistics.clone())
    }

    async fn edit(&self, splats: &mut S::Splats, plan: &EditPlan<S::Gaussian>) -> Result<(), Error> {
        splats.edit(plan)
    }

    fn add_noise(&self, splats: &mut S::Splats, noise: &MeanNoise) -> Result<(), Error> {
        noise.validate()?;
        self.install(|| splats.add_noise(noise));
        Ok(())
    }

    async fn solve_colors(
        &self,
        splats: &mut S::Splats,
        view: &S::View,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        S::check(view, settings)?;
        target.check_size(S::size(view))?;
        if !target.is_complete() {
            return Err(unsupported("solving for the colours where the target has an alpha or a mask, or is compact"));
        }
        S::check_solve_colors(settings)?;
        let pool = &S::resources(&self.resources).pool;
        let mut workspace = pool.take();
        self.install(|| {
            S::prepare(&mut workspace, splats, view, settings, Binning::Fresh, self.level)?;
            S::solve_colors(&mut workspace, splats, target, self.level, iterations)
        })?;
        pool.give(workspace);
        Ok(())
    }

    async fn save(&self, splats: &S::Splats) -> Result<SplatsState, Error> {
        Ok(Optimizer::<S>::saved(self, splats).await?.collect())
    }

    /// Also frees the buffers of passes; see [`Self::download`].
    async fn saved<'s>(&self, splats: &'s S::Splats) -> Result<SavedState<'s>, Error> {
        S::resources(&self.resources).pool.clear();
        Ok(splats.saved())
    }

    fn restore(&self, state: &SplatsState) -> Result<S::Splats, Error> {
        S::Splats::restore(state)
    }
}

/// Fails unless the forward pass was made from these splats, as they are now.
fn check_version<S: Kind>(workspace: &Workspace<S::Buffers>, splats: &S::Splats) -> Result<(), Error> {
    if workspace.version == Some(splats.shared().version) {
        return Ok(());
    }
    Err(Error::State("the forward pass was made from other splats, or before an edit of these".to_owned()))
}

/// Fails unless the gradients belong to as many Gaussians as there are splats.
fn check_len<S: Kind>(gradients: &Gradients<S>, splats: &S::Splats) -> Result<(), Error> {
    let (found, expected) = (gradients.workspace().len, splats.shared().len());
    if found == expected {
        return Ok(());
    }
    Err(Error::State(format!("gradients of {found} Gaussians do not fit splats of {expected}")))
}
