//! What effects cost on the device: Gaussians of an image in 2D, and as a 3D scene before a camera.
//!
//! `cargo bench -p gs-wgpu --bench effects`, the tables as those of gs-cpu's benchmark of this name.

#![allow(clippy::print_stdout)]

// Shared with gs-cpu's benchmarks, which use all of it.
#[allow(dead_code)]
#[path = "../../gs-cpu/benches/garden/mod.rs"]
mod garden;
#[path = "../../gs-cpu/benches/plane/mod.rs"]
mod plane;
#[allow(dead_code)]
#[path = "../../gs-cpu/benches/turns/mod.rs"]
mod turns;

use garden::SEED;
use gs_core::{Error, Rasterizer};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};

fn main() -> Result<(), Error> {
    let gpu = WgpuRasterizer::new(WgpuSettings::default())?;
    println!("{}, seed {SEED}", gpu.for_3d().describe());
    let sizes = [1_000, 9_000, 70_000];
    sizes.into_iter().try_for_each(|count| plane::in_the_plane(gpu.for_2d(), gpu.for_3d(), count))
}
