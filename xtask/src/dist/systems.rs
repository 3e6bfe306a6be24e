//! The systems that a release is for.

/// A system that a release is for.
#[derive(Debug, Clone, Copy)]
pub struct System {
    /// Its name in the names of files.
    pub name: &'static str,
    /// Rust's name for it.
    pub triple: &'static str,
    /// The oldest glibc that is enough, appended to the triple for the linker.
    pub glibc: &'static str,
    /// Python's name of it.
    pub wheel: &'static str,
    /// Debian's name of the architecture.
    pub debian: Option<&'static str>,
}

impl System {
    /// Whether it is Windows.
    pub fn is_windows(&self) -> bool {
        self.triple.contains("windows")
    }
}

/// The systems.
pub const SYSTEMS: [System; 3] = [
    System {
        name: "x86_64-linux",
        triple: "x86_64-unknown-linux-gnu",
        glibc: ".2.28",
        wheel: "manylinux_2_28_x86_64",
        debian: Some("amd64"),
    },
    System {
        name: "aarch64-linux",
        triple: "aarch64-unknown-linux-gnu",
        glibc: ".2.28",
        wheel: "manylinux_2_28_aarch64",
        debian: Some("arm64"),
    },
    System { name: "x86_64-windows", triple: "x86_64-pc-windows-gnullvm", glibc: "", wheel: "win_amd64", debian: None },
];
