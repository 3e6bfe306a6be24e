//! Splats on the device: the parts that 2D and 3D scenes share. These are statistics, pending
//! training steps, edits, saving and restoring.

use std::sync::{Mutex, PoisonError};

use gs_core::{
    DensityStatistics, EditPlan, Error, Parameterization, SplatsState, Wait, check_len,
    edit::{AfterEdit, Moments as Heritage, Source as From},
    logit,
};

use crate::{
    dispatch::Commands,
    gpu::{Gpu, STORAGE, UNIFORM},
    in_flight::{Home, Taken},
    kind::{Kind, State as _},
    layout::{Source, Statistics, Step},
};

/// Gaussians on a device, with their Adam moments and density statistics.
#[derive(Debug)]
pub struct Splats<S: Kind> {
    pub(crate) len: usize,
    pub(crate) state: S::State,
    pub(crate) statistics: wgpu::Buffer,
    /// Pending training steps. Methods with `&self` wait for them, too, hence the mutex.
    pub(crate) in_flight: Mutex<Home<S>>,
    /// A number that is unique to these splats since their last edit. It identifies invalid lists.
    pub(crate) version: u64,
}

/// An edit that the host has uploaded, for [`State::edit`] to apply to parameters and moments.
#[derive(Debug)]
pub struct Edit<'a, G> {
    /// Number of Gaussians after the edit.
    pub(crate) len: usize,
    pub(crate) step: wgpu::Buffer,
    /// One [`Source`] per Gaussian after the edit.
    pub(crate) sources: wgpu::Buffer,
    /// New and changed Gaussians, to which sources refer as fresh.
    pub(crate) fresh: Vec<&'a G>,
    /// Statistics before and after the edit.
    pub(crate) statistics: [&'a wgpu::Buffer; 2],
}

impl<S: Kind> Splats<S> {
    pub(crate) fn new(gpu: &Gpu, scene: &S, parameterization: Parameterization) -> Result<Self, Error> {
        let state = S::State::new(gpu, scene, parameterization)?;
        Self::from_parts(gpu, state, &vec![Statistics::default(); scene.len()])
    }

    fn from_parts(gpu: &Gpu, state: S::State, statistics: &[Statistics]) -> Result<Self, Error> {
        Ok(Self {
            len: statistics.len(),
            state,
            statistics: gpu.storage("statistics", statistics)?,
            in_flight: Mutex::default(),
            version: next_version(),
        })
    }

    /// Number of pending training steps, at most [`STEPS_IN_FLIGHT`](crate::STEPS_IN_FLIGHT).
    ///
    /// 0 while another future waits for them.
    pub fn steps_in_flight(&self) -> usize {
        self.in_flight.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    pub(crate) async fn in_flight(&self) -> Taken<'_, S> {
        Taken::from(&self.in_flight).await
    }

    /// Waits until all pending steps are done. Every access to the splats' buffers begins with
    /// this.
    pub(crate) async fn settle(&self, gpu: &Gpu) -> Result<(), Error> {
        self.in_flight().await.settle(gpu, self, Wait::All).await
    }

    pub(crate) async fn density_statistics(&self, gpu: &Gpu) -> Result<DensityStatistics, Error> {
        let statistics: Vec<Statistics> = gpu.read(&self.statistics, self.len).await?;
        Ok(DensityStatistics {
            signal_sum: statistics.iter().map(|s| s.signal_sum).collect(),
            visible: statistics.iter().map(|s| s.visible).collect(),
        })
    }

    /// Uploads the sources of all slots and the new Gaussians. The device rebuilds the arrays.
    pub(crate) async fn edit(&mut self, gpu: &Gpu, plan: &EditPlan<S::Gaussian>) -> Result<(), Error> {
        let sources = plan.sources(self.len)?;
        S::prepare(gpu, self, None).await?;
        let changed = plan.changed.iter().map(|c| &c.gaussian);
        let fresh: Vec<&S::Gaussian> = changed.chain(plan.added.iter().map(|b| &b.gaussian)).collect();
        let records: Vec<Source> = sources.iter().map(|source| record(plan, source)).collect();
        let n = records.len();
        let ceiling = plan.opacity_ceiling.filter(|_| self.state.has_opacity_with(&fresh));
        let step = Step {
            gaussians: n as u32,
            coefficients: self.state.coefficients() as u32,
            collect: u32::from(ceiling.is_some()),
            alpha_max: ceiling.map_or(f32::INFINITY, logit),
            fixed: plan.fixed,
            ..Step::default()
        };
        let uniform = gpu.allocate("step", size_of::<Step>() as u64, UNIFORM)?;
        gpu.write(&uniform, bytemuck::bytes_of(&step));
        let statistics = gpu.allocate("statistics", (n * size_of::<Statistics>()) as u64, STORAGE)?;
        let edit = Edit {
            len: n,
            step: uniform,
            sources: gpu.storage("edits", &records)?,
            fresh,
            statistics: [&self.statistics, &statistics],
        };
        let mut commands = Commands::new(gpu);
        let state = self.state.edit(gpu, &mut commands, &edit)?;
        commands.submit(gpu);
        gpu.check()?;
        (self.len, self.state, self.statistics, self.version) = (n, state, statistics, next_version());
        Ok(())
    }

    pub(crate) async fn save(&self, gpu: &Gpu) -> Result<SplatsState, Error> {
        let mut state = self.state.save(gpu, self.len).await?;
        let statistics = self.density_statistics(gpu).await?;
        state.insert("gradient_sum", statistics.signal_sum.iter().map(|&g| [g]));
        state.insert_u32("visible", statistics.visible);
        Ok(state)
    }

    pub(crate) fn restore(gpu: &Gpu, state: &SplatsState) -> Result<Self, Error> {
        let n = state.integers("steps")?.len();
        let (sums, visible) = (state.rows::<1>("gradient_sum")?, state.integers("visible")?);
        check_len("gradient_sum", n, sums.len())?;
        check_len("visible", n, visible.len())?;
        let statistics: Vec<Statistics> =
            sums.iter().zip(&visible).map(|(&[signal_sum], &visible)| Statistics { signal_sum, visible }).collect();
        Self::from_parts(gpu, S::State::restore(gpu, state, n)?, &statistics)
    }
}

/// The source of one slot of the edited arrays.
fn record<G>(plan: &EditPlan<G>, source: &From) -> Source {
    let (parameters, is_fresh, statistics) = match *source {
        From::Kept(i) => (i, 0, Some(i)),
        From::Changed { before, change } => (change, 1, Some(before)),
        From::Added(k) => (plan.changed.len() as u32 + k, 1, plan.added[k as usize].parent),
    };
    let or_none = |index: Option<u32>| index.unwrap_or(Source::NONE);
    Source {
        parameters,
        moments: or_none(plan.origin(source, Heritage::heir_of)),
        steps: or_none(plan.origin(source, Heritage::counts_on_from)),
        statistics: or_none(statistics.filter(|_| plan.statistics == AfterEdit::Keep)),
        is_fresh,
    }
}

fn next_version() -> u64 {
    use std::sync::atomic::{AtomicU64, Ordering};
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}
