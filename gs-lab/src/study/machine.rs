//! The machine that computes a study. It is part of every run's address.

use std::env::consts;

use gs_backend::AnyRasterizer;
use gs_core::Backend as _;
use gs_wgpu::AdapterSummary;
use serde::{Deserialize, Serialize};

/// A backend on a machine, as far as results depend on it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Backend, instruction set or adapter with its driver, kernels and system. Equal names promise
    /// equal results. The number of threads is not part of it.
    #[serde(rename = "machine")]
    pub name: String,
    /// The flags of `gs` that select the machine; empty where another program selected it.
    #[serde(default)]
    pub flags: Vec<String>,
}

impl From<String> for Machine {
    /// A machine without flags.
    fn from(name: String) -> Self {
        Self { name, flags: Vec::new() }
    }
}

impl From<&str> for Machine {
    /// A machine without flags.
    fn from(name: &str) -> Self {
        name.to_owned().into()
    }
}

impl Machine {
    /// What computes, as far as results depend on it, and the flags of `gs` that choose it.
    pub fn of(rasterizer: &AnyRasterizer) -> Self {
        // Functions such as exp are the system's.
        let system = format!("{} {}", consts::OS, consts::ARCH);
        let (name, flags) = match rasterizer {
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
            other => return Self { name: format!("{}, {system}", other.describe()), flags: Vec::new() },
        };
        Self { name, flags: flags.to_vec() }
    }

    /// The flags as they are typed in a shell.
    pub fn typed_flags(&self) -> String {
        let quoted =
            |flag: &String| if flag.contains(char::is_whitespace) { format!("'{flag}'") } else { flag.clone() };
        self.flags.iter().map(quoted).collect::<Vec<_>>().join(" ")
    }
}
