//! `gs info --adapters`: the GPUs that were found, drivers that stand in for one included, and what `--backend auto` makes of them.

use gs_core::Error;
use gs_wgpu::{AdapterSummary, WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;
use serde::Serialize;

use crate::{
    backend::{Backend, BackendArgs},
    failure::Failure,
    output::{self, Format},
};

/// What `gs info --adapters --json` prints.
#[derive(Debug, Serialize)]
struct Adapters {
    /// The one that `--backend wgpu` takes first.
    adapters: Vec<Adapter>,
    /// What `--backend auto` takes.
    auto: Auto,
    /// What to install where there is no adapter.
    advice: Option<String>,
}

#[derive(Debug, Serialize)]
struct Adapter {
    name: String,
    kind: &'static str,
    interface: String,
    driver: String,
}

#[derive(Debug, Serialize)]
struct Auto {
    backend: &'static str,
    /// Its name; none on the processor.
    adapter: Option<String>,
    reason: String,
}

/// Lists the adapters. That there is none is an answer, too.
///
/// # Errors
/// Where the answer cannot be printed.
pub(crate) fn run(format: Format) -> Result<(), Failure> {
    let found = gs_wgpu::adapters().block_on();
    let backend = Backend::start(&BackendArgs::default())?;
    let advice = if found.is_empty() { advice() } else { None };
    if format == Format::Json {
        let auto = Auto { backend: backend.name, adapter: backend.adapter, reason: backend.reason };
        return output::json(&Adapters { adapters: found.into_iter().map(Adapter::from).collect(), auto, advice });
    }
    let adapters = found.iter().map(ToString::to_string).chain(advice);
    let lines: Vec<String> = adapters.chain([format!("--backend auto takes {}", backend.reason)]).collect();
    output::result(lines.join("\n"))
}

/// What the backend says where it finds nothing.
fn advice() -> Option<String> {
    match WgpuRasterizer::new(WgpuSettings::default()).block_on().err()? {
        Error::Backend { message, .. } => Some(message),
        error => Some(error.to_string()),
    }
}

impl From<AdapterSummary> for Adapter {
    fn from(found: AdapterSummary) -> Self {
        let AdapterSummary { name, kind, interface, driver } = found;
        Self { name, kind, interface, driver }
    }
}
