//! `gs info --adapters`: the GPUs and software drivers of this machine, and the choice of
//! `--backend auto`.

use gs_backend::FutureExt as _;
use gs_core::Error;
use gs_wgpu::{AdapterSummary, WgpuRasterizer, WgpuSettings};
use serde::Serialize;

use crate::{failure::Failure, flags::backend::BackendArgs, terminal::output};

/// What `gs info --adapters --json` prints.
#[derive(Debug, Serialize)]
struct Adapters {
    /// The first is the one that `--backend wgpu` takes.
    adapters: Vec<AdapterSummary>,
    /// What `--backend auto` takes.
    auto: Auto,
    /// What to install where there is no adapter.
    advice: Option<String>,
}

#[derive(Debug, Serialize)]
struct Auto {
    backend: &'static str,
    /// Name of the adapter; `null` on the CPU.
    adapter: Option<String>,
    reason: String,
}

/// Lists the adapters.
pub(crate) fn run(json: bool) -> Result<(), Failure> {
    let found = gs_wgpu::adapters().block_on();
    let backend = BackendArgs::default().open()?;
    let advice = if found.is_empty() { advice() } else { None };
    if json {
        let adapter = backend.rasterizer.adapter().map(str::to_owned);
        let auto = Auto { backend: backend.rasterizer.name(), adapter, reason: backend.reason };
        return output::json(&Adapters { adapters: found, auto, advice });
    }
    let adapters = found.iter().map(ToString::to_string).chain(advice);
    let lines: Vec<String> = adapters.chain([format!("--backend auto takes {}", backend.reason)]).collect();
    output::result(lines.join("\n"))
}

/// The backend's error where there is no adapter.
fn advice() -> Option<String> {
    match WgpuRasterizer::new(WgpuSettings::default()).block_on().err()? {
        Error::Backend { message, .. } => Some(message),
        error => Some(error.to_string()),
    }
}
