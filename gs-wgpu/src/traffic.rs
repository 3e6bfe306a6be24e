//! The bytes that each stage moves at least, from the sizes of its buffers, as [`Traffic`] defines them; and the pairs that blending
//! visits.

use gs_core::{Blend, Error, Loss, profile::Traffic};

use crate::{
    gpu::Gpu,
    kind::Kind,
    layout::{QUEUED_BYTES, SPLAT_BYTES},
    loss::MOMENTS_BYTES,
    profile::Stage,
    shaders::{Kernels, TILE_COLUMNS, stride, tiling},
    splats::Splats,
    tiles::{DEPTH_BYTES, PIXEL_BYTES, Tiles, totals_bytes},
    workspace::Workspace,
};

/// A key, an offset, or a place in a list.
pub(crate) const INDEX: u64 = 4;

/// An entry: its Gaussian and its rows.
const ENTRY: u64 = 8;

/// Rows that a blend kernel visits or passes over together.
const ROWS_TOGETHER: u32 = 4;

/// Bytes of one.
pub(crate) fn size<T>() -> u64 {
    size_of::<T>() as u64
}

/// What one run of `stage` moves, with so many entries.
pub(crate) fn of<S: Kind>(
    stage: Stage,
    workspace: &Workspace<S>,
    splats: &Splats<S>,
    loss: Loss,
    entries: u64,
) -> Traffic {
    let tiles = &workspace.tiles;
    let over = tiles.settings.effects.blend == Blend::Over;
    let n = splats.len as u64;
    let image = tiles.pixels() * PIXEL_BYTES;
    let moments = 3 * tiles.pixels() * MOMENTS_BYTES;
    let stride = u64::from(stride(tiles.variant()));
    let slots = entries * stride * size::<f32>();
    // Of the lists: each entry by its sorted number, with its Gaussian's splat; or as it stands in a queue, which is made of those.
    let listed = entries * (INDEX + ENTRY + SPLAT_BYTES);
    let queued = if tiles.orders_by_pixel() { entries * QUEUED_BYTES } else { 0 };
    let (lists, queue, totals) = match queued {
        0 => (listed, 0, 0),
        _ => (queued, listed + entries * DEPTH_BYTES, entries * totals_bytes(stride)),
    };
    let (read, written) = match stage {
        Stage::Project | Stage::Adam => return S::traffic(stage, workspace, splats),
        // Sums of blocks, then their insides.
        Stage::Scan => (2 * n * INDEX, n * INDEX),
        Stage::Bin => (n * (SPLAT_BYTES + INDEX), entries * (2 * INDEX + ENTRY)),
        // Each pass counts keys, then moves keys and numbers.
        Stage::Sort => {
            let passes = u64::from(tiles.sort_passes());
            (passes * entries * 3 * INDEX, passes * entries * 2 * INDEX)
        }
        Stage::Ranges => (entries * INDEX + queue, queued),
        Stage::Blend => (lists, image),
        Stage::Loss => match loss {
            Loss::L1 | Loss::L2 => (2 * image, image),
            // Moments down; along, and derivatives, those along again; down, with the image and the target once more.
            Loss::L1Dssim { .. } => (4 * image + 2 * moments, 2 * moments + image),
        },
        // In the order of depth at each pixel, the sums' units are found first.
        Stage::BlendBwd if totals > 0 => (2 * (lists + 2 * image) + totals, slots + 2 * totals),
        Stage::BlendBwd => (lists + image + if over { image } else { 0 }, slots),
        Stage::Fused => (lists + image, slots),
        Stage::ProjectBwd => {
            let Traffic { read, written } = S::traffic(stage, workspace, splats);
            (read + slots, written)
        }
    };
    Traffic { read, written }
}

/// Pixel–Gaussian pairs that a blend kernel visits: of a tile, all columns of every four rows of which the entry touches one; all of it
/// where lanes are those of a CPU's vector, which pass over nothing.
pub(crate) fn pairs(gpu: &Gpu, tiles: &Tiles, entries: usize) -> Result<u64, Error> {
    let tile_rows = u64::from(tiling(gpu.kernels).tile_rows);
    if gpu.kernels == Kernels::Vectors || tiles.orders_by_pixel() {
        return Ok(entries as u64 * tile_rows * u64::from(TILE_COLUMNS));
    }
    let entries: Vec<[u32; 2]> = gpu.read(&tiles.entries.buffer, entries)?;
    Ok(entries.iter().map(|&[_, rows]| u64::from(rows_visited(rows)) * u64::from(TILE_COLUMNS)).sum())
}

/// Rows that are visited for an entry with these: first | end << 16.
fn rows_visited(rows: u32) -> u32 {
    match (rows & 0xffff, rows >> 16) {
        (first, end) if first < end => end.next_multiple_of(ROWS_TOGETHER) - first / ROWS_TOGETHER * ROWS_TOGETHER,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{
        Canvas, Gaussian2d, Image, Parameterization, Rasterizer, RenderSettings, Scene2d,
        profile::{Profile, Profiler},
    };

    use super::*;
    use crate::{WgpuRasterizer, WgpuSettings};

    /// A profile of two Gaussians, of which one touches two columns of tiles on a canvas of 32×10 px and the other one.
    fn profiled(wgpu: &WgpuRasterizer, blend: Blend, loss: Loss) -> Profile {
        let at = |x: f32| Gaussian2d {
            mean: Vec2::new(x, 5.0),
            log_scale: Vec2::ZERO,
            rotation: 0.0,
            opacity_logit: if blend == Blend::Over { 1.0 } else { f32::INFINITY },
            color: Vec3::ONE,
        };
        let scene: Scene2d = [at(16.0), at(26.0)].into_iter().collect();
        let mut splats = wgpu.upload(&scene, Parameterization::CovarianceFactor).unwrap();
        let target = wgpu.for_2d().upload_target(&Image::filled(32, 10, [0.5; 3]).unwrap()).unwrap();
        let settings = RenderSettings::blended(blend);
        wgpu.profile(&mut splats, &Canvas::new(32, 10), &target, &settings, loss, 1).unwrap()
    }

    fn rasterizer() -> WgpuRasterizer {
        WgpuRasterizer::new(WgpuSettings::default()).expect("`cargo xtask test` installs a driver")
    }

    #[test]
    fn rows_are_visited_by_fours() {
        for (first, end, visited) in [(0, 0, 0), (0, 1, 4), (3, 5, 8), (4, 8, 4), (2, 8, 8), (0, 16, 16), (15, 16, 4)] {
            assert_eq!(rows_visited(first | end << 16), visited, "{first} to {end}");
        }
    }

    #[test]
    fn bytes_and_pairs_are_those_of_the_buffers() {
        let wgpu = rasterizer();
        let profile = profiled(&wgpu, Blend::Sum, Loss::L2);
        let of = |name: &str| {
            let stage = profile.stages.iter().find(|stage| stage.stage == name).unwrap();
            (stage.traffic.read, stage.traffic.written)
        };
        // An image has 320 pixels of 16 bytes; an entry is 8 bytes, its number 4, a splat, a Gaussian and a gradient 48 each.
        let image = 320 * 16;
        assert_eq!(profile.entries, 3);
        assert_eq!(of("project"), (2 * 48, 2 * (48 + 4)));
        assert_eq!(of("bin"), (2 * (48 + 4), 3 * (4 + 4 + 8)));
        // Two tiles, of one or two lists each: one digit.
        assert_eq!(of("sort"), (3 * (4 + 4 + 4), 3 * (4 + 4)));
        assert_eq!(of("blend"), (3 * (4 + 8 + 48), image));
        assert_eq!(of("loss"), (2 * image, image));
        assert_eq!(of("blend_bwd"), (3 * (4 + 8 + 48) + image, 3 * 8 * 4));
        if wgpu.gpu.kernels == Kernels::Vectors {
            assert_eq!(of("fused"), (3 * (4 + 8 + 48) + image, 3 * 8 * 4));
        }
        assert_eq!(of("project_bwd"), (2 * (48 + 48 + 4) + 3 * 8 * 4, 2 * 48));
        assert_eq!(of("adam"), (2 * (48 + 48 + 80), 2 * (48 + 80)));
        // σ = 1 px: the cut's ellipse reaches 3.3 px, from row 2 to row 7, which are two fours.
        let rows = if wgpu.gpu.kernels == Kernels::Vectors { 16 } else { 8 };
        assert_eq!(profile.pairs, 3 * 16 * rows);
        for stage in &profile.stages {
            let blends = ["blend", "blend_bwd", "fused"].contains(&stage.stage);
            let expected = if blends { profile.pairs } else { 0 };
            assert_eq!(stage.pairs, expected, "{}", stage.stage);
        }
    }

    #[test]
    fn blending_over_and_structure_cost_more() {
        let bytes = |profile: &Profile, name: &str| {
            profile.stages.iter().find(|stage| stage.stage == name).map(|stage| stage.traffic.bytes()).unwrap()
        };
        let wgpu = rasterizer();
        let (sum, over) = (profiled(&wgpu, Blend::Sum, Loss::L1), profiled(&wgpu, Blend::Over, Loss::PAPER));
        let image = 320 * 16;
        assert_eq!(bytes(&over, "blend"), bytes(&sum, "blend"));
        assert_eq!(bytes(&over, "blend_bwd"), bytes(&sum, "blend_bwd") + image + 3 * 4);
        assert_eq!(bytes(&over, "loss"), bytes(&sum, "loss") + 14 * image);
    }
}
