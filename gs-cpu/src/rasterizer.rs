//! The trait's implementation: checks what comes in, and runs the stages inside the rasterizer's own threads.

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use fearless_simd::Level;
use gs_core::{
    AdamRates, Binning, Blend, Canvas, Chart, CloudState, DensityStatistics, EditPlan, Error, Image, Loss,
    PlanarGaussian, PlanarScene, Rasterizer, RenderSettings, TrainStep,
    effects::{Antialias, Order, Outputs},
    settings::Cut,
    statistics::Culled,
};

use crate::{
    PlanarCloud, PlanarFrame, PlanarGradients, PlanarTarget, SimdLevel,
    adam::{self, BiasTable},
    loss, project_bwd, solve_colors,
    workspace::{Pool, Workspace},
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
    pub(crate) pool: Arc<Pool>,
    bias: Mutex<BiasTable>,
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
        Ok(Self { threads, simd, level, pool: Arc::default(), bias: Mutex::default() })
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

pub(crate) fn check(view: &Canvas, settings: &RenderSettings) -> Result<(), Error> {
    view.validate()?;
    settings.validate()?;
    let effects = &settings.effects;
    let unsupported = |effect: String| Err(Error::Unsupported { backend: BACKEND, effect });
    if effects.order != Order::Index {
        return unsupported(format!("order {:?} of a planar scene, which has no depth", effects.order));
    }
    if effects.antialias != Antialias::None {
        return unsupported(format!("antialias {:?} of a planar scene", effects.antialias));
    }
    if effects.outputs != Outputs::Color {
        return unsupported(format!("outputs {:?} of a planar scene", effects.outputs));
    }
    if settings.accuracy.cut != Cut::Hard {
        return unsupported("a smooth cut, which would touch every pixel".to_owned());
    }
    Ok(())
}

impl Rasterizer<PlanarScene> for CpuRasterizer {
    type Cloud = PlanarCloud;
    type Frame = PlanarFrame;
    type Gradients = PlanarGradients;
    type Target = PlanarTarget;

    fn describe(&self) -> String {
        let threads = self.threads();
        format!("cpu ({}, {threads} {})", self.simd, if threads == 1 { "thread" } else { "threads" })
    }

    fn upload(&self, scene: &PlanarScene, chart: Chart) -> Result<PlanarCloud, Error> {
        PlanarCloud::new(scene, chart)
    }

    fn download(&self, cloud: &PlanarCloud) -> Result<PlanarScene, Error> {
        Ok(cloud.scene())
    }

    fn len(&self, cloud: &PlanarCloud) -> usize {
        cloud.len()
    }

    fn upload_target(&self, image: &Image) -> Result<PlanarTarget, Error> {
        Ok(PlanarTarget::new(image))
    }

    fn save(&self, cloud: &PlanarCloud) -> Result<CloudState, Error> {
        Ok(cloud.save())
    }

    fn restore(&self, state: &CloudState) -> Result<PlanarCloud, Error> {
        PlanarCloud::restore(state)
    }

    fn forward(&self, cloud: &PlanarCloud, view: &Canvas, settings: &RenderSettings) -> Result<PlanarFrame, Error> {
        check(view, settings)?;
        let mut workspace = self.pool.take();
        self.threads.install(|| {
            workspace.prepare(cloud, view, settings, Binning::Fresh)?;
            workspace.blend(self.level);
            Ok::<(), Error>(())
        })?;
        Ok(PlanarFrame { workspace: Some(workspace), pool: Arc::clone(&self.pool) })
    }

    fn image(&self, frame: &PlanarFrame) -> Result<Image, Error> {
        Ok(frame.image())
    }

    fn culled(&self, frame: &PlanarFrame) -> Result<Culled, Error> {
        Ok(frame.workspace().culled)
    }

    fn backward(
        &self,
        cloud: &PlanarCloud,
        mut frame: PlanarFrame,
        target: &PlanarTarget,
        loss: &Loss,
    ) -> Result<(f32, PlanarGradients), Error> {
        loss.validate()?;
        let workspace = frame.workspace.as_mut().expect("a frame has its workspace until it is dropped");
        target.check_size(workspace.canvas.width, workspace.canvas.height)?;
        if workspace.edition != Some(cloud.edition) {
            return Err(Error::State("the frame is of another cloud, or of this one before an edit".to_owned()));
        }
        let value = self.threads.install(|| {
            let value = loss::loss(workspace, target, loss, self.level);
            workspace.blend_bwd(self.level);
            workspace.project_bwd(cloud, 1.0);
            value
        });
        let gradients = PlanarGradients {
            gradients: (0..cloud.len()).map(|index| *workspace.gradient_of(index)).collect(),
            statistics: workspace.settings.effects.statistics,
        };
        Ok((value as f32, gradients))
    }

    fn download_gradients(&self, cloud: &PlanarCloud, gradients: &PlanarGradients) -> Result<PlanarScene, Error> {
        gradients.check_len(cloud)?;
        Ok(project_bwd::as_scene(cloud, gradients))
    }

    fn step(&self, cloud: &mut PlanarCloud, gradients: &PlanarGradients, rates: &AdamRates) -> Result<(), Error> {
        gradients.check_len(cloud)?;
        let mut bias = self.bias.lock().unwrap_or_else(PoisonError::into_inner);
        let bias = &mut *bias;
        let gradient_of = |index: usize| &gradients.gradients[index];
        self.threads.install(|| adam::step(cloud, bias, rates, self.level, gradients.statistics, gradient_of));
        Ok(())
    }

    fn train_step(
        &self,
        cloud: &mut PlanarCloud,
        view: &Canvas,
        target: &PlanarTarget,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        check(view, step.settings)?;
        step.loss.validate()?;
        target.check_size(view.width, view.height)?;
        let mut workspace = cloud.workspace.take().unwrap_or_else(|| self.pool.take());
        let mut bias = self.bias.lock().unwrap_or_else(PoisonError::into_inner);
        let bias = &mut *bias;
        let value = self.threads.install(|| {
            workspace.prepare(cloud, view, step.settings, step.binning)?;
            let (value, scale) = if Workspace::is_fused(&step.settings.effects, step.loss) {
                let count = 3.0 * f64::from(view.width) * f64::from(view.height);
                (workspace.blend_l2_fused(self.level, &target.rows) / count, (2.0 / count) as f32)
            } else {
                workspace.blend(self.level);
                let value = loss::loss(&mut workspace, target, &step.loss, self.level);
                workspace.blend_bwd(self.level);
                (value, 1.0)
            };
            workspace.project_bwd(cloud, scale);
            let statistics = step.settings.effects.statistics;
            adam::step(cloud, bias, step.rates, self.level, statistics, |index| workspace.gradient_of(index));
            Ok::<f64, Error>(value)
        })?;
        cloud.workspace = Some(workspace);
        cloud.losses.push(value as f32);
        Ok(())
    }

    fn unread_losses<'c>(&self, cloud: &'c mut PlanarCloud) -> &'c mut Vec<f32> {
        &mut cloud.losses
    }

    fn solve_colors(
        &self,
        cloud: &mut PlanarCloud,
        view: &Canvas,
        target: &PlanarTarget,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        check(view, settings)?;
        target.check_size(view.width, view.height)?;
        if settings.effects.blend != Blend::Sum {
            return Err(Error::Unsupported {
                backend: BACKEND,
                effect: "solving for colours under `over`, where the image is not linear in them".to_owned(),
            });
        }
        let mut workspace = self.pool.take();
        self.threads.install(|| {
            workspace.prepare(cloud, view, settings, Binning::Fresh)?;
            solve_colors::solve(&mut workspace, cloud, target, self.level, iterations);
            Ok::<(), Error>(())
        })?;
        self.pool.give(workspace);
        Ok(())
    }

    fn statistics(&self, cloud: &PlanarCloud) -> Result<DensityStatistics, Error> {
        Ok(cloud.statistics.clone())
    }

    fn shift_means(&self, cloud: &mut PlanarCloud, shifts: &[f32]) -> Result<(), Error> {
        let expected = 2 * cloud.len();
        if shifts.len() != expected {
            return Err(Error::Length { what: "mean", expected, found: shifts.len() });
        }
        for (mean, &[x, y]) in cloud.means.iter_mut().zip(shifts.as_chunks::<2>().0) {
            mean.x += x;
            mean.y += y;
        }
        Ok(())
    }

    fn edit(&self, cloud: &mut PlanarCloud, plan: &EditPlan<PlanarGaussian>) -> Result<(), Error> {
        cloud.edit(plan)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Adam, Participants, Scene, Wait};

    use super::*;

    #[test]
    fn too_many_tile_entries_are_an_error_and_leave_the_cloud_as_it_was() {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
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
            let mut workspace = Workspace::default();
            workspace.bins.most_entries = most_entries;
            cpu.pool.give(workspace);
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

        next_takes(12);
        let mut fresh = cpu.upload(&scene, Chart::default()).unwrap();
        let [mut found, mut expected] = [Vec::new(), Vec::new()];
        for (cloud, losses) in [(&mut cloud, &mut found), (&mut fresh, &mut expected)] {
            cpu.train_step(cloud, &view, &target, &step).unwrap();
            cpu.losses(cloud, Wait::All, losses).unwrap();
        }
        assert_eq!((found.len(), &found), (1, &expected), "what was refused has no loss");
        assert_eq!(cpu.save(&cloud).unwrap(), cpu.save(&fresh).unwrap());
    }

    #[test]
    fn those_out_of_view_take_part_only_if_all_do() {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
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
