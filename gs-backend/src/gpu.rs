//! Detection of devices that may be a GPU.
//!
//! Asking the graphics drivers takes time, and on Linux they may write to standard error about a
//! missing desktop. So they are asked only where the system has a device that may be a GPU.

use std::path::Path;

/// Prefixes of GPU devices in Linux' device folder: NVIDIA's own driver, Windows' under WSL, and
/// those of phones and boards.
const GPUS: [&str; 5] = ["nvidia", "dxg", "mali", "kgsl", "pvr"];

/// Whether one of Linux' devices, which are in the folder `/dev`, may be a GPU. On other systems
/// this is unknown, and so true.
///
/// Mesa's drivers open render nodes. A card without a render node only shows pictures.
pub(crate) fn may_have_gpu(devices: &Path) -> bool {
    !cfg!(target_os = "linux") || has_prefix(&devices.join("dri"), &["renderD"]) || has_prefix(devices, &GPUS)
}

fn has_prefix(folder: &Path, prefixes: &[&str]) -> bool {
    let matches = |name: &str| prefixes.iter().any(|prefix| name.starts_with(prefix));
    std::fs::read_dir(folder)
        .is_ok_and(|entries| entries.flatten().any(|entry| entry.file_name().to_str().is_some_and(matches)))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn gpus_are_recognised_by_their_devices() {
        let folder = tempfile::tempdir().unwrap();
        let devices = folder.path();
        let make = |name: &str| fs::write(devices.join(name), "").unwrap();
        make("null");
        fs::create_dir(devices.join("dri")).unwrap();
        make("dri/card0");
        assert!(!may_have_gpu(devices), "a card that only shows pictures");
        for gpu in ["nvidiactl", "dxg", "mali0", "kgsl-3d0", "dri/renderD128"] {
            make(gpu);
            assert!(may_have_gpu(devices), "{gpu}");
            fs::remove_file(devices.join(gpu)).unwrap();
        }
        assert!(!may_have_gpu(&devices.join("none")));
    }
}
