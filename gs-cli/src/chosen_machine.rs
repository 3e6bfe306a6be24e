//! What computes, as a file of settings from `gs frontier` has it.

use gs_cpu::CpuTuning;
use serde::{Deserialize, Deserializer, Serialize, de::Error as _};

use crate::output;

/// What computes.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct ChosenMachine {
    /// The flags that choose it; where flags are given, they count instead.
    pub(crate) flags: Vec<String>,
    /// How the cpu backend goes about its work.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) cpu: Option<CpuTuning>,
    /// How the wgpu backend's kernels are written, if not as the adapter likes them best: portable or subgroups.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "kernels")]
    pub(crate) kernels: Option<KernelsName>,
}

/// How the wgpu backend's kernels are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum KernelsName {
    Portable,
    Subgroups,
}

/// The kernels of a name; none for `vectors`, which earlier versions had for drivers that compute on a CPU.
fn kernels<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<KernelsName>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Stored {
        Name(KernelsName),
        Other(String),
    }
    match Stored::deserialize(deserializer)? {
        Stored::Name(name) => Ok(Some(name)),
        Stored::Other(name) if name == "vectors" => {
            output::note("machine.kernels \"vectors\" is no more: wgpu uses the kernels that suit the adapter best");
            Ok(None)
        }
        Stored::Other(name) => Err(D::Error::unknown_variant(&name, &["portable", "subgroups"])),
    }
}
