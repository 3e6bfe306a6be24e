//! What passes of every kind of scene have: projected, the tiles' lists, the image, and their buffers, which grow on demand and are used again.

use gs_core::{AdamRates, Blend, Error, Loss, Participants, RenderSettings, adam::Rate, effects, effects::Order};

use crate::{
    collect::Collected,
    dispatch::{Commands, Groups},
    gpu::{Gpu, STORAGE},
    layout::{QUEUED_BYTES, SPLAT_BYTES, Status, Step},
    loop_limit::{check_tiles, longest_list, too_long},
    shaders::{SORT_BITS, SORT_BLOCK, TILE_COLUMNS, TILE_ROWS, Variant, stride},
    splats::UNIFORM,
};

/// Where in `indirect` the sizes of a dispatch stand, bytes (in the shaders: words): an invocation a Gaussian, a group a block of sorting, a
/// group a block of the scan of sorting's histograms, an invocation an SH coefficient.
pub(crate) const BY_GAUSSIAN: u64 = 0;
pub(crate) const BY_SORT_BLOCK: u64 = 12;
pub(crate) const BY_HISTOGRAM: u64 = 24;
pub(crate) const BY_COEFFICIENT: u64 = 36;

/// Entries there is room for at first, at least.
const FIRST_CAPACITY: u64 = 1 << 14;

/// Bytes of a pixel: RGB and one more.
pub(crate) const PIXEL_BYTES: u64 = 16;

/// Bytes of a splat's depth: at its mean, its slope, and the index.
pub(crate) const DEPTH_BYTES: u64 = 16;

/// Steps of 3e-4 of the depth: Gaussians of a surface are not much farther apart.
const LEAST_DEPTH_BITS: u32 = 16;

/// Those of an `f32` between 2⁻⁸ and 2²⁴.
const MOST_DEPTH_BITS: u32 = 28;

/// Bytes of an entry's sums of so many numbers, in fixed-point numbers of 64 bits, and of their units.
pub(crate) fn totals_bytes(stride: u64) -> u64 {
    8 * stride + 4
}

/// A buffer that is replaced by a larger one when that is needed; its contents are lost then.
#[derive(Debug)]
pub(crate) struct Growing {
    label: &'static str,
    pub(crate) buffer: wgpu::Buffer,
}

impl Growing {
    pub(crate) fn new(gpu: &Gpu, label: &'static str) -> Result<Self, Error> {
        Ok(Self { label, buffer: gpu.allocate(label, 16, STORAGE)? })
    }

    pub(crate) fn ensure(&mut self, gpu: &Gpu, bytes: u64) -> Result<(), Error> {
        if self.buffer.size() < bytes {
            self.buffer = gpu.allocate(self.label, bytes, STORAGE)?;
        }
        Ok(())
    }
}

/// One pass's tiles, whatever kind of scene is on them.
#[derive(Debug)]
pub(crate) struct Tiles {
    /// Columns and rows of the image.
    pub(crate) size: [u32; 2],
    pub(crate) settings: RenderSettings,
    /// Gaussians of the pass.
    pub(crate) gaussians: u32,
    pub(crate) step: wgpu::Buffer,
    pub(crate) status: wgpu::Buffer,
    pub(crate) indirect: wgpu::Buffer,
    /// In the order in which they are blended.
    pub(crate) projected: Growing,
    /// First entry of each splat, `[N + 1]`.
    pub(crate) offsets: Growing,
    pub(crate) scan_sums: Growing,
    /// Tile of each entry, and the entry's number; sorting goes back and forth.
    pub(crate) keys: [Growing; 2],
    pub(crate) order: [Growing; 2],
    pub(crate) entries: Growing,
    pub(crate) histograms: Growing,
    pub(crate) tile_start: Growing,
    /// What each entry's Gaussian receives.
    pub(crate) slots: Growing,
    /// In the order of depth at each pixel: depths of the projected, the tiles' entries in a queue, and what each of those receives, in
    /// fixed-point numbers.
    pub(crate) depths: Growing,
    pub(crate) queue: Growing,
    pub(crate) totals: Growing,
    pub(crate) image: Growing,
    pub(crate) v_image: Growing,
    /// Partial sums of the loss, and of dot products.
    pub(crate) partial: Growing,
    /// Of D-SSIM.
    pub(crate) moments: Growing,
    pub(crate) derivatives: Growing,
    /// A target that this background or rendering had to complete.
    pub(crate) completed: Growing,
    /// Entries that there is room for.
    capacity: u64,
}

/// Work groups of `size` invocations for `count`.
pub(crate) fn groups_of(gpu: &Gpu, count: u64, size: u64) -> Groups<'static> {
    gpu.groups(count.div_ceil(size)).into()
}

impl Tiles {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, Error> {
        let growing = |label| Growing::new(gpu, label);
        let status = gpu.allocate("status", size_of::<Status>() as u64, STORAGE)?;
        gpu.write(&status, bytemuck::bytes_of(&Status::default()));
        Ok(Self {
            size: [1, 1],
            settings: RenderSettings::default(),
            gaussians: 0,
            step: gpu.allocate("step", size_of::<Step>() as u64, UNIFORM)?,
            status,
            indirect: gpu.allocate("dispatch sizes", 48, STORAGE | wgpu::BufferUsages::INDIRECT)?,
            projected: growing("projected")?,
            offsets: growing("entry offsets")?,
            scan_sums: growing("scan sums")?,
            keys: [growing("tile entries")?, growing("tile entries")?],
            order: [growing("tile entries")?, growing("tile entries")?],
            entries: growing("tile entries")?,
            histograms: growing("sorting histograms")?,
            tile_start: growing("tile starts")?,
            slots: growing("gradients of tile entries")?,
            depths: growing("depths by pixel")?,
            queue: growing("queues of tile entries")?,
            totals: growing("sums of tile entries")?,
            image: growing("the image")?,
            v_image: growing("the image's gradient")?,
            partial: growing("partial sums")?,
            moments: growing("D-SSIM's moments")?,
            derivatives: growing("D-SSIM's derivatives")?,
            completed: growing("the target")?,
            capacity: 0,
        })
    }

    fn across_and_down(&self) -> [u32; 2] {
        let [width, height] = self.size;
        [width.div_ceil(TILE_COLUMNS), height.div_ceil(TILE_ROWS)]
    }

    pub(crate) fn count(&self) -> u64 {
        let [across, down] = self.across_and_down();
        u64::from(across) * u64::from(down)
    }

    pub(crate) fn pixels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }

    pub(crate) fn variant(&self) -> Variant {
        let effects = &self.settings.effects;
        let (over, collected) = (effects.blend == Blend::Over, Collected::of(effects.statistics));
        Variant { over, collected, ..Variant::default() }
    }

    /// Whether each pixel has an order of its own.
    pub(crate) fn orders_by_pixel(&self) -> bool {
        let effects = &self.settings.effects;
        effects.blend == Blend::Over && effects.order == Order::PerPixel
    }

    /// Passes of the sort: as many digits as the last tile's number has, and an entry's depth.
    pub(crate) fn sort_passes(&self) -> u32 {
        (self.list_bits() + self.depth_bits()).div_ceil(SORT_BITS)
    }

    /// Of the last list's number.
    fn list_bits(&self) -> u32 {
        let last = (self.count() - 1) as u32;
        u32::BITS - last.leading_zeros()
    }

    /// By which entries are sorted within a list, where pixels have orders of their own.
    fn depth_bits(&self) -> u32 {
        if !self.orders_by_pixel() {
            return 0;
        }
        // As many as the last pass has room for.
        let bits = (self.list_bits() + LEAST_DEPTH_BITS).next_multiple_of(SORT_BITS).min(u32::BITS) - self.list_bits();
        bits.min(MOST_DEPTH_BITS)
    }

    pub(crate) fn indirect(&self, offset: u64) -> Groups<'_> {
        Groups::Indirect(&self.indirect, offset)
    }

    /// Makes the pass one of so many Gaussians on an image of this size.
    pub(crate) fn set(
        &mut self,
        gpu: &Gpu,
        gaussians: usize,
        size: [u32; 2],
        settings: &RenderSettings,
    ) -> Result<(), Error> {
        (self.size, self.settings, self.gaussians) = (size, *settings, gaussians as u32);
        check_tiles(gpu, size, self.across_and_down())?;
        let n = gaussians as u64;
        self.projected.ensure(gpu, n * SPLAT_BYTES)?;
        self.offsets.ensure(gpu, (n + 1) * 4)?;
        self.scan_sums.ensure(gpu, (n + 1).div_ceil(1024) * 4)?;
        self.tile_start.ensure(gpu, (self.count() + 1) * 4)?;
        self.image.ensure(gpu, self.pixels() * PIXEL_BYTES)?;
        if self.orders_by_pixel() {
            self.depths.ensure(gpu, n * DEPTH_BYTES)?;
        }
        match self.capacity {
            0 => self.grow(gpu, FIRST_CAPACITY.max(2 * n)),
            // Another pass may have needed less of each.
            capacity => self.ensure_entries(gpu, capacity),
        }
    }

    /// Makes room for so many entries; lists that there were are lost.
    fn grow(&mut self, gpu: &Gpu, entries: u64) -> Result<(), Error> {
        for growing in self.keys.iter_mut().chain(&mut self.order) {
            growing.ensure(gpu, entries * 4)?;
        }
        self.entries.ensure(gpu, entries * 8)?;
        self.ensure_entries(gpu, entries)?;
        self.ensure_sorting(gpu, entries)?;
        self.capacity = entries;
        Ok(())
    }

    /// Makes room for what this pass's order needs of so many entries.
    fn ensure_entries(&mut self, gpu: &Gpu, entries: u64) -> Result<(), Error> {
        if self.orders_by_pixel() { self.queue.ensure(gpu, entries * QUEUED_BYTES) } else { Ok(()) }
    }

    /// Makes room for what all entries' Gaussians receive: a pass that is only looked at needs none.
    pub(crate) fn ensure_slots(&mut self, gpu: &Gpu) -> Result<(), Error> {
        let stride = u64::from(stride(self.variant()));
        self.slots.ensure(gpu, self.capacity * stride * 4)?;
        if self.orders_by_pixel() { self.totals.ensure(gpu, self.capacity * totals_bytes(stride)) } else { Ok(()) }
    }

    /// Makes room to sort so many keys.
    pub(crate) fn ensure_sorting(&mut self, gpu: &Gpu, keys: u64) -> Result<(), Error> {
        let histograms = keys.div_ceil(u64::from(SORT_BLOCK)) << SORT_BITS;
        self.histograms.ensure(gpu, histograms * 4)?;
        self.scan_sums.ensure(gpu, histograms.div_ceil(1024) * 4)
    }

    /// What this pass tells the device, but for what the kind of scene adds.
    pub(crate) fn describe(&self, gpu: &Gpu, loss: Option<Loss>, rates: Option<&AdamRates>) -> Step {
        let (accuracy, values) = (&self.settings.accuracy, 3.0 * self.pixels() as f64);
        let (alpha_max, transmittance_min) = (accuracy.alpha_max, accuracy.transmittance_min);
        let (pointwise, dssim) = match loss {
            Some(Loss::L1Dssim { lambda }) => (1.0 - f64::from(lambda), f64::from(lambda)),
            _ => (1.0, 0.0),
        };
        let mut step = Step {
            size: self.size,
            tiles: self.across_and_down(),
            background: self.settings.background_color(),
            gaussians: self.gaussians,
            alpha_cut: accuracy.alpha_cut,
            alpha_max,
            transmittance_min,
            entry_capacity: self.capacity as u32,
            pointwise_scale: (pointwise / values) as f32,
            dssim_scale: (dssim / values) as f32,
            per_value: (1.0 / values) as f32,
            depth_bits: self.depth_bits(),
            longest_list: longest_list(gpu, self.orders_by_pixel()),
            opaque: u32::from(self.settings.effects.blend == Blend::Sum),
            collect: u32::from(self.settings.effects.statistics != effects::Statistics::None),
            ..Step::default()
        };
        if let Some(r) = rates {
            (step.epsilon, step.min_scale, step.max_scale) = (r.epsilon, r.min_scale, r.max_scale);
            step.visible_only = u32::from(r.participants == Participants::Visible);
            let groups = [r.mean, r.scale, r.rotation, r.opacity, r.color, r.color_rest];
            step.rates = groups.map(|g: Rate| [g.learning_rate, g.beta1, g.beta2, 1.0 - g.beta1]);
            step.decays = groups.map(|g: Rate| {
                let [ln1, ln2] = [g.beta1, g.beta2].map(|beta| f64::from(beta).ln() as f32);
                [ln1, ln2, 1.0 - g.beta2, 0.0]
            });
            let count = self.gaussians.max(1) as f32;
            (step.decays[1][3], step.decays[3][3]) = (r.penalty.scale / (3.0 * count), r.penalty.opacity / count);
        }
        step
    }

    /// Copies what became of the pass into a buffer that can be mapped.
    pub(crate) fn encode_status(&self, commands: &mut Commands, staging: &wgpu::Buffer) {
        commands.encoder().copy_buffer_to_buffer(&self.status, 0, staging, 0, size_of::<Status>() as u64);
    }

    /// What became of the pass, once it has been done.
    pub(crate) async fn read_status(&self, gpu: &Gpu) -> Result<Status, Error> {
        Ok(gpu.read(&self.status, 1).await?[0])
    }

    /// Makes room for what a pass asked for in vain, and forgets that it asked.
    ///
    /// # Errors
    /// Where there is not so much room, or a list is longer than the adapter can loop over.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, status: &Status) -> Result<(), Error> {
        gpu.write(&self.status, bytemuck::bytes_of(&Status::default()));
        if status.longest > 0 {
            return Err(too_long(gpu, status.longest, self.orders_by_pixel()));
        }
        let entries = u64::from(status.overflow);
        // With room for some more, if there is so much memory.
        self.grow(gpu, entries + entries / 4).or_else(|_| self.grow(gpu, entries))
    }
}
