//! Measures how far gs-cpu and gs-wgpu are from the oracle, for the table in `tolerance.rs`.
//!
//! `cargo run -p gs-conformance --example worst_cases`

#![allow(clippy::print_stdout)]

use gs_conformance::{
    Failure,
    conformance::{check_gradients, check_image},
    scenes::{Draw, Kind2d, Kind3d},
    subject::Subject,
    tolerance::Agreement,
};
use gs_core::{
    Loss, Optimizer, Parameterization, Scene2d, Scene3d,
    effects::{Antialias, Blend, Order},
};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;

/// Worst agreement so far, and how many scenes had nothing to compare.
#[derive(Default)]
struct Worst {
    roundings: f64,
    share: f64,
    flips: usize,
    uncompared: usize,
}

impl Worst {
    fn add(&mut self, result: Result<Agreement, Failure>) -> Result<(), Failure> {
        match result {
            Ok(agreement) => {
                self.roundings = self.roundings.max(agreement.worst_roundings);
                self.share = self.share.max(agreement.worst_share);
                self.flips = self.flips.max(agreement.flips);
            }
            Err(Failure::Nothing(_)) => self.uncompared += 1,
            Err(failure) => return Err(failure),
        }
        Ok(())
    }
}

/// Prints a line per kind of scenes and blending.
fn measure<R: Optimizer<Scene2d>>(name: &str, rasterizer: &R) -> Result<(), Failure> {
    for kind in Kind2d::ALL {
        for blend in [Blend::Sum, Blend::Over] {
            let scenes = format!("{kind:?} {blend:?}");
            worst_of(name, &scenes, rasterizer, |seed| Draw::new(kind, blend, 24, (35, 26), seed))?;
        }
    }
    Ok(())
}

/// Prints a line per kind of 3D scenes, blending, order and antialiasing.
fn measure_3d<R: Optimizer<Scene3d>>(name: &str, rasterizer: &R) -> Result<(), Failure> {
    for kind in Kind3d::ALL {
        for (blend, order, antialias) in [
            (Blend::Sum, Order::Global, Antialias::None),
            (Blend::Over, Order::Global, Antialias::None),
            (Blend::Over, Order::Global, Antialias::Mip),
            (Blend::Over, Order::PerPixel, Antialias::Dilate),
        ] {
            let scenes = format!("{kind:?} {blend:?} {order:?} {antialias:?}");
            let drawn = |seed| Draw::for_3d(kind, blend, 24, (35, 26), seed).in_order(order).antialiased(antialias);
            worst_of(name, &scenes, rasterizer, drawn)?;
        }
    }
    Ok(())
}

fn worst_of<S: Subject, R: Optimizer<S>>(
    name: &str,
    scenes: &str,
    rasterizer: &R,
    drawn: impl Fn(u64) -> Draw<S>,
) -> Result<(), Failure> {
    let mut worst: [Worst; 4] = Default::default();
    for seed in 0..30 {
        let draw = drawn(seed).on([0.3, 0.6, 0.2]);
        worst[0].add(check_image(rasterizer, &draw))?;
        for (worst, loss) in worst[1..].iter_mut().zip([Loss::L2, Loss::L1, Loss::PAPER]) {
            worst.add(check_gradients(rasterizer, &draw, &loss, Parameterization::ScaleRotation))?;
        }
    }
    let columns = worst.map(|w| format!("{:5.2} {:.1e} ({}, {})", w.roundings, w.share, w.flips, w.uncompared));
    println!("{name:10} {scenes:36}  {}", columns.join("  "));
    Ok(())
}

fn main() -> Result<(), Failure> {
    println!(
        "worst roundings and differences (most flips, scenes without a comparison) of 30 scenes: image, and gradients of \
         L2, L1, L1 + D-SSIM; the latter as shares of the largest gradient by the same parameter"
    );
    for level in SimdLevel::available() {
        let rasterizer = CpuRasterizer::new(CpuSettings::default().with(|s| {
            s.threads = None;
            s.level = Some(level);
        }))?;
        measure(&level.to_string(), &rasterizer)?;
        measure_3d(&level.to_string(), &rasterizer)?;
    }
    for kernels in [Kernels::Portable, Kernels::Subgroups] {
        match WgpuRasterizer::new(WgpuSettings::default().with(|s| s.kernels = Some(kernels))).block_on() {
            Ok(rasterizer) => measure(&format!("{kernels:?}"), &rasterizer)?,
            Err(error) => println!("{kernels:?}: {error}"),
        }
    }
    Ok(())
}
