//! Devices of gs-wgpu for the tests.

use pollster::FutureExt as _;
use std::{num::NonZero, sync::OnceLock};

use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};

/// A device with these kernels and with buffers full of NaN; `None` where the adapter does not
/// support them. `most_groups` limits the work groups in a row of a dispatch.
///
/// # Panics
/// If there is no adapter.
pub(crate) fn with_kernels(kernels: Kernels, most_groups: Option<NonZero<u32>>) -> Option<WgpuRasterizer> {
    let settings = WgpuSettings::default().with(|s| {
        s.poison = true;
        s.kernels = Some(kernels);
        s.most_groups = most_groups;
    });
    match WgpuRasterizer::new(settings).block_on() {
        Ok(rasterizer) => Some(rasterizer),
        Err(error) if kernels == Kernels::Subgroups && error.to_string().contains("has no Subgroups kernels") => None,
        Err(error) => panic!("{error} (`cargo xtask test` installs a software driver)"),
    }
}

/// A device for each kind of kernels that the adapter supports, the portable ones first.
pub(crate) fn of_each_kind(most_groups: Option<NonZero<u32>>) -> Vec<(Kernels, WgpuRasterizer)> {
    let kinds = [Kernels::Portable, Kernels::Subgroups];
    kinds.into_iter().filter_map(|kernels| Some((kernels, with_kernels(kernels, most_groups)?))).collect()
}

/// Devices that all tests share, with at most three work groups in a row, so that every dispatch has
/// several rows. A scene that exceeds the usual limit of 65,535 would be too large for tests.
pub(crate) fn rasterizers() -> &'static [(Kernels, WgpuRasterizer)] {
    static RASTERIZERS: OnceLock<Vec<(Kernels, WgpuRasterizer)>> = OnceLock::new();
    RASTERIZERS.get_or_init(|| of_each_kind(NonZero::new(3)))
}
