//! The buffers of one pass through the stages, and the stages as commands. Buffers grow on demand and are used again.

use gs_core::{AdamRates, Blend, Canvas, Chart, Error, Loss, RenderSettings, adam::Rate, effects};

use crate::{
    cloud::{PlanarCloud, UNIFORM},
    dispatch::{Commands, Groups, dispatch, dispatch_some},
    gpu::{Gpu, STORAGE},
    layout::{CONJUGATE_BYTES, Gradient, SPLAT_BYTES, Status, Step},
    shaders::{
        DSSIM_GROUP, Kernels, LANES, Pass, SORT_BITS, SORT_BLOCK, TILE_COLUMNS, Tiling, Variant, stride, tiling,
    },
    target::PlanarTarget,
};

/// Where in `indirect` the sizes of a dispatch stand, bytes: an invocation a Gaussian, an invocation an entry, a group a block of sorting,
/// a group a block of the scan of sorting's histograms.
const BY_GAUSSIAN: u64 = 0;
const BY_ENTRY: u64 = 12;
const BY_SORT_BLOCK: u64 = 24;
const BY_HISTOGRAM: u64 = 36;

/// Entries there is room for at first, at least.
const FIRST_CAPACITY: u64 = 1 << 14;

/// Bytes of a pixel: RGB and one more.
pub(crate) const PIXEL_BYTES: u64 = 16;

/// Bytes of a channel of a pixel in D-SSIM's moments, and in its derivatives, which are one number less and room for it.
pub(crate) const MOMENTS_BYTES: u64 = 16;

/// Places that D-SSIM's derivatives are kept by.
const STRIP: u64 = 8;

/// A buffer that is replaced by a larger one when that is needed; its contents are lost then.
#[derive(Debug)]
pub(crate) struct Growing {
    label: &'static str,
    usage: wgpu::BufferUsages,
    pub(crate) buffer: wgpu::Buffer,
}

impl Growing {
    fn new(gpu: &Gpu, label: &'static str) -> Result<Self, Error> {
        Ok(Self { label, usage: STORAGE, buffer: gpu.allocate(label, 16, STORAGE)? })
    }

    fn ensure(&mut self, gpu: &Gpu, bytes: u64) -> Result<(), Error> {
        if self.buffer.size() < bytes {
            self.buffer = gpu.allocate(self.label, bytes, self.usage)?;
        }
        Ok(())
    }
}

/// One pass's inputs and results.
#[derive(Debug)]
pub(crate) struct Workspace {
    pub(crate) canvas: Canvas,
    pub(crate) settings: RenderSettings,
    /// Gaussians of the pass.
    gaussians: u32,
    step: wgpu::Buffer,
    status: wgpu::Buffer,
    indirect: wgpu::Buffer,
    splats: Growing,
    /// First entry of each Gaussian, `[N + 1]`.
    offsets: Growing,
    scan_sums: Growing,
    /// Tile of each entry, and the entry's number; sorting goes back and forth.
    keys: [Growing; 2],
    order: [Growing; 2],
    pub(crate) entries: Growing,
    histograms: Growing,
    tile_start: Growing,
    /// What each entry's Gaussian receives.
    slots: Growing,
    pub(crate) image: Growing,
    v_image: Growing,
    /// Partial sums of the loss, and of dot products.
    partial: Growing,
    /// Of D-SSIM.
    moments: Growing,
    derivatives: Growing,
    pub(crate) gradients: Growing,
    /// The vectors and scalars of `solve_colors`.
    vectors: Growing,
    scalars: Growing,
    /// How pixels are dealt out on this adapter.
    tiling: Tiling,
    /// Entries that there is room for.
    capacity: u64,
    /// The cloud's edition that the lists were made for.
    pub(crate) edition: Option<u64>,
}

/// Work groups of `size` invocations for `count`.
fn groups_of(gpu: &Gpu, count: u64, size: u64) -> Groups<'static> {
    gpu.groups(count.div_ceil(size)).into()
}

impl Workspace {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, Error> {
        let growing = |label| Growing::new(gpu, label);
        let status = gpu.allocate("status", size_of::<Status>() as u64, STORAGE)?;
        gpu.write(&status, bytemuck::bytes_of(&Status::default()));
        Ok(Self {
            canvas: Canvas::new(1, 1),
            settings: RenderSettings::default(),
            gaussians: 0,
            step: gpu.allocate("step", size_of::<Step>() as u64, UNIFORM)?,
            status,
            indirect: gpu.allocate("dispatch sizes", 48, STORAGE | wgpu::BufferUsages::INDIRECT)?,
            splats: growing("splats")?,
            offsets: growing("entry offsets")?,
            scan_sums: growing("scan sums")?,
            keys: [growing("tile entries")?, growing("tile entries")?],
            order: [growing("tile entries")?, growing("tile entries")?],
            entries: growing("tile entries")?,
            histograms: growing("sorting histograms")?,
            tile_start: growing("tile starts")?,
            slots: growing("gradients of tile entries")?,
            image: growing("the image")?,
            v_image: growing("the image's gradient")?,
            partial: growing("partial sums")?,
            moments: growing("D-SSIM's moments")?,
            derivatives: growing("D-SSIM's derivatives")?,
            gradients: growing("gradients")?,
            vectors: growing("vectors of conjugate gradients")?,
            scalars: growing("scalars of conjugate gradients")?,
            tiling: tiling(gpu.kernels),
            capacity: 0,
            edition: None,
        })
    }

    fn tiles(&self) -> [u32; 2] {
        [self.canvas.width.div_ceil(TILE_COLUMNS), self.canvas.height.div_ceil(self.tiling.tile_rows)]
    }

    fn tile_count(&self) -> u64 {
        let [across, down] = self.tiles();
        u64::from(across) * u64::from(down)
    }

    /// Lists of all tiles.
    fn list_count(&self) -> u64 {
        self.tile_count() * u64::from(self.tiling.classes)
    }

    pub(crate) fn pixels(&self) -> u64 {
        u64::from(self.canvas.width) * u64::from(self.canvas.height)
    }

    fn variant(&self, cloud: &PlanarCloud) -> Variant {
        Variant {
            over: self.settings.effects.blend == Blend::Over,
            local_frame: cloud.chart == Chart::LocalFrame,
            ..Variant::default()
        }
    }

    /// Passes of the sort: as many digits as the last tile's number has.
    pub(crate) fn sort_passes(&self) -> u32 {
        let last = (self.list_count() - 1) as u32;
        (u32::BITS - last.leading_zeros()).div_ceil(SORT_BITS)
    }

    /// Makes the pass one of this cloud, view and settings; lists that were made for anything else are forgotten.
    pub(crate) fn set(
        &mut self,
        gpu: &Gpu,
        cloud: &PlanarCloud,
        canvas: &Canvas,
        settings: &RenderSettings,
    ) -> Result<(), Error> {
        let same = self.canvas == *canvas && self.settings == *settings && self.edition == Some(cloud.edition);
        if !same {
            self.edition = None;
        }
        (self.canvas, self.settings, self.gaussians) = (*canvas, *settings, cloud.len as u32);
        let n = cloud.len as u64;
        self.splats.ensure(gpu, n * SPLAT_BYTES)?;
        self.offsets.ensure(gpu, (n + 1) * 4)?;
        self.scan_sums.ensure(gpu, (n + 1).div_ceil(1024) * 4)?;
        self.tile_start.ensure(gpu, (self.list_count() + 1) * 4)?;
        self.image.ensure(gpu, self.pixels() * PIXEL_BYTES)?;
        self.gradients.ensure(gpu, n * size_of::<Gradient>() as u64)?;
        if self.capacity == 0 {
            self.grow(gpu, FIRST_CAPACITY.max(4 * n))?;
        }
        Ok(())
    }

    /// Makes room for so many entries.
    pub(crate) fn grow(&mut self, gpu: &Gpu, entries: u64) -> Result<(), Error> {
        for growing in self.keys.iter_mut().chain(&mut self.order) {
            growing.ensure(gpu, entries * 4)?;
        }
        self.entries.ensure(gpu, entries * 8)?;
        self.slots.ensure(gpu, entries * u64::from(stride(true)) * 4)?;
        let histograms = entries.div_ceil(u64::from(SORT_BLOCK)) << SORT_BITS;
        self.histograms.ensure(gpu, histograms * 4)?;
        self.scan_sums.ensure(gpu, histograms.div_ceil(1024) * 4)?;
        self.capacity = entries;
        self.edition = None;
        Ok(())
    }

    /// What this pass tells the device.
    pub(crate) fn describe(&self, cloud: &PlanarCloud, loss: Option<Loss>, rates: Option<&AdamRates>) -> Step {
        let (accuracy, values) = (&self.settings.accuracy, 3.0 * self.pixels() as f64);
        let (pointwise, dssim) = match loss {
            Some(Loss::L1Dssim { lambda }) => (1.0 - f64::from(lambda), f64::from(lambda)),
            _ => (1.0, 0.0),
        };
        let mut step = Step {
            origin: self.canvas.origin.to_array(),
            pixels_per_unit: self.canvas.scale().to_array(),
            size: [self.canvas.width, self.canvas.height],
            tiles: self.tiles(),
            backdrop: self.settings.backdrop(),
            gaussians: self.gaussians,
            alpha_cut: accuracy.alpha_cut,
            alpha_max: accuracy.alpha_max,
            transmittance_min: accuracy.transmittance_min,
            entry_capacity: self.capacity as u32,
            pointwise_scale: (pointwise / values) as f32,
            dssim_scale: (dssim / values) as f32,
            per_value: (1.0 / values) as f32,
            opaque: u32::from(self.settings.effects.blend == Blend::Sum || !cloud.has_opacity),
            collect: u32::from(self.settings.effects.statistics != effects::Statistics::None),
            ..Step::default()
        };
        if let Some(r) = rates {
            (step.epsilon, step.min_scale, step.max_scale) = (r.epsilon, r.min_scale, r.max_scale);
            let groups = [r.mean, r.scale, r.rotation, r.opacity, r.color];
            step.rates = groups.map(|g: Rate| [g.learning_rate, g.beta1, g.beta2, 1.0 - g.beta1]);
            step.decays = groups.map(|g: Rate| {
                let [ln1, ln2] = [g.beta1, g.beta2].map(|beta| f64::from(beta).ln() as f32);
                [ln1, ln2, 1.0 - g.beta2, 0.0]
            });
        }
        step
    }

    pub(crate) fn write_step(&self, gpu: &Gpu, step: &Step) {
        gpu.write(&self.step, bytemuck::bytes_of(step));
    }

    /// Stages `project` to `ranges`; without `lists` only `project`, and the last lists stay.
    pub(crate) fn encode_lists(&self, gpu: &Gpu, commands: &mut Commands, cloud: &PlanarCloud, lists: bool) {
        self.encode_project(gpu, commands, cloud, lists);
        if lists {
            self.encode_offsets(gpu, commands);
            self.encode_bin(gpu, commands, cloud);
            self.encode_sort(gpu, commands);
            self.encode_ranges(gpu, commands);
        }
    }

    /// Stage `project`; with `lists` it counts the tiles that each Gaussian touches.
    pub(crate) fn encode_project(&self, gpu: &Gpu, commands: &mut Commands, cloud: &PlanarCloud, lists: bool) {
        let (step, status, offsets) = (&self.step, &self.status, &self.offsets.buffer);
        let n = u64::from(self.gaussians);
        commands.encoder().clear_buffer(status, 16, Some(if lists { 16 } else { 12 }));
        if lists {
            // What `ranges` writes to, cleared here so that all the stages are one pass.
            commands.encoder().clear_buffer(&self.tile_start.buffer, 0, None);
        }
        let variant = Variant { lists, ..self.variant(cloud) };
        let variant = Variant { over: false, ..variant };
        let groups = groups_of(gpu, n + 1, 64);
        if !lists {
            let bindings = [step, &cloud.gaussians, &self.splats.buffer, status];
            dispatch_some(gpu, commands, "project", variant, (&[0, 1, 2, 4], &bindings), groups);
            return;
        }
        let bindings = [step, &cloud.gaussians, &self.splats.buffer, offsets, status];
        dispatch(gpu, commands, "project", variant, &bindings, groups);
    }

    /// Stages `scan`, of the counts, and `sizes`.
    pub(crate) fn encode_offsets(&self, gpu: &Gpu, commands: &mut Commands) {
        let (step, status, offsets) = (&self.step, &self.status, &self.offsets.buffer);
        self.encode_scan(gpu, commands, 0, offsets, groups_of(gpu, u64::from(self.gaussians) + 1, 1024));
        let bindings = [step, offsets, status, &self.indirect];
        let sizes = Variant { constant: Some(("MOST_GROUPS", gpu.most_groups)), ..Variant::default() };
        dispatch(gpu, commands, "sizes", sizes, &bindings, Groups::Direct(1, 1));
    }

    /// Stage `bin`.
    pub(crate) fn encode_bin(&self, gpu: &Gpu, commands: &mut Commands, cloud: &PlanarCloud) {
        let variant = Variant { local_frame: false, ..self.variant(cloud) };
        let (keys, order) = (&self.keys[0].buffer, &self.order[0].buffer);
        let bindings = [&self.step, &self.splats.buffer, &self.offsets.buffer, keys, order, &self.entries.buffer];
        dispatch(gpu, commands, "bin", variant, &bindings, self.indirect(BY_GAUSSIAN));
    }

    /// Stage `sort`.
    pub(crate) fn encode_sort(&self, gpu: &Gpu, commands: &mut Commands) {
        let (status, plain) = (&self.status, Variant::default());
        let keys = [&self.keys[0].buffer, &self.keys[1].buffer];
        let order = [&self.order[0].buffer, &self.order[1].buffer];
        for pass in 0..self.sort_passes() {
            let [from, to] = if pass % 2 == 0 { [0, 1] } else { [1, 0] };
            let shift = &gpu.shifts[pass as usize];
            let bindings = [status, keys[from], &self.histograms.buffer, shift];
            let groups = self.indirect(BY_SORT_BLOCK);
            dispatch_some(gpu, commands, "sort_count", plain, (&[1, 2, 3, 4], &bindings), groups);
            self.encode_scan(gpu, commands, 1, &self.histograms.buffer, self.indirect(BY_HISTOGRAM));
            let bindings = [status, keys[from], &self.histograms.buffer, shift, order[from], keys[to], order[to]];
            dispatch_some(gpu, commands, "sort_scatter", plain, (&[1, 2, 3, 4, 5, 6, 7], &bindings), groups);
        }
    }

    /// Stage `ranges`.
    pub(crate) fn encode_ranges(&self, gpu: &Gpu, commands: &mut Commands) {
        let bindings = [&self.step, &self.status, &self.keys[self.sorted()].buffer, &self.tile_start.buffer];
        dispatch(gpu, commands, "ranges", Variant::default(), &bindings, self.indirect(BY_ENTRY));
    }

    fn indirect(&self, offset: u64) -> Groups<'_> {
        Groups::Indirect(&self.indirect, offset)
    }

    /// Which of the two buffers sorting ends in.
    fn sorted(&self) -> usize {
        self.sort_passes() as usize % 2
    }

    fn encode_scan(&self, gpu: &Gpu, commands: &mut Commands, which: u32, data: &wgpu::Buffer, groups: Groups<'_>) {
        let variant = Variant { constant: Some(("WHICH", which)), ..Variant::default() };
        let bindings = [&self.step, data, &self.scan_sums.buffer, &self.status];
        dispatch(gpu, commands, "scan_blocks", variant, &bindings, groups);
        let sums = [&self.step, &self.scan_sums.buffer, &self.status];
        dispatch_some(gpu, commands, "scan_sums", variant, (&[0, 2, 3], &sums), Groups::Direct(1, 1));
        dispatch(gpu, commands, "scan_spread", variant, &bindings, groups);
    }

    /// Stage `blend`.
    pub(crate) fn encode_blend(&self, gpu: &Gpu, commands: &mut Commands, cloud: &PlanarCloud) {
        let variant = Variant { local_frame: false, ..self.variant(cloud) };
        let mut bindings = self.lists().to_vec();
        bindings.push(&self.image.buffer);
        let entry_point = if gpu.kernels == Kernels::Vectors { "blend_vectors" } else { "blend" };
        dispatch(gpu, commands, entry_point, variant, &bindings, gpu.groups(self.tile_count()).into());
    }

    /// Stage `loss`: the loss into the status, its gradient into `v_image`. `None`: the bare difference, and no loss.
    pub(crate) fn encode_loss(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        target: &PlanarTarget,
        loss: Option<Loss>,
    ) -> Result<(), Error> {
        let pixels = self.pixels();
        self.v_image.ensure(gpu, pixels * PIXEL_BYTES)?;
        let kind = match loss {
            None => 0,
            Some(Loss::L2) => 1,
            Some(Loss::L1) => 2,
            Some(Loss::L1Dssim { .. }) => return self.encode_dssim(gpu, commands, target),
        };
        self.partial.ensure(gpu, pixels.div_ceil(1024) * 4)?;
        let variant = Variant { constant: Some(("KIND", kind)), ..Variant::default() };
        let bindings = [&self.step, &self.image.buffer, &target.buffer, &self.v_image.buffer, &self.partial.buffer];
        dispatch(gpu, commands, "loss", variant, &bindings, groups_of(gpu, pixels, 1024));
        if loss.is_some() {
            self.encode_loss_sum(gpu, commands, LossSum::Pixels);
        }
        Ok(())
    }

    /// Stage `loss`, of L1 and D-SSIM.
    fn encode_dssim(&mut self, gpu: &Gpu, commands: &mut Commands, target: &PlanarTarget) -> Result<(), Error> {
        let [width, height] = [self.canvas.width, self.canvas.height].map(u64::from);
        let groups = |lines: u64, length: u64| {
            (3 * lines * length.div_ceil(u64::from(self.tiling.ssim_segment))).div_ceil(u64::from(DSSIM_GROUP))
        };
        let (down, along) = (groups(width, height), groups(height, width));
        self.partial.ensure(gpu, (down + along) * 4)?;
        self.moments.ensure(gpu, 3 * width * height * MOMENTS_BYTES)?;
        self.derivatives.ensure(gpu, (3 * width).next_multiple_of(STRIP) * height * MOMENTS_BYTES)?;
        let (step, image, target, v_image) = (&self.step, &self.image.buffer, &target.buffer, &self.v_image.buffer);
        let (moments, derivatives, partial) = (&self.moments.buffer, &self.derivatives.buffer, &self.partial.buffer);
        let (plain, [down, along]) = (Variant::default(), [down, along].map(|groups| gpu.groups(groups).into()));
        dispatch(gpu, commands, "dssim_moments", plain, &[step, image, target, moments], down);
        let bindings = (&[0, 3, 4, 6][..], &[step, moments, derivatives, partial][..]);
        dispatch_some(gpu, commands, "dssim_derivatives", plain, bindings, along);
        let bindings = (&[0, 1, 2, 4, 5, 6][..], &[step, image, target, derivatives, v_image, partial][..]);
        dispatch_some(gpu, commands, "dssim_gradient", plain, bindings, down);
        self.encode_loss_sum(gpu, commands, LossSum::Dssim);
        Ok(())
    }

    fn encode_loss_sum(&self, gpu: &Gpu, commands: &mut Commands, of: LossSum) {
        let variant = Variant { constant: Some(("SUM_OF", of as u32)), ..Variant::default() };
        let bindings = (&[0, 4, 5][..], &[&self.step, &self.partial.buffer, &self.status][..]);
        dispatch_some(gpu, commands, "loss_sum", variant, bindings, Groups::Direct(1, 1));
    }

    /// Stage `blend_bwd`, from `v_image`, or from the image itself.
    pub(crate) fn encode_blend_bwd(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        cloud: &PlanarCloud,
        v_image: Differentiated,
    ) {
        let variant = Variant { local_frame: false, pass: Pass::Backward, ..self.variant(cloud) };
        let v_image = match v_image {
            Differentiated::Loss => &self.v_image.buffer,
            Differentiated::Image => &self.image.buffer,
        };
        let (entry_point, [fifth, sixth]) = match gpu.kernels {
            Kernels::Vectors => ("blend_vectors", [&self.slots.buffer, v_image]),
            _ => ("blend_bwd", [v_image, &self.slots.buffer]),
        };
        let mut bindings = self.lists().to_vec();
        bindings.extend([fifth, sixth]);
        if variant.over {
            bindings.push(&self.image.buffer);
        }
        dispatch(gpu, commands, entry_point, variant, &bindings, gpu.groups(self.tile_count()).into());
    }

    /// Stages `blend` to `blend_bwd` for a training step: in one pass where adapter and loss allow it.
    pub(crate) fn encode_image_and_gradient(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        cloud: &PlanarCloud,
        target: &PlanarTarget,
        loss: Loss,
    ) -> Result<(), Error> {
        if !fuses(gpu, loss) {
            self.encode_blend(gpu, commands, cloud);
            self.encode_loss(gpu, commands, target, Some(loss))?;
            self.encode_blend_bwd(gpu, commands, cloud, Differentiated::Loss);
            return Ok(());
        }
        let kind = if loss == Loss::L2 { 1 } else { 2 };
        let tiles = self.tile_count();
        self.partial.ensure(gpu, tiles * 4)?;
        let variant =
            Variant { local_frame: false, pass: Pass::Fused, constant: Some(("KIND", kind)), ..self.variant(cloud) };
        let mut bindings = self.lists().to_vec();
        bindings.extend([&self.slots.buffer, &target.buffer, &self.partial.buffer]);
        dispatch(gpu, commands, "blend_vectors", variant, &bindings, gpu.groups(tiles).into());
        self.encode_loss_sum(gpu, commands, LossSum::Tiles);
        Ok(())
    }

    /// What every blend kernel reads.
    fn lists(&self) -> [&wgpu::Buffer; 5] {
        [
            &self.step,
            &self.tile_start.buffer,
            &self.order[self.sorted()].buffer,
            &self.entries.buffer,
            &self.splats.buffer,
        ]
    }

    /// Stage `project_bwd`.
    pub(crate) fn encode_project_bwd(&self, gpu: &Gpu, commands: &mut Commands, cloud: &PlanarCloud) {
        let bindings = [
            &self.step,
            &cloud.gaussians,
            &self.splats.buffer,
            &self.offsets.buffer,
            &self.slots.buffer,
            &self.gradients.buffer,
        ];
        let invocations = if gpu.kernels == Kernels::Vectors { LANES } else { 64 };
        let groups = groups_of(gpu, u64::from(self.gaussians), invocations.into());
        dispatch(gpu, commands, "project_bwd", self.variant(cloud), &bindings, groups);
    }

    /// Stage `adam`, in a pass whose lists may not have fitted: then it does nothing.
    pub(crate) fn encode_adam(&self, gpu: &Gpu, commands: &mut Commands, cloud: &PlanarCloud) {
        encode_adam(gpu, commands, cloud, &self.step, &self.gradients.buffer, self.indirect(BY_GAUSSIAN));
    }

    /// Copies what became of the pass into a buffer that can be mapped.
    pub(crate) fn encode_status(&self, commands: &mut Commands, staging: &wgpu::Buffer) {
        commands.encoder().copy_buffer_to_buffer(&self.status, 0, staging, 0, size_of::<Status>() as u64);
    }

    /// What became of the pass, once it has been done.
    pub(crate) fn read_status(&self, gpu: &Gpu) -> Result<Status, Error> {
        Ok(gpu.read(&self.status, 1)?[0])
    }

    /// Makes room for what a pass asked for in vain, and forgets that it did.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, status: &Status) -> Result<(), Error> {
        self.grow(gpu, u64::from(status.overflow) + u64::from(status.overflow) / 4)?;
        gpu.write(&self.status, bytemuck::bytes_of(&Status::default()));
        Ok(())
    }

    /// Solving for the colours, from lists that are there; `iterations` of conjugate gradients.
    pub(crate) fn encode_solve(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        cloud: &PlanarCloud,
        target: &PlanarTarget,
        iterations: u32,
        without_backdrop: &wgpu::Buffer,
    ) -> Result<(), Error> {
        let n = u64::from(self.gaussians);
        self.vectors.ensure(gpu, n * CONJUGATE_BYTES)?;
        self.scalars.ensure(gpu, 64)?;
        self.partial.ensure(gpu, n.div_ceil(256) * 16)?;
        self.encode_blend(gpu, commands, cloud);
        self.encode_loss(gpu, commands, target, None)?;
        self.encode_blend_bwd(gpu, commands, cloud, Differentiated::Loss);
        self.encode_solver(gpu, commands, cloud, "solve_start", None);
        self.encode_solver(gpu, commands, cloud, "solve_scalars", Some(0));
        // From here on the image is that of a direction, on nothing.
        commands.encoder().copy_buffer_to_buffer(without_backdrop, 0, &self.step, 0, size_of::<Step>() as u64);
        for _ in 0..iterations {
            self.encode_blend(gpu, commands, cloud);
            self.encode_blend_bwd(gpu, commands, cloud, Differentiated::Image);
            self.encode_solver(gpu, commands, cloud, "solve_product", None);
            self.encode_solver(gpu, commands, cloud, "solve_scalars", Some(1));
            self.encode_solver(gpu, commands, cloud, "solve_step", None);
            self.encode_solver(gpu, commands, cloud, "solve_scalars", Some(2));
            self.encode_solver(gpu, commands, cloud, "solve_direction", None);
        }
        self.encode_solver(gpu, commands, cloud, "solve_end", None);
        Ok(())
    }

    fn encode_solver(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        cloud: &PlanarCloud,
        entry_point: &'static str,
        scalars: Option<u32>,
    ) {
        let buffers = [
            &self.step,
            &self.splats.buffer,
            &self.offsets.buffer,
            &self.slots.buffer,
            &self.vectors.buffer,
            &self.partial.buffer,
            &self.scalars.buffer,
            &cloud.gaussians,
        ];
        let used: &[u32] = match entry_point {
            "solve_start" => &[0, 1, 2, 3, 4, 5],
            "solve_product" => &[0, 2, 3, 4, 5],
            "solve_step" => &[0, 1, 4, 5, 6],
            "solve_direction" => &[0, 1, 4, 6],
            "solve_end" => &[0, 1, 4, 7],
            _ => &[0, 5, 6],
        };
        let bindings: Vec<&wgpu::Buffer> = used.iter().map(|&number| buffers[number as usize]).collect();
        let variant = Variant { constant: scalars.map(|which| ("WHICH", which)), ..Variant::default() };
        let groups = match scalars {
            None => groups_of(gpu, u64::from(self.gaussians), 256),
            Some(_) => Groups::Direct(1, 1),
        };
        dispatch_some(gpu, commands, entry_point, variant, (used, &bindings), groups);
    }
}

/// Whether a training step blends, compares and differentiates in one pass: where lanes are a CPU's, and the loss is one of each pixel alone.
pub(crate) fn fuses(gpu: &Gpu, loss: Loss) -> bool {
    gpu.kernels == Kernels::Vectors && !matches!(loss, Loss::L1Dssim { .. })
}

/// Which partial sums make the loss, as `loss_sum` has it.
#[derive(Debug, Clone, Copy)]
enum LossSum {
    /// Those of `loss`.
    Pixels = 0,
    /// Those of `dssim_derivatives` and `dssim_gradient`.
    Dssim = 1,
    /// One a tile.
    Tiles = 2,
}

/// What `blend_bwd` differentiates: the loss, or half the image's square.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Differentiated {
    Loss,
    Image,
}

/// Stage `adam`.
pub(crate) fn encode_adam(
    gpu: &Gpu,
    commands: &mut Commands,
    cloud: &PlanarCloud,
    step: &wgpu::Buffer,
    gradients: &wgpu::Buffer,
    groups: Groups<'_>,
) {
    let variant = Variant { local_frame: cloud.chart == Chart::LocalFrame, ..Variant::default() };
    let bindings = [step, gradients, &cloud.gaussians, &cloud.moments, &cloud.statistics];
    dispatch(gpu, commands, "adam", variant, &bindings, groups);
}
