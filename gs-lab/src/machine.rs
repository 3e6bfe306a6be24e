//! What computes a study: part of every run's address, and how to ask for the same again.

use serde::{Deserialize, Serialize};

/// What computes, as far as results depend on it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Backend, instruction set or adapter with its driver, kernels, system: equal words promise equal results. Threads do not matter.
    #[serde(rename = "machine")]
    pub name: String,
    /// The flags of `gs` that choose it; empty where it was chosen by a program of one's own.
    #[serde(default)]
    pub flags: Vec<String>,
}

impl From<String> for Machine {
    /// One that no flags choose.
    fn from(name: String) -> Self {
        Self { name, flags: Vec::new() }
    }
}

impl From<&str> for Machine {
    /// One that no flags choose.
    fn from(name: &str) -> Self {
        name.to_owned().into()
    }
}

impl Machine {
    /// The flags as they are typed.
    pub fn typed_flags(&self) -> String {
        let quoted =
            |flag: &String| if flag.contains(char::is_whitespace) { format!("'{flag}'") } else { flag.clone() };
        self.flags.iter().map(quoted).collect::<Vec<_>>().join(" ")
    }
}
