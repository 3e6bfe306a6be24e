//! The flags that choose a backend, and what they mean.

use clap::{Args, Parser, builder::NonEmptyStringValueParser};
use gs_backend::{AnyRasterizer, Chosen, FutureExt as _, Request, Wanted, can_render_2d, host_threads, open_for};
use gs_core::{Error, RenderSettings};
use gs_cpu::SimdLevel;
use gs_lab::study::Machine;
use gs_wgpu::WgpuSettings;

use super::values::{by_name, whole};
use crate::failure::Failure;

/// The flags of every command that computes.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Machine")]
pub(crate) struct BackendArgs {
    /// The backend that computes: the CPU, or a GPU through wgpu
    #[arg(long, value_parser = by_name::<Wanted>(), default_value_t)]
    pub(crate) backend: Wanted,
    /// The GPU, by a part of its name, for the wgpu backend; gs info --adapters lists them
    /// [default: the fastest kind]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub(crate) adapter: Option<String>,
    /// Number of threads; results do not depend on it [default: RAYON_NUM_THREADS, or one per core]
    #[arg(long, value_name = "T", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// SIMD level of the cpu backend: baseline, avx2 or avx512 [default: the fastest of this
    /// machine]
    #[arg(long, value_name = "LEVEL")]
    pub(crate) simd: Option<String>,
}

impl BackendArgs {
    /// Opens the backend.
    pub(crate) fn open(&self) -> Result<Chosen, Failure> {
        self.open_if(async |_: &AnyRasterizer| Ok(()))
    }

    /// Opens the backend. `--backend auto` does not use a GPU that cannot render 2D scenes with
    /// these settings.
    pub(crate) fn open_to_render_2d(&self, settings: &RenderSettings) -> Result<Chosen, Failure> {
        self.open_if(async move |gpu: &AnyRasterizer| can_render_2d(gpu, settings).await)
    }

    /// Opens one of the backends that are compared, the CPU or wgpu, whether the flags ask for it
    /// or for all.
    pub(crate) fn open_to_compare(&self, wanted: Wanted) -> Result<Chosen, Failure> {
        let mut request = self.request()?;
        if request.wanted == Wanted::Fastest {
            (request.wanted, request.why) = (wanted, Some("to be compared"));
        }
        opened(&request, async |_: &AnyRasterizer| Ok(()))
    }

    /// Opens `count` backends that are alike, at least one. The threads are divided among them.
    pub(crate) fn open_several(&self, count: usize) -> Result<Vec<Chosen>, Failure> {
        let mut request = self.request()?;
        let threads = host_threads(request.threads)?;
        use_threads(threads);
        if count > 1 {
            request.threads = Some((threads / count).max(1));
        }
        (0..count.max(1)).map(|_| opened(&request, async |_: &AnyRasterizer| Ok(()))).collect()
    }

    fn open_if(&self, suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>) -> Result<Chosen, Failure> {
        opened(&self.request()?, suits)
    }

    /// Returns these flags if they choose a backend; otherwise the recorded ones, with the threads
    /// of these flags.
    pub(crate) fn or_recorded(&self, machine: &Machine) -> Self {
        match Self::from_flags(&machine.flags) {
            Ok(recorded) if self.is_open() => Self { threads: self.threads, ..recorded },
            _ => self.clone(),
        }
    }

    /// Whether no flag chooses a backend.
    fn is_open(&self) -> bool {
        self.backend == Wanted::Fastest && self.adapter.is_none() && self.simd.is_none()
    }

    /// Parses flags that were recorded in a file.
    fn from_flags(flags: &[String]) -> Result<Self, clap::Error> {
        let words = std::iter::once("gs").chain(flags.iter().map(String::as_str));
        Recorded::try_parse_from(words).map(|recorded| recorded.backend)
    }

    /// The request that the flags stand for. `--adapter` implies the wgpu backend, and `--simd` the
    /// cpu backend.
    fn request(&self) -> Result<Request, Failure> {
        let Self { backend, adapter, simd, threads } = self;
        let (wanted, why) = match (backend, adapter.as_deref(), simd.as_deref()) {
            (Wanted::Cpu, Some(name), _) => {
                return Err(contradiction(&format!(
                    "--adapter {name} is for --backend wgpu, but --backend cpu is given"
                )));
            }
            (Wanted::Wgpu, _, Some(level)) => {
                return Err(contradiction(&format!(
                    "--simd {level} is for --backend cpu, but --backend wgpu is given"
                )));
            }
            (Wanted::Fastest, Some(name), Some(level)) => {
                return Err(contradiction(&format!(
                    "--simd {level} is for --backend cpu, and --adapter {name} for --backend wgpu"
                )));
            }
            (Wanted::Fastest, None, Some(_)) => (Wanted::Cpu, Some("as --simd asks")),
            (Wanted::Fastest, Some(_), None) => (Wanted::Wgpu, None),
            (wanted, ..) => (*wanted, None),
        };
        let wgpu = WgpuSettings::default().with(|s| s.adapter = adapter.clone());
        let level = simd.as_deref().map(simd_level).transpose()?;
        Ok(Request::default().with(|s| {
            s.wanted = wanted;
            s.why = why;
            s.threads = threads.map(usize::from);
            s.level = level;
            s.wgpu = wgpu;
        }))
    }
}

/// Recorded flags, to be parsed again.
#[derive(Debug, Parser)]
struct Recorded {
    #[command(flatten)]
    backend: BackendArgs,
}

fn contradiction(message: &str) -> Failure {
    Failure::usage(format_args!("{message}: leave out one of the two"))
}

fn simd_level(name: &str) -> Result<SimdLevel, Failure> {
    let available = SimdLevel::available();
    let level = available.iter().copied().find(|level| level.name() == name);
    level.ok_or_else(|| {
        let names: Vec<String> = available.iter().map(ToString::to_string).collect();
        Failure::usage(format_args!(
            "--simd {name}: this machine has no such SIMD level: choose from {}",
            names.join(", ")
        ))
    })
}

fn opened(request: &Request, suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>) -> Result<Chosen, Failure> {
    let chosen = open_for(request, suits).block_on().map_err(|error| explained(error, request))?;
    use_threads(chosen.threads);
    Ok(chosen)
}

/// Gives rayon's global pool this number of threads. Seeding between steps runs there, whatever the
/// backend.
fn use_threads(threads: usize) {
    // Results do not depend on it, so a pool that is already there may stay.
    let _already_built = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
}

/// The error of opening a backend. An adapter name that no adapter has is bad usage.
fn explained(error: Error, request: &Request) -> Failure {
    let Some(name) = request.wgpu.adapter.as_ref().filter(|_| request.wanted == Wanted::Wgpu) else {
        return error.into();
    };
    let found: Vec<String> = gs_wgpu::adapters().block_on().into_iter().map(|found| found.name).collect();
    if found.is_empty() || found.iter().any(|found| found.to_lowercase().contains(&name.to_lowercase())) {
        return error.into();
    }
    let message = format_args!("--adapter {name}: no adapter has this in its name: choose from {}", found.join(", "));
    Failure::usage(message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(backend: Wanted, adapter: Option<&str>, simd: Option<&str>) -> BackendArgs {
        let owned = |text: Option<&str>| text.map(str::to_owned);
        BackendArgs { backend, adapter: owned(adapter), simd: owned(simd), ..BackendArgs::default() }
    }

    #[test]
    fn without_flags_the_recorded_backend_is_used() {
        let recorded = Machine {
            name: "cpu baseline".to_owned(),
            flags: ["--backend", "cpu", "--simd", "baseline"].map(str::to_owned).to_vec(),
        };
        let open = BackendArgs { threads: Some(3), ..BackendArgs::default() };
        let found = open.or_recorded(&recorded);
        assert_eq!((found.backend, found.simd.as_deref(), found.threads), (Wanted::Cpu, Some("baseline"), Some(3)));
        let given = args(Wanted::Fastest, None, Some("avx2")).or_recorded(&recorded);
        assert_eq!((given.backend, given.simd.as_deref()), (Wanted::Fastest, Some("avx2")));
        let unknown = Machine { flags: vec!["--abacus".to_owned()], ..recorded };
        assert_eq!(open.or_recorded(&unknown).backend, Wanted::Fastest);
    }

    fn check_reason_as_requested(wanted: Wanted) {
        let reason = BackendArgs::default().open_to_compare(wanted).unwrap().reason;
        assert!(reason.contains("to be compared") && !reason.contains("as requested"), "{reason}");
        let asked = args(wanted, None, None).open_to_compare(wanted).unwrap().reason;
        assert!(asked.contains("as requested"), "{asked}");
    }

    #[test]
    fn the_cpu_is_reported_as_requested_only_if_it_was() {
        check_reason_as_requested(Wanted::Cpu);
    }

    #[test]
    fn wgpu_is_reported_as_requested_only_if_it_was() {
        check_reason_as_requested(Wanted::Wgpu);
    }

    #[test]
    fn every_combination_of_flags_is_a_request_or_a_contradiction() {
        use Wanted::{Cpu, Fastest as Auto, Wgpu};
        let (adapter, level) = (Some("llvm"), Some("baseline"));
        for (flags, wanted, why) in [
            ((Auto, None, None), Wanted::Fastest, None),
            ((Auto, None, level), Wanted::Cpu, Some("as --simd asks")),
            ((Auto, adapter, None), Wanted::Wgpu, None),
            ((Cpu, None, None), Wanted::Cpu, None),
            ((Cpu, None, level), Wanted::Cpu, None),
            ((Wgpu, None, None), Wanted::Wgpu, None),
            ((Wgpu, adapter, None), Wanted::Wgpu, None),
        ] {
            let request = args(flags.0, flags.1, flags.2).request().unwrap();
            assert_eq!((request.wanted, request.why), (wanted, why), "{flags:?}");
            assert_eq!((request.wgpu.adapter.as_deref(), request.level.is_some()), (flags.1, flags.2.is_some()));
        }
        for flags in [
            (Auto, adapter, level),
            (Cpu, adapter, None),
            (Cpu, adapter, level),
            (Wgpu, None, level),
            (Wgpu, adapter, level),
        ] {
            let refusal = args(flags.0, flags.1, flags.2).request().unwrap_err();
            let line = refusal.line().unwrap();
            assert!(line.ends_with("leave out one of the two"), "{flags:?}: {line}");
            assert_eq!(refusal.status(), std::process::ExitCode::from(2));
        }
    }
}
