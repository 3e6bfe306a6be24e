//! How long the loops of an invocation may be where drivers end them.
//!
//! Mesa's llvmpipe counts the iterations of all loops of an invocation together (those of a vector of invocations go on until the last of them
//! is done), and once there are too many, silently, each further loop ends after its first. So no loop may be as long as the data say:
//!
//! - along a tile's list: the blend kernels walk along [`longest_walk`] entries in one dispatch (`walk.wgsl`), `queue_up` along 256 an
//!   iteration ([`Tiles::make_room`](crate::tiles::Tiles::make_room) refuses more than it can);
//! - along the tiles of one Gaussian, of which there are [`LONGEST_LOOP`] or the image is refused ([`check_tiles`]): `project` and `bin`,
//!   whose loop over columns holds one over rows; `product_of` of `solve_colors.wgsl`; `sums_of` of `received.wgsl`;
//! - along the tiles of eight Gaussians: `sums_together` of `received.wgsl`, where there are no more than [`LONGEST_LOOP`], else `sums_of`.

use gs_core::Error;

use crate::{
    gpu::{Gpu, backend_error},
    shaders::Kernels,
};

/// Iterations of all loops of an invocation together after which llvmpipe ends every loop (`LP_MAX_TGSI_LOOP_ITERATIONS`).
const MOST_ITERATIONS: u32 = 65_535;

/// Iterations that the data may make of an invocation's loops. What is kept for the others: 32 for SH coefficients, 8 to sum up a work group,
/// and one of each loop for the test that ends it.
pub(crate) const LONGEST_LOOP: u32 = MOST_ITERATIONS - 64;

/// Most entries of a list that a dispatch may walk along. Where drivers end loops, each kind of kernels has its iterations for an entry, at
/// most: in `blend_vectors` 9/8, twice where passes are fused; in `blend_bwd` also those of the sums over all parts of a tile, so that they
/// are about 15, or 4 with subgroups of eight.
pub(crate) fn longest_walk(on_cpu: bool, kernels: Kernels) -> u32 {
    match kernels {
        _ if !on_cpu => u32::MAX,
        Kernels::Portable => MOST_ITERATIONS / 20,
        Kernels::Subgroups => MOST_ITERATIONS / 6,
        Kernels::Vectors => 2 * (MOST_ITERATIONS / 5),
    }
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
        "an image of {width}x{height} px has more tiles than {} can loop over: make it smaller, or use the CPU backend",
        gpu.adapter.name
    )))
}
