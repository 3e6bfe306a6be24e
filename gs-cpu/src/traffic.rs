//! The bytes that each stage moves at least, from the sizes of its arrays, as [`Traffic`] defines them.

use gs_core::{Blend, Loss, effects::Statistics, profile::Traffic};

use crate::{
    bin::{Entry, Found},
    dssim,
    kind::Kind,
    layout::{Row, ScalarRow},
    profile::Stage,
    splat::Splat,
    workspace::Workspace,
};

/// A position in some array.
pub(crate) const INDEX: u64 = size_of::<u32>() as u64;

pub(crate) fn size<T>() -> u64 {
    size_of::<T>() as u64
}

/// Of what splats keeps per Gaussian for a statistic.
pub(crate) fn statistics_size(statistics: Statistics) -> u64 {
    match statistics {
        Statistics::None => 0,
        _ => size::<f32>() + size::<u32>(),
    }
}

/// What one run of `stage` moves, once the workspace has been through all of them.
pub(crate) fn of<S: Kind>(stage: Stage, workspace: &Workspace<S>, splats: &S::Splats, loss: &Loss) -> Traffic {
    let tiles = &workspace.tiles;
    let over = tiles.settings.effects.blend == Blend::Over;
    let (places, entries) = (tiles.projected.len() as u64, tiles.bins.entries.len() as u64);
    let image = tiles.grid.rows() as u64 * size::<Row>();
    let transmittance = if over { tiles.grid.rows() as u64 * size::<ScalarRow>() } else { 0 };
    let errors = tiles.errors.len() as u64 * size::<ScalarRow>();
    let slots = entries * tiles.stride as u64 * size::<f32>();
    // Of the lists: each entry with its Gaussian's splat.
    let lists = entries * (size::<Entry>() + size::<Splat>());
    let (read, written) = match stage {
        // Finds the entries, gives each its slot, and puts them into their lists.
        Stage::Bin => (
            places * size::<Splat>() + entries * (2 * size::<Found>() + INDEX),
            places * INDEX + entries * (size::<Found>() + INDEX + size::<Entry>()),
        ),
        Stage::Blend => (lists, image + transmittance),
        Stage::Loss => {
            let with_errors = if errors > 0 { 2 * image } else { 0 };
            let Traffic { read, written } = match loss {
                Loss::L1 | Loss::L2 => Traffic { read: 2 * image, written: image },
                Loss::L1Dssim { .. } => dssim::traffic(&tiles.grid),
            };
            (read + with_errors, written + errors)
        }
        // Under `Over` the image's rows hold, from here on, what is behind.
        Stage::BlendBwd if over => (lists + 2 * image + errors, image + slots),
        Stage::BlendBwd => (lists + image + errors, slots),
        // A tile's pixels stay in the cache.
        Stage::Fused => (lists + image, slots),
        Stage::Sort | Stage::Project | Stage::ProjectBwd | Stage::Adam => return S::traffic(stage, workspace, splats),
    };
    Traffic { read, written }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{
        Canvas, Gaussian2d, Image, Parameterization, Rasterizer, RenderSettings, Scene2d, profile::Profiler,
    };

    use super::*;
    use crate::{CpuRasterizer, CpuSettings};

    /// Bytes of each stage for two Gaussians, of which one touches two strips of a canvas of 32×10 px and the other one.
    fn profiled(blend: Blend, loss: Loss) -> impl Fn(&str) -> (u64, u64) {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let cpu = cpu.for_2d();
        let at = |x: f32| Gaussian2d {
            mean: Vec2::new(x, 5.0),
            log_scale: Vec2::ZERO,
            rotation: 0.0,
            opacity_logit: if blend == Blend::Over { 1.0 } else { f32::INFINITY },
            color: Vec3::ONE,
        };
        let scene: Scene2d = [at(16.0), at(26.0)].into_iter().collect();
        let mut splats = cpu.upload(&scene, Parameterization::CovarianceFactor).unwrap();
        let target = cpu.upload_target(&Image::filled(32, 10, [0.5; 3]).unwrap()).unwrap();
        let settings = RenderSettings::blended(blend);
        let profile = cpu.profile(&mut splats, &Canvas::new(32, 10), &target, &settings, loss, 1).unwrap();
        assert_eq!(profile.entries, 3);
        move |name| {
            let stage = profile.stages.iter().find(|stage| stage.stage == name).unwrap();
            (stage.traffic.read, stage.traffic.written)
        }
    }

    #[test]
    fn bytes_are_those_of_the_arrays() {
        // Strips hold 20 rows of 192 bytes, an entry is 8 bytes, a splat 64, a Gaussian's gradient 44.
        let of = profiled(Blend::Sum, Loss::L2);
        assert_eq!(of("blend"), (3 * (8 + 64), 20 * 192));
        assert_eq!(of("loss"), (2 * 20 * 192, 20 * 192));
        assert_eq!(of("blend_bwd"), (3 * (8 + 64) + 20 * 192, 3 * 8 * 4));
        assert_eq!(of("fused"), (3 * (8 + 64) + 20 * 192, 3 * 8 * 4));
        assert_eq!(of("project"), (2 * (4 + 8 + 16 + 12), 2 * 64));
        assert_eq!(of("project_bwd"), (2 * (4 + 4 + 64 + 8 + 16) + 3 * (4 + 8 * 4), 2 * 44));
        let state = 8 + 16 + 12 + 64 + 4;
        assert_eq!(of("adam"), (2 * (4 + 44 + 4 + state), 2 * state));
    }

    #[test]
    #[cfg_attr(miri, ignore = "minutes: windows of 121 pixels, timed step by step")]
    fn blending_over_and_structure_cost_more() {
        let (sum, over) = (profiled(Blend::Sum, Loss::L1), profiled(Blend::Over, Loss::PAPER));
        let transmittance = 20 * 64;
        assert_eq!(over("blend"), (sum("blend").0, sum("blend").1 + transmittance));
        assert_eq!(over("blend_bwd"), (sum("blend_bwd").0 + 20 * 192, sum("blend_bwd").1 + 20 * 192 + 3 * 4));
        // Twice the image for the target's mean and square.
        assert_eq!(over("loss"), (sum("loss").0 + 2 * 20 * 192, sum("loss").1));
    }
}
