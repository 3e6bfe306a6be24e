//! What computes, as a file of settings from `gs frontier` has it.

use gs_cpu::CpuTuning;
use serde::{Deserialize, Serialize};

/// What computes.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct ChosenMachine {
    /// The flags that choose it; where flags are given, they count instead.
    pub(crate) flags: Vec<String>,
    /// How the cpu backend goes about its work.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) cpu: Option<CpuTuning>,
    /// How the wgpu backend's kernels are written, if not as the adapter likes them best: portable, subgroups or vectors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) kernels: Option<KernelsName>,
}

/// How the wgpu backend's kernels are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum KernelsName {
    Portable,
    Subgroups,
    Vectors,
}
