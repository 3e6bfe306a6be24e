//! The machine that computes a study. It is part of every run's address.

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
    /// The flags as they are typed in a shell.
    pub fn typed_flags(&self) -> String {
        let quoted =
            |flag: &String| if flag.contains(char::is_whitespace) { format!("'{flag}'") } else { flag.clone() };
        self.flags.iter().map(quoted).collect::<Vec<_>>().join(" ")
    }
}
