//! How long the loops of an invocation may be where a driver ends them.
//!
//! Mesa's software driver, llvmpipe, counts the iterations of all loops of an invocation together, those of a vector of invocations until the
//! last of them is done. Beyond 65,535, each further loop silently ends after its first iteration. No result may depend on that, so on an
//! adapter that computes on a CPU these are errors:
//!
//! - a tile's list that is longer than [`longest_list`], which `ranges` finds on the device;
//! - an image of more tiles than a loop can cover ([`check_tiles`]): `project` and `bin` loop over the tiles of a Gaussian, and so do
//!   `product_of` of `solve_colors.wgsl` and `sums_of` of `received.wgsl`.

use gs_core::Error;

use crate::{
    gpu::{Gpu, backend_error},
    shaders::{Kernels, TILE_COLUMNS, TILE_ROWS},
};

/// Iterations of all loops of an invocation together after which llvmpipe ends every loop (`LP_MAX_TGSI_LOOP_ITERATIONS`).
const MOST_ITERATIONS: u32 = 65_535;

/// Iterations that the data may make of an invocation's loops. The remainder is for loops of constant length: 32 for SH coefficients, 8 to
/// sum up a work group, and one of each loop for the test that ends it.
const LONGEST_LOOP: u32 = MOST_ITERATIONS - 64;

/// Entries of a tile's list that stage `queue` puts into a queue within the limit: it takes nine iterations for 256.
const LONGEST_QUEUE: u32 = 1 << 20;

/// Most entries of a tile's list that the kernels of a pass can loop over. In `blend_bwd` an entry also takes the iterations of the sums over
/// all parts of a tile: about 15, or 4 with subgroups of eight.
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
        "{longest} Gaussians reach one tile of {TILE_COLUMNS}x{TILE_ROWS} px, and {name} ends loops after {most} of them: use the CPU backend \
         (--backend cpu), fewer or smaller Gaussians, or a GPU"
    ))
}

/// Fails where a software driver would end the loops over all tiles of one Gaussian on an image of this size, px, and so many tiles across and
/// down.
pub(crate) fn check_tiles(gpu: &Gpu, [width, height]: [u32; 2], [across, down]: [u32; 2]) -> Result<(), Error> {
    // `bin` has an iteration for each tile, and two for each column: one that holds the loop over its rows, and that loop's end.
    let iterations = u64::from(across) * (u64::from(down) + 2);
    if !gpu.on_cpu || iterations <= u64::from(LONGEST_LOOP) {
        return Ok(());
    }
    Err(backend_error(format!(
        "an image of {width}x{height} px has more tiles than {} can loop over: make it smaller, or use the CPU backend (--backend cpu)",
        gpu.adapter.name
    )))
}
