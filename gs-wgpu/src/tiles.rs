//! The buffers of a pass that 2D and 3D scenes share: projected splats, tile lists, image. They
//! grow on demand and are reused.

use gs_core::{AdamRates, Blend, Error, Loss, Participants, RenderSettings, adam::Rate, effects, effects::Order};

use crate::{
    collect::Collected,
    dispatch::{Commands, Groups},
    gpu::{Gpu, STORAGE, UNIFORM},
    layout::{QUEUED_BYTES, SPLAT_BYTES, Status, Step},
    loop_limit::{check_tiles, longest_list, too_long},
    shaders::{SORT_BITS, SORT_BLOCK, TILE_COLUMNS, TILE_ROWS, Variant, stride},
};

/// Smallest initial capacity, entries.
const FIRST_CAPACITY: u64 = 1 << 12;

/// Bytes of a pixel: RGB and a fourth number.
pub(crate) const PIXEL_BYTES: u64 = 16;

/// Bytes of a splat's depth: at its mean, its slopes, and the index.
pub(crate) const DEPTH_BYTES: u64 = 16;

/// Fewest depth bits of a sort key: steps of 3e-4 of the depth, about the distance between
/// neighbours on a surface.
const LEAST_DEPTH_BITS: u32 = 16;

/// Largest number of depth bits of a sort key: those of an `f32` between 2⁻⁸ and 2²⁴.
const MOST_DEPTH_BITS: u32 = 28;

/// Bytes of an entry's `stride` sums as 64-bit fixed-point numbers, and of their units.
pub(crate) fn totals_bytes(stride: u64) -> u64 {
    8 * stride + 4
}

/// A buffer that is replaced by a larger one on demand. Its contents are lost then.
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

/// The buffers of one pass that 2D and 3D scenes share.
#[derive(Debug)]
pub(crate) struct Tiles {
    /// Columns and rows of the image.
    pub(crate) size: [u32; 2],
    pub(crate) settings: RenderSettings,
    /// Number of Gaussians.
    pub(crate) gaussians: u32,
    pub(crate) step: wgpu::Buffer,
    pub(crate) status: wgpu::Buffer,
    pub(crate) indirect: wgpu::Buffer,
    /// Splats in the order of blending.
    pub(crate) projected: Growing,
    /// First entry of each splat, `[N + 1]`.
    pub(crate) offsets: Growing,
    pub(crate) scan_sums: Growing,
    /// Tile of each entry, and the entry's number; the sort alternates between two buffers.
    pub(crate) keys: [Growing; 2],
    pub(crate) order: [Growing; 2],
    pub(crate) entries: Growing,
    pub(crate) histograms: Growing,
    pub(crate) tile_start: Growing,
    /// The gradient of each entry.
    pub(crate) slots: Growing,
    /// Depths of the splats, with a sort at each pixel.
    pub(crate) depths: Growing,
    /// Entries of the tiles in the order of their least depths, with a sort at each pixel.
    pub(crate) queue: Growing,
    /// Gradients of queued entries in fixed-point numbers, with a sort at each pixel.
    pub(crate) totals: Growing,
    pub(crate) image: Growing,
    pub(crate) v_image: Growing,
    /// Partial sums of the loss, and of dot products.
    pub(crate) partial: Growing,
    /// D-SSIM's moments.
    pub(crate) moments: Growing,
    /// D-SSIM's derivatives.
    pub(crate) derivatives: Growing,
    /// A masked target, completed with the background and the rendering.
    pub(crate) completed: Growing,
    /// Capacity, entries.
    capacity: u64,
}

/// Work groups of `size` invocations for `count` invocations.
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

    /// Whether the Gaussians are sorted at each pixel.
    pub(crate) fn orders_by_pixel(&self) -> bool {
        let effects = &self.settings.effects;
        effects.blend == Blend::Over && effects.order == Order::PerPixel
    }

    /// Number of passes of the sort by tile, and by depth if needed.
    pub(crate) fn sort_passes(&self) -> u32 {
        (self.list_bits() + self.depth_bits()).div_ceil(SORT_BITS)
    }

    /// Bits of the last tile's number.
    fn list_bits(&self) -> u32 {
        let last = (self.count() - 1) as u32;
        u32::BITS - last.leading_zeros()
    }

    /// Bits of depth by which a tile's entries are sorted; 0 without a sort at each pixel.
    fn depth_bits(&self) -> u32 {
        if !self.orders_by_pixel() {
            return 0;
        }
        // The depth gets as many bits as fit into the last pass.
        let bits = (self.list_bits() + LEAST_DEPTH_BITS).next_multiple_of(SORT_BITS).min(u32::BITS) - self.list_bits();
        bits.min(MOST_DEPTH_BITS)
    }

    pub(crate) fn indirect(&self, offset: u64) -> Groups<'_> {
        Groups::Indirect(&self.indirect, offset)
    }

    /// Sets the number of Gaussians, the image's size and the settings.
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
            // An earlier pass may have needed fewer buffers.
            capacity => self.ensure_entries(gpu, capacity),
        }
    }

    /// Enlarges the capacity. Existing lists are lost.
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

    /// Enlarges the queue, if this pass needs one.
    fn ensure_entries(&mut self, gpu: &Gpu, entries: u64) -> Result<(), Error> {
        if self.orders_by_pixel() { self.queue.ensure(gpu, entries * QUEUED_BYTES) } else { Ok(()) }
    }

    /// Enlarges the buffers of the entries' gradients, which only a backward pass needs.
    pub(crate) fn ensure_slots(&mut self, gpu: &Gpu) -> Result<(), Error> {
        let stride = u64::from(stride(self.variant()));
        self.slots.ensure(gpu, self.capacity * stride * 4)?;
        if self.orders_by_pixel() { self.totals.ensure(gpu, self.capacity * totals_bytes(stride)) } else { Ok(()) }
    }

    /// Enlarges the buffers for sorting `keys` keys.
    pub(crate) fn ensure_sorting(&mut self, gpu: &Gpu, keys: u64) -> Result<(), Error> {
        let histograms = keys.div_ceil(u64::from(SORT_BLOCK)) << SORT_BITS;
        self.histograms.ensure(gpu, histograms * 4)?;
        self.scan_sums.ensure(gpu, histograms.div_ceil(1024) * 4)
    }

    /// The uniform of this pass without the numbers of the kind of scene.
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
            step.fixed = r.fixed;
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

    /// Copies the status of the pass into a buffer that can be mapped.
    pub(crate) fn encode_status(&self, commands: &mut Commands, staging: &wgpu::Buffer) {
        commands.encoder().copy_buffer_to_buffer(&self.status, 0, staging, 0, size_of::<Status>() as u64);
    }

    /// The status of the pass, once it is done.
    pub(crate) async fn read_status(&self, gpu: &Gpu) -> Result<Status, Error> {
        Ok(gpu.read(&self.status, 1).await?[0])
    }

    /// Enlarges the buffers that were too small for a pass, and resets its status.
    ///
    /// # Errors
    /// Fails if memory runs out, or if a list is longer than the adapter can loop over.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, status: &Status) -> Result<(), Error> {
        gpu.write(&self.status, bytemuck::bytes_of(&Status::default()));
        if status.longest > 0 {
            return Err(too_long(gpu, status.longest, self.orders_by_pixel()));
        }
        let entries = u64::from(status.overflow);
        // With a reserve, if there is enough memory.
        self.grow(gpu, entries + entries / 4).or_else(|_| self.grow(gpu, entries))
    }
}
