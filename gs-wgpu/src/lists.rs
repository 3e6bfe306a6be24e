//! Commands of the stages that make the tiles' lists, `scan` to `ranges`, and of sorts and prefix
//! sums in general.

use crate::{
    dispatch::{Commands, Groups, dispatch, dispatch_some},
    gpu::Gpu,
    layout::{BY_GAUSSIAN, BY_HISTOGRAM, BY_SORT_BLOCK, Status},
    shaders::Variant,
    tiles::{Growing, Tiles, groups_of},
};

/// The input of a sort or prefix sum: the values of the override `WHICH` in `scan.wgsl` and
/// `sort.wgsl`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Which {
    /// The tile counts of all Gaussians.
    Counts = 0,
    /// The tiles' entries, and the histograms of their sort.
    Entries = 1,
    /// The Gaussians, and the histograms of their sort.
    Gaussians = 2,
}

impl Which {
    fn variant(self) -> Variant {
        Variant { constant: Some(("WHICH", self as u32)), ..Variant::default() }
    }
}

/// The arguments of a stable sort.
pub(crate) struct Sorting<'a> {
    pub(crate) which: Which,
    pub(crate) keys: [&'a Growing; 2],
    /// Values that move with the keys.
    pub(crate) order: [&'a Growing; 2],
    /// Number of digits.
    pub(crate) passes: u32,
    /// A work group per block of keys, and one per block of histograms.
    pub(crate) groups: [Groups<'a>; 2],
}

impl Tiles {
    /// Resets the counts of culled Gaussians, before the first stage.
    pub(crate) fn encode_clear(&self, commands: &mut Commands, lists: bool) {
        // Without new lists, the count of Gaussians that touch no tile stays.
        let bytes = Status::COUNTS_BYTES[usize::from(lists)];
        commands.encoder().clear_buffer(&self.status, Status::COUNTS, Some(bytes));
    }

    /// Records stages `scan` and `sizes`.
    pub(crate) fn encode_offsets(&self, gpu: &Gpu, commands: &mut Commands) {
        let (step, status, offsets) = (&self.step, &self.status, &self.offsets.buffer);
        let groups = groups_of(gpu, u64::from(self.gaussians) + 1, 1024);
        self.encode_scan(gpu, commands, Which::Counts, offsets, groups);
        let bindings = [step, offsets, status, &self.indirect];
        let sizes = Variant { constant: Some(("MOST_GROUPS", gpu.most_groups)), ..Variant::default() };
        dispatch(gpu, commands, "sizes", sizes, &bindings, Groups::Direct(1, 1));
    }

    /// Records the first part of stage `adam`: it skips the step if a pixel stayed unfinished.
    pub(crate) fn encode_stop(&self, gpu: &Gpu, commands: &mut Commands) {
        if self.orders_by_pixel() {
            let (numbers, buffers) = ([2, 3], [&self.status, &self.indirect]);
            let variant = Variant::default();
            dispatch_some(gpu, commands, "stop_unfinished", variant, (&numbers, &buffers), Groups::Direct(1, 1));
        }
    }

    /// Records stage `bin`.
    pub(crate) fn encode_bin(&self, gpu: &Gpu, commands: &mut Commands) {
        let (keys, order) = (&self.keys[0].buffer, &self.order[0].buffer);
        let by_pixel = self.orders_by_pixel();
        let mut bindings =
            vec![&self.step, &self.projected.buffer, &self.offsets.buffer, keys, order, &self.entries.buffer];
        if by_pixel {
            bindings.push(&self.depths.buffer);
        }
        let variant = Variant { by_pixel, over: self.variant().over, ..Variant::default() };
        dispatch(gpu, commands, "bin", variant, &bindings, self.indirect(BY_GAUSSIAN));
    }

    /// Records stage `sort`.
    pub(crate) fn encode_sort(&self, gpu: &Gpu, commands: &mut Commands) {
        let groups = [self.indirect(BY_SORT_BLOCK), self.indirect(BY_HISTOGRAM)];
        let (keys, order) = (self.keys.each_ref(), self.order.each_ref());
        let sorting = Sorting { which: Which::Entries, keys, order, passes: self.sort_passes(), groups };
        self.encode_sorting(gpu, commands, &sorting);
    }

    /// Records a sort. The result is in the first buffers after an even number of passes, else in
    /// the second.
    pub(crate) fn encode_sorting(&self, gpu: &Gpu, commands: &mut Commands, sorting: &Sorting<'_>) {
        let Sorting { which, keys, order, passes, groups: [groups, histogram_groups] } = *sorting;
        let (step, status, histograms) = (&self.step, &self.status, &self.histograms.buffer);
        let [keys, order] = [keys, order].map(|both| both.map(|growing| &growing.buffer));
        for pass in 0..passes {
            let [from, to] = if pass % 2 == 0 { [0, 1] } else { [1, 0] };
            let shift = &gpu.shifts[pass as usize];
            let bindings = [step, status, keys[from], histograms, shift];
            dispatch(gpu, commands, "sort_count", which.variant(), &bindings, groups);
            self.encode_scan(gpu, commands, which, histograms, histogram_groups);
            let bindings = [step, status, keys[from], histograms, shift, order[from], keys[to], order[to]];
            dispatch(gpu, commands, "sort_scatter", which.variant(), &bindings, groups);
        }
    }

    /// Records stage `ranges`, and `queue` with a sort at each pixel.
    pub(crate) fn encode_ranges(&self, gpu: &Gpu, commands: &mut Commands) {
        let keys = &self.keys[self.sorted()].buffer;
        let bindings = [&self.step, &self.status, keys, &self.tile_start.buffer, &self.indirect];
        dispatch(gpu, commands, "ranges", Variant::default(), &bindings, groups_of(gpu, self.count(), 64));
        if self.orders_by_pixel() {
            let (tile_start, order) = (&self.tile_start.buffer, &self.order[self.sorted()].buffer);
            let (entries, projected) = (&self.entries.buffer, &self.projected.buffer);
            let [depths, queue] = [&self.depths.buffer, &self.queue.buffer];
            let bindings = [&self.step, tile_start, order, entries, projected, depths, queue];
            dispatch(gpu, commands, "queue_up", Variant::default(), &bindings, gpu.groups(self.count()).into());
        }
    }

    /// Index of the buffer with the result of the sort.
    pub(crate) fn sorted(&self) -> usize {
        self.sort_passes() as usize % 2
    }

    fn encode_scan(&self, gpu: &Gpu, commands: &mut Commands, which: Which, data: &wgpu::Buffer, groups: Groups<'_>) {
        let bindings = [&self.step, data, &self.scan_sums.buffer, &self.status];
        dispatch(gpu, commands, "scan_blocks", which.variant(), &bindings, groups);
        let sums = [&self.step, &self.scan_sums.buffer, &self.status];
        dispatch_some(gpu, commands, "scan_sums", which.variant(), (&[0, 2, 3], &sums), Groups::Direct(1, 1));
        dispatch(gpu, commands, "scan_spread", which.variant(), &bindings, groups);
    }
}
