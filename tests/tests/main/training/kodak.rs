//! The quality that the default settings promise, on real images, where they are there.

use pollster::FutureExt as _;
use std::path::PathBuf;

use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::{Preset, fit};

/// The images of the Kodak test set.
fn images() -> Vec<PathBuf> {
    let Some(Ok(folder)) = gs_conformance::data::find("kodak").map(std::fs::read_dir) else { return Vec::new() };
    folder.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "png")).collect()
}

#[test]
#[ignore = "slow without optimisation: `cargo xtask test --slow`"]
fn nine_thousand_gaussians_pass_what_is_promised() {
    let images = images();
    if images.is_empty() {
        return;
    }
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let (mut psnr, mut ms_ssim) = (0.0, 0.0);
    for path in &images {
        let target = gs_io::read_image(path).unwrap().image;
        let summary =
            fit(&cpu, &target, Preset::Standard.settings(9_000, target.size()), &mut ()).block_on().unwrap().summary;
        assert_eq!(summary.gaussians, 9_000);
        psnr += summary.psnr / images.len() as f64;
        ms_ssim += summary.ms_ssim.unwrap() / images.len() as f64;
    }
    eprintln!("mean of {}: {psnr:.2} dB, MS-SSIM {ms_ssim:.4}", images.len());
    assert!(psnr > 35.6 && ms_ssim > 0.98, "{psnr} dB, MS-SSIM {ms_ssim}");
}
