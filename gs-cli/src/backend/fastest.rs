//! `--backend auto`: the GPU if there is one. A driver that computes on the processor is no GPU; gs-cpu is faster there.
//!
//! Asking the graphics drivers takes time, and on Linux they may write to standard error about a desktop that is not there. So they
//! are asked only where the system has a device that may be a GPU.

use pollster::FutureExt as _;
use std::{fs, path::Path};

use gs_core::Error;
use gs_wgpu::{WgpuRasterizer, WgpuSettings};

/// What is fastest on this machine.
pub(super) enum Fastest {
    /// A GPU, ready to compute.
    Gpu(Box<WgpuRasterizer>),
    /// The processor, and why no GPU.
    Cpu { why: String },
}

/// How the names of GPUs begin in Linux' device folder: NVIDIA's own driver, Windows' under WSL, and those of phones and boards.
const GPUS: [&str; 5] = ["nvidia", "dxg", "mali", "kgsl", "pvr"];

/// Finds what is fastest on this machine. A GPU of which `suits` is an error is passed by.
pub(super) fn find(suits: impl FnOnce(&WgpuRasterizer) -> Result<(), Error>) -> Fastest {
    let none = "no GPU was found";
    if cfg!(target_os = "linux") && !may_have_gpu(Path::new("/dev")) {
        return Fastest::Cpu { why: none.to_owned() };
    }
    match WgpuRasterizer::new(WgpuSettings::default()).block_on() {
        // Adapters are ranked, so that if the first is none, no other is.
        Ok(first) if first.adapter().kind == "CPU" => {
            Fastest::Cpu { why: format!("{none}, only a software driver ({})", first.adapter().name) }
        }
        Ok(gpu) => if_suited(gpu, suits),
        Err(Error::Backend { message, .. }) => Fastest::Cpu { why: format!("no GPU can be used ({message})") },
        Err(error) => Fastest::Cpu { why: format!("no GPU can be used ({error})") },
    }
}

fn if_suited(gpu: WgpuRasterizer, suits: impl FnOnce(&WgpuRasterizer) -> Result<(), Error>) -> Fastest {
    match suits(&gpu) {
        Ok(()) => Fastest::Gpu(Box::new(gpu)),
        Err(error) => Fastest::Cpu { why: format!("the GPU {} is not used, as {error}", gpu.adapter().name) },
    }
}

/// Whether one of the devices may be a GPU. Render nodes are what Mesa's drivers open; a card without one only shows pictures.
fn may_have_gpu(devices: &Path) -> bool {
    has_name(&devices.join("dri"), &["renderD"]) || has_name(devices, &GPUS)
}

fn has_name(folder: &Path, beginnings: &[&str]) -> bool {
    let begins = |name: &str| beginnings.iter().any(|beginning| name.starts_with(beginning));
    fs::read_dir(folder)
        .is_ok_and(|entries| entries.flatten().any(|entry| entry.file_name().to_str().is_some_and(begins)))
}

#[cfg(test)]
mod tests {
    use gs_core::{Cut, Parameterization, Rasterizer, RenderSettings, Scene3d};

    use super::*;
    use crate::backend::shows_images;

    /// The driver that the tests have stands in for a GPU.
    #[test]
    fn a_gpu_that_does_not_offer_what_is_needed_is_passed_by() {
        let found = |parameterization| {
            let gpu =
                WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
            if_suited(gpu, |gpu| gpu.upload(&Scene3d::default(), parameterization).map(drop))
        };
        assert!(matches!(found(Parameterization::ScaleRotation), Fastest::Gpu(_)));
        let Fastest::Cpu { why } = found(Parameterization::CovarianceFactor) else {
            panic!("covariance factors in 3D are offered")
        };
        assert!(why.contains("is not used") && why.contains("CovarianceFactor"), "{why}");
    }

    #[test]
    fn a_gpu_is_taken_for_images_only_where_it_offers_the_effects() {
        let found = |cut| {
            let gpu =
                WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
            let mut render = RenderSettings::default();
            render.accuracy.cut = cut;
            if_suited(gpu, |gpu| shows_images(gpu, &render))
        };
        assert!(matches!(found(Cut::Hard), Fastest::Gpu(_)));
        let Fastest::Cpu { why } = found(Cut::Smooth) else { panic!("wgpu has no smooth cut") };
        assert!(why.starts_with("the GPU ") && why.contains("does not offer a smooth cut"), "{why}");
    }

    #[test]
    fn gpus_are_known_by_their_devices() {
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
