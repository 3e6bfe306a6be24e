//! The backends of this build, and the only place where one is chosen at run time. Everything else is generic over the
//! rasterizer: a command hands over a [`Task`], and the chosen backend runs it.

mod contenders;
mod fastest;
mod team;
mod threads;

use pollster::FutureExt as _;
use std::env::consts;

use clap::{Args, Parser, ValueEnum, builder::NonEmptyStringValueParser};
use gs_core::{
    Canvas, Error, Optimizer, Parameterization, Rasterizer, RenderSettings, Scene2d, Scene3d, profile::Profiler,
};
use gs_cpu::{CpuRasterizer, CpuSettings, CpuTuning, SimdLevel};
use gs_lab::study::Machine;
use gs_wgpu::{AdapterSummary, Kernels, WgpuRasterizer, WgpuSettings};

pub(crate) use self::{
    contenders::contenders,
    team::{Team, TeamTask},
};
use crate::{
    backend::{fastest::Fastest, threads::Threads},
    chosen_machine::ChosenMachine,
    failure::Failure,
    values::whole,
};

/// Which backend to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum Choice {
    /// The GPU if this machine has one, the processor otherwise
    #[default]
    Auto,
    /// The processor: all its cores and the widest of its SIMD levels
    Cpu,
    /// Any GPU through Vulkan, Metal or DirectX 12, or a driver that stands in for one
    Wgpu,
}

/// The flags by which a backend is chosen; every command that rasterises has them.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Machine")]
pub(crate) struct BackendArgs {
    /// What computes
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: Choice,
    /// The GPU, by a part of its name, for the wgpu backend; gs info --adapters lists them [default: the fastest kind]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub(crate) adapter: Option<String>,
    /// Number of threads [default: RAYON_NUM_THREADS, or one for each core that this program may use]; the result does not depend
    /// on it
    #[arg(long, value_name = "T", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// SIMD level of the cpu backend: scalar, sse4.2, avx2, avx512 or native [default: the fastest of this machine]
    #[arg(long, value_name = "LEVEL")]
    pub(crate) simd: Option<String>,
    /// How the cpu backend goes about its work; from a file of settings alone.
    #[arg(skip)]
    pub(crate) tuning: CpuTuning,
    /// How the wgpu backend's kernels are written; from a file of settings alone.
    #[arg(skip)]
    pub(crate) kernels: Option<Kernels>,
}

/// A backend that is ready to compute, and why it is this one.
pub(crate) struct Backend {
    rasterizer: AnyRasterizer,
    /// Short name, for summaries: "cpu" or "wgpu".
    pub(crate) name: &'static str,
    /// The GPU, or the driver that stands in for one.
    pub(crate) adapter: Option<String>,
    /// Threads on the host.
    pub(crate) threads: usize,
    /// SIMD level, where the host computes.
    pub(crate) simd: Option<String>,
    /// What was chosen and why, one line.
    pub(crate) reason: String,
}

enum AnyRasterizer {
    Cpu(Box<CpuRasterizer>),
    Wgpu(Box<WgpuRasterizer>),
}

/// Work that any backend can do. What needs of it 2D scenes alone says so in its own `run`.
pub(crate) trait Task {
    /// What comes of it.
    type Output;

    /// Does it on this rasterizer.
    fn run<R: Profiler<Scene2d> + Optimizer<Scene3d>>(self, rasterizer: &R) -> Self::Output;
}

/// Work that any rasterizer of 3D scenes can do.
pub(crate) trait Task3d {
    /// What comes of it.
    type Output;

    /// Does it on this rasterizer.
    fn run<R: Profiler<Scene3d>>(self, rasterizer: &R) -> Self::Output;
}

/// What the flags come to when they are taken together.
#[derive(Debug, PartialEq, Eq)]
enum Wanted<'a> {
    Fastest,
    Cpu { why: &'static str },
    Wgpu { adapter: Option<&'a str>, why: &'static str },
}

impl Backend {
    /// Starts the backend that the flags ask for.
    ///
    /// # Errors
    /// Bad usage where flags contradict each other, the machine has no such SIMD level or adapter, or cannot start so many
    /// threads; a failure where there is no adapter at all, or it gives no device.
    pub(crate) fn start(args: &BackendArgs) -> Result<Self, Failure> {
        Self::start_suited(args, wanted(args)?, |_| Ok(()))
    }

    /// Starts the backend that the flags ask for. Where they leave it open, a GPU that cannot show scenes of images in this way is not taken.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub(crate) fn start_for_image(args: &BackendArgs, render: &RenderSettings) -> Result<Self, Failure> {
        Self::start_suited(args, wanted(args)?, |gpu| shows_images(gpu, render))
    }

    /// Starts one of the backends that are compared, the processor or wgpu, whether the flags ask for it or for all.
    ///
    /// # Errors
    /// As [`Self::start`].
    fn start_compared(args: &BackendArgs, one: Choice) -> Result<Self, Failure> {
        let compared = "to be compared";
        let wanted = match wanted(args)? {
            Wanted::Fastest if one == Choice::Cpu => Wanted::Cpu { why: compared },
            Wanted::Fastest => Wanted::Wgpu { adapter: None, why: compared },
            asked => asked,
        };
        Self::start_suited(args, wanted, |_| Ok(()))
    }

    /// The same for training in 3D in this parameterization: where the flags leave open what computes, a GPU that does not offer the parameterization is passed by.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub(crate) fn start_in_space(args: &BackendArgs, parameterization: Parameterization) -> Result<Self, Failure> {
        Self::start_suited(args, wanted(args)?, |gpu| gpu.upload(&Scene3d::default(), parameterization).map(drop))
    }

    /// A GPU of which `suits` is an error is passed by, unless it was asked for.
    fn start_suited(
        args: &BackendArgs,
        wanted: Wanted<'_>,
        suits: impl FnOnce(&WgpuRasterizer) -> Result<(), Error>,
    ) -> Result<Self, Failure> {
        let threads = Threads::of(args.threads)?;
        let backend = match wanted {
            Wanted::Cpu { why } => Self::cpu(args.simd.as_deref(), args.tuning, &threads, why),
            Wanted::Wgpu { adapter, why } => Ok(Self::wgpu(named(adapter, args.kernels)?, &threads, why)),
            Wanted::Fastest => match fastest::find(suits) {
                Fastest::Gpu(gpu) => Ok(Self::wgpu(*gpu, &threads, "a GPU was found")),
                Fastest::Cpu { why } => Self::cpu(None, args.tuning, &threads, &why),
            },
        }?;
        // Seeding between steps runs on rayon's global threads, whatever the backend. That they are as many is a matter of manners,
        // not of results; a process starts a backend only once, so there is nothing to fail but a second start.
        let _already_built = rayon::ThreadPoolBuilder::new().num_threads(threads.count).build_global();
        Ok(backend)
    }

    fn cpu(simd: Option<&str>, tuning: CpuTuning, threads: &Threads, why: &str) -> Result<Self, Failure> {
        let (level, why_level) = simd_level(simd)?;
        let settings = CpuSettings { threads: Some(threads.count), level: Some(level) };
        let rasterizer = CpuRasterizer::new(settings)?.with_tuning(tuning)?;
        let what = gs_core::Backend::describe(&rasterizer);
        Ok(Self {
            reason: format!("{what}: {why}, {why_level}, {}", threads.why),
            rasterizer: AnyRasterizer::Cpu(Box::new(rasterizer)),
            name: "cpu",
            adapter: None,
            threads: threads.count,
            simd: Some(level.to_string()),
        })
    }

    fn wgpu(rasterizer: WgpuRasterizer, threads: &Threads, why: &str) -> Self {
        let what = gs_core::Backend::describe(&rasterizer);
        Self {
            reason: format!("{what}: {why}, {}, {} for seeding", rasterizer.reason(), threads.why),
            name: "wgpu",
            adapter: Some(rasterizer.adapter().name.clone()),
            rasterizer: AnyRasterizer::Wgpu(Box::new(rasterizer)),
            threads: threads.count,
            simd: None,
        }
    }

    /// Does the task on the chosen backend.
    pub(crate) fn run_3d<T: Task3d>(&self, task: T) -> T::Output {
        match &self.rasterizer {
            AnyRasterizer::Cpu(rasterizer) => task.run(rasterizer.as_ref()),
            AnyRasterizer::Wgpu(rasterizer) => task.run(rasterizer.as_ref()),
        }
    }

    /// Does the task on the chosen backend.
    pub(crate) fn run<T: Task>(&self, task: T) -> T::Output {
        match &self.rasterizer {
            AnyRasterizer::Cpu(rasterizer) => task.run(rasterizer.as_ref()),
            AnyRasterizer::Wgpu(rasterizer) => task.run(rasterizer.as_ref()),
        }
    }
}

/// Does a task on the processor, whatever backend was chosen: for what not every backend can do.
///
/// # Errors
/// Where the processor cannot be started.
pub(crate) fn run_on_processor<T: Task>(chosen: &Backend, task: T) -> Result<T::Output, Failure> {
    match &chosen.rasterizer {
        AnyRasterizer::Cpu(rasterizer) => Ok(task.run(rasterizer.as_ref())),
        AnyRasterizer::Wgpu(_) => {
            let settings = CpuSettings { threads: Some(chosen.threads), ..CpuSettings::default() };
            Ok(task.run(&CpuRasterizer::new(settings)?))
        }
    }
}

/// What computes, as far as results depend on it, and the flags that choose it: not its threads.
pub(crate) fn machine(backend: &Backend) -> Machine {
    // Functions such as exp are the system's.
    let system = format!("{} {}", consts::OS, consts::ARCH);
    let (name, flags) = match &backend.rasterizer {
        AnyRasterizer::Cpu(cpu) => {
            let level = cpu.simd_level().to_string();
            (format!("cpu {level}, {system}"), ["--backend", "cpu", "--simd", &level].map(str::to_owned))
        }
        AnyRasterizer::Wgpu(gpu) => {
            let AdapterSummary { name, interface, driver, .. } = gpu.adapter();
            let kernels = format!("{:?}", gpu.kernels()).to_lowercase();
            let words = format!("wgpu {name}, {interface}, {driver}, {kernels} kernels, {system}");
            (words, ["--backend", "wgpu", "--adapter", name].map(str::to_owned))
        }
    };
    Machine { name, flags: flags.to_vec() }
}

/// Flags that were recorded, to be understood again.
#[derive(Debug, Parser)]
struct Recorded {
    #[command(flatten)]
    backend: BackendArgs,
}

impl Recorded {
    /// Fails where they are no flags of this version.
    fn of(flags: &[String]) -> Result<BackendArgs, clap::Error> {
        let words = std::iter::once("gs").chain(flags.iter().map(String::as_str));
        Self::try_parse_from(words).map(|recorded| recorded.backend)
    }
}

impl BackendArgs {
    /// The same where they say what computes; where they leave it open, what was recorded. Threads are those of these flags.
    pub(crate) fn or_recorded(&self, machine: &Machine) -> Self {
        match Recorded::of(&machine.flags) {
            Ok(recorded) if self.is_open() => Self { threads: self.threads, ..recorded },
            _ => self.clone(),
        }
    }

    /// Whether they leave open what computes.
    fn is_open(&self) -> bool {
        self.backend == Choice::Auto && self.adapter.is_none() && self.simd.is_none()
    }

    /// The same where they say what computes; where they leave it open, what a file of settings has chosen, if there is one. How that machine is
    /// made to work best says nothing of another.
    pub(crate) fn or_chosen(&self, chosen: Option<&ChosenMachine>) -> Self {
        let Some(ChosenMachine { flags, cpu, kernels }) = chosen.filter(|_| self.is_open()) else {
            return self.clone();
        };
        match Recorded::of(flags) {
            Ok(recorded) => Self {
                threads: self.threads.or(recorded.threads),
                tuning: cpu.unwrap_or_default(),
                kernels: kernels.map(Into::into),
                ..recorded
            },
            Err(_) => self.clone(),
        }
    }
}

/// Checks flags of a file of settings, which nobody has parsed.
///
/// # Errors
/// Bad usage where they are no flags of this version, or contradict each other.
pub(crate) fn check_flags(flags: &[String]) -> Result<(), Failure> {
    let refused = |why: String| Failure::usage(format_args!("machine.flags {flags:?}: {why}"));
    let first_line = |error: clap::Error| {
        let text = error.render().to_string();
        let line = text.lines().next().unwrap_or_default();
        refused(line.strip_prefix("error: ").unwrap_or("are not those that choose a backend").to_owned())
    };
    wanted(&Recorded::of(flags).map_err(first_line)?).map(drop).map_err(|failure| refused(failure.message().to_owned()))
}

/// An adapter names its backend, and so does a SIMD level; both may not.
fn wanted(args: &BackendArgs) -> Result<Wanted<'_>, Failure> {
    let BackendArgs { backend, adapter, simd, .. } = args;
    match (backend, adapter.as_deref(), simd.as_deref()) {
        (Choice::Cpu, Some(name), _) => Err(Failure::usage(format_args!(
            "--adapter {name} is for --backend wgpu, but --backend cpu is given: leave out one of the two"
        ))),
        (Choice::Wgpu, _, Some(level)) => Err(Failure::usage(format_args!(
            "--simd {level} is for --backend cpu, but --backend wgpu is given: leave out one of the two"
        ))),
        (Choice::Auto, Some(name), Some(level)) => Err(Failure::usage(format_args!(
            "--simd {level} is for --backend cpu, and --adapter {name} for --backend wgpu: leave out one of the two"
        ))),
        (Choice::Auto, None, None) => Ok(Wanted::Fastest),
        (Choice::Auto, None, Some(_)) => Ok(Wanted::Cpu { why: "as --simd asks" }),
        (Choice::Cpu, None, _) => Ok(Wanted::Cpu { why: "as asked" }),
        (Choice::Wgpu, adapter, None) | (Choice::Auto, adapter @ Some(_), None) => {
            Ok(Wanted::Wgpu { adapter, why: "as asked" })
        }
    }
}

/// Fails where the GPU cannot show the scenes of images in this way.
fn shows_images(gpu: &WgpuRasterizer, render: &RenderSettings) -> Result<(), Error> {
    gpu.for_2d().render(&Scene2d::default(), &Canvas::new(1, 1), render).block_on().map(drop)
}

/// The adapter of that name, or the first.
fn named(adapter: Option<&str>, kernels: Option<Kernels>) -> Result<WgpuRasterizer, Failure> {
    let settings = WgpuSettings { adapter: adapter.map(str::to_owned), kernels, ..WgpuSettings::default() };
    let error = match WgpuRasterizer::new(settings).block_on() {
        Ok(rasterizer) => return Ok(rasterizer),
        Err(error) => Failure::from(error),
    };
    let Some(name) = adapter else { return Err(error) };
    // A name that nothing has is bad usage, like a SIMD level that the machine has not; all else is the machine's failure.
    let found: Vec<String> = gs_wgpu::adapters().block_on().into_iter().map(|found| found.name).collect();
    let matches = |found: &String| found.to_lowercase().contains(&name.to_lowercase());
    if found.is_empty() || found.iter().any(matches) {
        return Err(error);
    }
    let message = format!("--adapter {name}: no adapter has this in its name: choose from {}", found.join(", "));
    Err(Failure::usage(message))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn args(backend: Choice, adapter: Option<&str>, simd: Option<&str>) -> BackendArgs {
        let owned = |text: Option<&str>| text.map(str::to_owned);
        BackendArgs { backend, adapter: owned(adapter), simd: owned(simd), ..BackendArgs::default() }
    }

    #[test]
    fn what_flags_leave_open_is_as_it_was_recorded() {
        let recorded = Machine {
            name: "cpu scalar".to_owned(),
            flags: ["--backend", "cpu", "--simd", "scalar"].map(str::to_owned).to_vec(),
        };
        let open = BackendArgs { threads: Some(3), ..BackendArgs::default() };
        let found = open.or_recorded(&recorded);
        assert_eq!((found.backend, found.simd.as_deref(), found.threads), (Choice::Cpu, Some("scalar"), Some(3)));
        let said = args(Choice::Auto, None, Some("avx2")).or_recorded(&recorded);
        assert_eq!((said.backend, said.simd.as_deref()), (Choice::Auto, Some("avx2")));
        let unknown = Machine { flags: vec!["--abacus".to_owned()], ..recorded };
        assert_eq!(open.or_recorded(&unknown).backend, Choice::Auto);
    }

    #[test]
    fn how_a_chosen_machine_works_best_is_for_it_alone() {
        let flags = ["--backend", "cpu", "--simd", "scalar", "--threads", "2"].map(str::to_owned).to_vec();
        let cpu = CpuTuning { tile_rows: Some(16), ..CpuTuning::default() };
        let chosen = ChosenMachine { flags, cpu: Some(cpu), kernels: None };
        let open = BackendArgs::default().or_chosen(Some(&chosen));
        assert_eq!((open.simd.as_deref(), open.threads, open.tuning), (Some("scalar"), Some(2), cpu));
        let said = args(Choice::Cpu, None, None).or_chosen(Some(&chosen));
        assert_eq!((said.simd.as_deref(), said.threads, said.tuning), (None, None, CpuTuning::default()));
        let none = BackendArgs::default().or_chosen(None);
        assert_eq!((none.backend, none.tuning), (Choice::Auto, CpuTuning::default()));
    }

    #[test]
    fn nobody_asked_for_the_backends_that_are_compared() {
        for one in [Choice::Cpu, Choice::Wgpu] {
            let reason = Backend::start_compared(&BackendArgs::default(), one).unwrap().reason;
            assert!(reason.contains("to be compared") && !reason.contains("as asked"), "{reason}");
            let asked = Backend::start_compared(&args(one, None, None), one).unwrap().reason;
            assert!(asked.contains("as asked"), "{asked}");
        }
    }

    #[test]
    fn every_combination_of_flags_is_a_choice_or_a_contradiction() {
        use Choice::{Auto, Cpu, Wgpu};
        let (adapter, level) = (Some("llvm"), Some("scalar"));
        for (flags, expected) in [
            ((Auto, None, None), Wanted::Fastest),
            ((Auto, None, level), Wanted::Cpu { why: "as --simd asks" }),
            ((Auto, adapter, None), Wanted::Wgpu { adapter, why: "as asked" }),
            ((Cpu, None, None), Wanted::Cpu { why: "as asked" }),
            ((Cpu, None, level), Wanted::Cpu { why: "as asked" }),
            ((Wgpu, None, None), Wanted::Wgpu { adapter: None, why: "as asked" }),
            ((Wgpu, adapter, None), Wanted::Wgpu { adapter, why: "as asked" }),
        ] {
            assert_eq!(wanted(&args(flags.0, flags.1, flags.2)).unwrap(), expected, "{flags:?}");
        }
        for flags in [
            (Auto, adapter, level),
            (Cpu, adapter, None),
            (Cpu, adapter, level),
            (Wgpu, None, level),
            (Wgpu, adapter, level),
        ] {
            let refusal = wanted(&args(flags.0, flags.1, flags.2)).unwrap_err();
            let line = refusal.line().unwrap();
            assert!(line.ends_with("leave out one of the two"), "{flags:?}: {line}");
            assert_eq!(refusal.status(), std::process::ExitCode::from(2));
        }
    }
}
