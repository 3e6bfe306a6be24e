//! The running system that this process belongs to, and names for the process itself.

use std::{
    fs,
    hash::{BuildHasher, RandomState},
    path::Path,
    process::Command,
};

/// A name of the running system and of the file system of a folder. Processes with the same name
/// see each other's locks on the folder's files.
pub(crate) fn identity(folder: &Path) -> String {
    // A number drawn when the kernel started, which all its containers share.
    let kernel = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok();
    let kernel = kernel.map(|text| text.trim().to_owned()).filter(|text| !text.is_empty());
    format!("{} {}", kernel.unwrap_or_else(host), device(folder))
}

/// The file system's number. Two mounts of one network folder have different ones, and may not see
/// each other's locks.
#[cfg(unix)]
fn device(folder: &Path) -> u64 {
    use std::os::unix::fs::MetadataExt as _;
    fs::metadata(folder).map_or(0, |found| found.dev())
}

#[cfg(not(unix))]
fn device(_: &Path) -> u64 {
    0
}

/// The name of this machine, for people.
pub(crate) fn host() -> String {
    let of_kernel = fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let of_program = || {
        let output = Command::new("hostname").output().ok()?;
        String::from_utf8(output.stdout).ok()
    };
    let name = of_kernel.or_else(of_program).unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { "unknown".to_owned() } else { name.to_owned() }
}

/// A word that no other process and no other call draws.
pub(crate) fn token() -> String {
    // Each `RandomState` has keys of its own, of which the first comes from the system.
    format!("{:016x}", RandomState::new().hash_one(std::process::id()))
}
