//! The backends of this build, and the only place where one is chosen at run time. Everything else is generic over the
//! rasterizer: a command hands over a [`Task`], and the chosen backend runs it.

use std::{num::NonZero, thread::available_parallelism};

use clap::{Args, ValueEnum};
use gs_core::{PlanarScene, Rasterizer};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};

use crate::failure::Failure;

/// Which backend to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum Choice {
    /// The fastest that this build and this machine have.
    #[default]
    Auto,
    /// The processor: all its cores and the widest of its SIMD levels.
    Cpu,
}

/// The flags by which a backend is chosen; every command that rasterises has them.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct BackendArgs {
    /// What computes
    #[arg(long, value_enum, default_value_t, help_heading = "Machine")]
    pub(crate) backend: Choice,
    /// Number of threads [default: one for each core that this program may use]; the result does not depend on it
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024), help_heading = "Machine")]
    pub(crate) threads: Option<u16>,
    /// SIMD level: scalar, sse4.2, avx2, avx512 or native [default: the fastest of this machine]
    #[arg(long, value_name = "LEVEL", help_heading = "Machine")]
    pub(crate) simd: Option<String>,
}

/// A backend that is ready to compute, and why it is this one.
pub(crate) struct Backend {
    rasterizer: AnyRasterizer,
    /// Short name, for summaries: "cpu".
    pub(crate) name: &'static str,
    /// Threads on the host.
    pub(crate) threads: usize,
    /// SIMD level on the host.
    pub(crate) simd: String,
    /// What was chosen and why, one line.
    pub(crate) reason: String,
}

enum AnyRasterizer {
    Cpu(CpuRasterizer),
}

/// Work that any rasterizer of planar scenes can do.
pub(crate) trait Task {
    /// What comes of it.
    type Output;

    /// Does it on this rasterizer.
    fn run<R: Rasterizer<PlanarScene>>(self, rasterizer: &R) -> Self::Output;
}

impl Backend {
    /// Starts the backend that the flags ask for.
    ///
    /// # Errors
    /// Bad usage where the machine has no such SIMD level, or cannot start so many threads.
    pub(crate) fn start(args: &BackendArgs) -> Result<Self, Failure> {
        let why_backend = match args.backend {
            Choice::Auto => "the only backend of this build",
            Choice::Cpu => "as asked",
        };
        let (level, why_level) = simd_level(args.simd.as_deref())?;
        let (threads, why_threads) = match args.threads {
            Some(threads) => (usize::from(threads), "threads as asked"),
            None => (available_parallelism().map_or(1, NonZero::get), "one thread a core"),
        };
        let rasterizer = CpuRasterizer::new(CpuSettings { threads: Some(threads), level: Some(level) })?;
        // Seeding between steps runs on rayon's global threads. That they are as many is a matter of manners, not of results; there
        // is only one start of a backend per process, so there is nothing to fail but a second one.
        let _already_built = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
        let what = Rasterizer::<PlanarScene>::describe(&rasterizer);
        Ok(Self {
            reason: format!("{what}: {why_backend}, {why_level}, {why_threads}"),
            rasterizer: AnyRasterizer::Cpu(rasterizer),
            name: "cpu",
            threads,
            simd: level.to_string(),
        })
    }

    /// Does the task on the chosen backend.
    pub(crate) fn run<T: Task>(&self, task: T) -> T::Output {
        match &self.rasterizer {
            AnyRasterizer::Cpu(rasterizer) => task.run(rasterizer),
        }
    }
}

fn simd_level(asked: Option<&str>) -> Result<(SimdLevel, &'static str), Failure> {
    let Some(name) = asked else {
        return Ok((SimdLevel::best(), "the fastest SIMD level of this machine"));
    };
    let available = SimdLevel::available();
    match name.parse::<SimdLevel>() {
        Ok(level) if available.contains(&level) => Ok((level, "SIMD level as asked")),
        _ => {
            let names: Vec<String> = available.iter().map(ToString::to_string).collect();
            let message =
                format!("--simd {name}: this machine has no such SIMD level: choose from {}", names.join(", "));
            Err(Failure::usage(message))
        }
    }
}
