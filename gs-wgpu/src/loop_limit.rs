//! Limits for Mesa's software driver, which ends long loops.
//!
//! llvmpipe counts the iterations of all loops of an invocation together; those of a vector of
//! invocations until the last one is done. Beyond 65,535, each further loop silently ends after its
//! first iteration. To avoid wrong results, these are errors on an adapter that computes on a CPU:
//!
//! - a tile's list that is longer than [`longest_list`], which `ranges` detects on the device;
//! - an image of more tiles than a loop can cover ([`check_tiles`]): `project` and `bin` loop over
//!   the tiles of a Gaussian, and so do `product_of` of `solve_colors.wgsl` and `sums_of` of
//!   `received.wgsl`.

use gs_core::Error;

use crate::{
    fault::backend_error,
    gpu::Gpu,
    shaders::{Kernels, TILE_COLUMNS, TILE_ROWS},
};

/// Number of iterations of an invocation after which llvmpipe ends every loop
/// (`LP_MAX_TGSI_LOOP_ITERATIONS`).
const MOST_ITERATIONS: u32 = 65_535;

/// Number of iterations that may depend on the data. The remainder is for loops of constant length:
/// 32 for SH coefficients, 8 for sums over a work group, and one per loop for the test that ends
/// it.
const LONGEST_LOOP: u32 = MOST_ITERATIONS - 64;

/// Longest list that stage `queue` can handle: it needs nine iterations for 256 entries.
const LONGEST_QUEUE: u32 = 1 << 20;

/// Longest list that the kernels of a pass can loop over.
///
/// In `blend_bwd` an entry also needs the iterations of the sums over all parts of a tile: about
/// 15, or 4 with subgroups of eight.
pub(crate) fn longest_list(gpu: &Gpu, by_pixel: bool) -> u32 {
    match gpu.kernels {
        _ if !gpu.on_cpu => u32::MAX,
        _ if by_pixel => LONGEST_QUEUE,
        Kernels::Portable => MOST_ITERATIONS / 20,
        Kernels::Subgroups => MOST_ITERATIONS / 6,
    }
}

/// The error where a tile's list has `longest` entries, more than [`longest_list`].
pub(crate) fn too_long(gpu: &Gpu, longest: u32, by_pixel: bool) -> Error {
    let (name, most) = (&gpu.adapter.name, longest_list(gpu, by_pixel));
    backend_error(format!(
        "{longest} Gaussians touch one tile of {TILE_COLUMNS}x{TILE_ROWS} px, but {name} ends loops after {most} of them: \
         use the CPU backend (--backend cpu), fewer or smaller Gaussians, or a GPU"
    ))
}

/// Fails if a software driver would end the loop over all tiles of an image.
pub(crate) fn check_tiles(gpu: &Gpu, [width, height]: [u32; 2], [across, down]: [u32; 2]) -> Result<(), Error> {
    // `bin` needs an iteration for each tile, and two for each column of tiles.
    let iterations = u64::from(across) * (u64::from(down) + 2);
    if !gpu.on_cpu || iterations <= u64::from(LONGEST_LOOP) {
        return Ok(());
    }
    Err(backend_error(format!(
        "an image of {width}x{height} px has more tiles than {} can loop over: make it smaller, or use the CPU backend (--backend cpu)",
        gpu.adapter.name
    )))
}
