//! Several rasterizers of one kind, for work that goes side by side.

use gs_core::{Optimizer, Scene2d};
use gs_lab::study::Machine;

use crate::{
    backend::{AnyRasterizer, Backend, BackendArgs, Threads, machine},
    failure::Failure,
};

/// Backends that are alike, each with its share of the threads. There is at least one.
pub(crate) struct Team(Vec<Backend>);

/// Work that several rasterizers do side by side.
pub(crate) trait TeamTask {
    /// What comes of it.
    type Output;

    /// Does it on these rasterizers, of which there is at least one.
    fn run<R: Optimizer<Scene2d> + Sync>(self, team: &[&R]) -> Self::Output;
}

impl Team {
    /// Starts `size` backends as the flags ask for; the threads, those asked for or one a core, are divided among them.
    ///
    /// # Errors
    /// As [`Backend::start`].
    pub(crate) fn start(args: &BackendArgs, size: usize) -> Result<Self, Failure> {
        let size = size.max(1);
        let threads = Threads::of(args.threads)?.count;
        // Seeding runs on rayon's global threads, which all of them share; whoever starts them first decides how many there are.
        let _already_built = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
        let share = u16::try_from((threads / size).max(1)).unwrap_or(u16::MAX);
        let args = BackendArgs { threads: if size == 1 { args.threads } else { Some(share) }, ..args.clone() };
        Ok(Self((0..size).map(|_| Backend::start(&args)).collect::<Result<_, _>>()?))
    }

    /// What was chosen and why, one line.
    pub(crate) fn reason(&self) -> &str {
        &self.0[0].reason
    }

    /// What computes, as far as results depend on it.
    pub(crate) fn machine(&self) -> Machine {
        machine(&self.0[0])
    }

    /// Does the task on all of them.
    pub(crate) fn run<T: TeamTask>(&self, task: T) -> T::Output {
        let (mut cpus, mut gpus) = (Vec::new(), Vec::new());
        for backend in &self.0 {
            match &backend.rasterizer {
                AnyRasterizer::Cpu(rasterizer) => cpus.push(rasterizer.as_ref()),
                AnyRasterizer::Wgpu(rasterizer) => gpus.push(rasterizer.as_ref()),
            }
        }
        if gpus.is_empty() { task.run(&cpus) } else { task.run(&gpus) }
    }
}
