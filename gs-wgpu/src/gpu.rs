//! The device: its limits, errors, buffers and pipelines.

use std::{
    collections::HashMap,
    fmt,
    pin::pin,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    task::{Context, Poll, Waker},
};

use gs_core::Error;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

#[cfg(not(target_family = "wasm"))]
use crate::answer::Poller;
use crate::{
    adapter::{self, AdapterSummary},
    answer::Answer,
    fault::{Faults, backend_error},
    shaders::{Kernels, SORT_BITS, Variant, shader_of},
};

/// How a [`WgpuRasterizer`](crate::WgpuRasterizer) opens its device.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct WgpuSettings {
    /// Selects the first adapter whose name contains this, ignoring case; `None`: the fastest kind.
    pub adapter: Option<String>,
    /// Whether fresh buffers hold NaN instead of zeros, so that tests find numbers that are read
    /// before they are written.
    #[cfg(feature = "test-hooks")]
    pub poison: bool,
    /// The kind of kernels; `None`: the fastest that the adapter supports.
    pub kernels: Option<Kernels>,
    /// Largest number of work groups along an axis of a dispatch. Larger dispatches have several
    /// rows.
    ///
    /// `None`, or more than the adapter allows: the adapter's limit.
    #[cfg(feature = "test-hooks")]
    pub most_groups: Option<std::num::NonZero<u32>>,
}

gs_core::impl_with!(WgpuSettings);

/// Device, queue and pipelines of one adapter.
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) adapter: AdapterSummary,
    /// The reason why this adapter was chosen.
    pub(crate) reason: String,
    limits: wgpu::Limits,
    /// Largest number of work groups along an axis of a dispatch.
    pub(crate) most_groups: u32,
    /// Whether the adapter computes on a CPU.
    pub(crate) on_cpu: bool,
    /// The kind of kernels.
    pub(crate) kernels: Kernels,
    /// Whether fresh buffers hold NaN instead of zeros.
    poison: bool,
    faults: Faults,
    #[cfg(not(target_family = "wasm"))]
    poller: Poller,
    pipelines: Mutex<HashMap<(&'static str, Variant), Arc<wgpu::ComputePipeline>>>,
    /// The pipelines that draw into textures, by format.
    pub(crate) shown: Mutex<HashMap<wgpu::TextureFormat, wgpu::RenderPipeline>>,
    /// A uniform per sorting pass: the bit offset of its digit.
    pub(crate) shifts: Vec<wgpu::Buffer>,
    /// Bytes moved between host and device.
    pub(crate) moved: AtomicU64,
    /// Number of times that the host has waited for the device.
    pub(crate) waits: AtomicU64,
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gpu").field("adapter", &self.adapter).finish_non_exhaustive()
    }
}

impl Gpu {
    /// Opens a device on the adapter that the settings choose.
    pub(crate) async fn open(settings: &WgpuSettings) -> Result<Self, Error> {
        let (adapter, reason) = adapter::choose(settings.adapter.as_deref()).await?;
        let info = adapter.get_info();
        let offered = adapter.limits();
        // The default limits, except for buffer sizes, which bound the size of a scene.
        let limits = wgpu::Limits {
            max_buffer_size: offered.max_buffer_size,
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            ..wgpu::Limits::default()
        };
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("gs-wgpu"),
            // Only profiles use timestamps.
            required_features: adapter.features() & (wgpu::Features::SUBGROUP | wgpu::Features::TIMESTAMP_QUERY),
            required_limits: limits.clone(),
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = adapter
            .request_device(&descriptor)
            .await
            .map_err(|e| backend_error(format!("{} cannot open a device: {e}", info.name)))?;
        let faults = Faults::default();
        let uncaptured = faults.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| uncaptured.note(e.to_string())));
        let lost = faults.clone();
        device.set_device_lost_callback(move |reason, text| {
            lost.note(format!("the device was lost ({reason:?}): {text}"));
        });
        Self::on(device, queue, &info, limits, faults, reason, settings)
    }

    /// Shares a device of the host program, which keeps its own error handlers.
    pub(crate) fn shared(device: wgpu::Device, queue: wgpu::Queue, settings: &WgpuSettings) -> Result<Self, Error> {
        let (info, limits) = (device.adapter_info(), device.limits());
        let mut missing = Vec::new();
        adapter::least_limits().check_limits_with_fail_fn(&limits, false, |name, needed, found| {
            missing.push(format!("{name} must be at least {needed} and is {found}"));
        });
        if !missing.is_empty() {
            let missing = missing.join(", ");
            return Err(backend_error(format!("the limits of the host program's device are too low: {missing}")));
        }
        let reason = "the host program's device".to_owned();
        Self::on(device, queue, &info, limits, Faults::default(), reason, settings)
    }

    fn on(
        device: wgpu::Device,
        queue: wgpu::Queue,
        info: &wgpu::AdapterInfo,
        limits: wgpu::Limits,
        faults: Faults,
        reason: String,
        settings: &WgpuSettings,
    ) -> Result<Self, Error> {
        #[cfg(feature = "test-hooks")]
        let (most_groups, poison) = (settings.most_groups.map_or(u32::MAX, std::num::NonZero::get), settings.poison);
        #[cfg(not(feature = "test-hooks"))]
        let (most_groups, poison) = (u32::MAX, false);
        let on_cpu = info.device_type == wgpu::DeviceType::Cpu;
        let kernels = adapter::kernels(settings.kernels, info, device.features())?;
        let shift = |pass: u32| {
            let contents = [pass * SORT_BITS, 0, 0, 0];
            device.create_buffer_init(&BufferInitDescriptor {
                label: Some("shift"),
                contents: bytemuck::bytes_of(&contents),
                usage: wgpu::BufferUsages::UNIFORM,
            })
        };
        let shifts = (0..32 / SORT_BITS).map(shift).collect();
        Ok(Self {
            device,
            queue,
            adapter: adapter::summary_of(info),
            reason,
            most_groups: most_groups.min(limits.max_compute_workgroups_per_dimension),
            limits,
            on_cpu,
            kernels,
            poison,
            faults,
            #[cfg(not(target_family = "wasm"))]
            poller: Poller::default(),
            pipelines: Mutex::default(),
            shown: Mutex::default(),
            shifts,
            moved: AtomicU64::new(0),
            waits: AtomicU64::new(0),
        })
    }

    /// Fails if there was an error since the device was opened.
    pub(crate) fn check(&self) -> Result<(), Error> {
        self.faults.check()
    }

    /// Makes the device unusable, as a crash of the driver would.
    #[cfg(feature = "test-hooks")]
    pub(crate) fn lose(&self) {
        self.device.destroy();
        self.faults.note("the device was lost: it was destroyed".to_owned());
    }

    /// Columns and rows of a dispatch of `groups` work groups, within the limit.
    pub(crate) fn groups(&self, groups: u64) -> (u32, u32) {
        let most = u64::from(self.most_groups);
        let across = groups.clamp(1, most);
        (across as u32, groups.div_ceil(across) as u32)
    }

    /// A new buffer, or an error with the requested and the available size.
    pub(crate) fn allocate(
        &self,
        label: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, Error> {
        self.check()?;
        let most = self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size);
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        if bytes > most {
            return Err(backend_error(format!(
                "{label} need {} MiB in one buffer, but {} allows {} MiB: use fewer or smaller Gaussians or a smaller \
                 canvas, or the CPU backend",
                mib(bytes),
                self.adapter.name,
                mib(most)
            )));
        }
        // At least the size of every struct of the shaders.
        let size = bytes.max(256).next_multiple_of(16);
        let poison = self.poison && !usage.contains(wgpu::BufferUsages::MAP_READ);
        // With a scope, running out of memory is an error of this call alone, and the device stays
        // usable. In a browser its outcome is not known yet here, and a later call fails.
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: poison,
        });
        let popped = pin!(scope.pop()).poll(&mut Context::from_waker(Waker::noop()));
        if let Poll::Ready(Some(_)) = popped {
            return Err(backend_error(format!(
                "{label} need {} MiB, but {} has less memory left: use fewer or smaller Gaussians or a smaller canvas, or \
                 the CPU backend",
                mib(size),
                self.adapter.name
            )));
        }
        if poison {
            if let Ok(mut view) = buffer.get_mapped_range_mut(..) {
                view.copy_from_slice(&vec![0xff; size as usize]);
            }
            buffer.unmap();
        }
        self.check()?;
        Ok(buffer)
    }

    /// A storage buffer that holds `data`.
    pub(crate) fn storage<T: bytemuck::Pod>(&self, label: &'static str, data: &[T]) -> Result<wgpu::Buffer, Error> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.allocate(label, bytes.len() as u64, STORAGE)?;
        self.write(&buffer, bytes);
        Ok(buffer)
    }

    /// Writes bytes from the host to a buffer.
    pub(crate) fn write(&self, buffer: &wgpu::Buffer, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.moved.fetch_add(bytes.len() as u64, Ordering::Relaxed);
            self.queue.write_buffer(buffer, 0, bytes);
        }
    }

    /// Reads the first `count` elements of a buffer, after all earlier submissions.
    pub(crate) async fn read<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, Error> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let staging = self.allocate("staging", bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)?;
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes.next_multiple_of(4));
        let submission = self.queue.submit([encoder.finish()]);
        let mapped = self.wait_for(&Self::map(&staging, bytes), &submission).await;
        self.contents(&staging, bytes, mapped, bytemuck::pod_collect_to_vec)
    }

    /// Starts to map the first `bytes` of a buffer. Call it after submitting the commands that fill
    /// it.
    pub(crate) fn map(staging: &wgpu::Buffer, bytes: u64) -> Answer {
        let answer = Answer::default();
        let mapped = answer.clone();
        staging.map_async(wgpu::MapMode::Read, ..bytes, move |result| mapped.give(result.is_ok()));
        answer
    }

    /// Passes the first `bytes` of a mapped buffer to `look`, and unmaps it.
    ///
    /// `mapped` is false if the device was lost.
    pub(crate) fn contents<T>(
        &self,
        staging: &wgpu::Buffer,
        bytes: u64,
        mapped: bool,
        look: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, Error> {
        self.check()?;
        if !mapped {
            return Err(backend_error("cannot read results: the device was lost"));
        }
        let view = staging.get_mapped_range(..bytes).map_err(|e| backend_error(e.to_string()))?;
        let found = look(&view);
        drop(view);
        staging.unmap();
        self.moved.fetch_add(bytes, Ordering::Relaxed);
        Ok(found)
    }

    /// Waits for an answer that arrives once `submission` and all before it are done.
    pub(crate) async fn wait_for(&self, answer: &Answer, submission: &wgpu::SubmissionIndex) -> bool {
        self.waits.fetch_add(1, Ordering::Relaxed);
        #[cfg(not(target_family = "wasm"))]
        self.poller.expect(&self.device, &self.faults, submission, answer);
        #[cfg(target_family = "wasm")]
        let _ = submission;
        answer.wait().await
    }

    /// Waits until `submission` and all before it are done.
    pub(crate) async fn done(&self, submission: &wgpu::SubmissionIndex) -> Result<(), Error> {
        let answer = Answer::default();
        let done = answer.clone();
        self.queue.on_submitted_work_done(move || done.give(true));
        let done = self.wait_for(&answer, submission).await;
        self.check()?;
        if done { Ok(()) } else { Err(backend_error("the device was lost during a computation")) }
    }

    /// Polls the device without waiting.
    pub(crate) fn look(&self) -> Result<(), Error> {
        let looked = self.device.poll(wgpu::PollType::Poll);
        self.check()?;
        looked.map(drop).map_err(|e| backend_error(format!("polling the device: {e}")))
    }

    /// The pipeline of an entry point, compiled on first use.
    pub(crate) fn pipeline(&self, entry_point: &'static str, variant: Variant) -> Arc<wgpu::ComputePipeline> {
        let variant = Variant { on_cpu: self.on_cpu, kernels: self.kernels, ..variant };
        let mut pipelines = self.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(pipelines.entry((entry_point, variant)).or_insert_with(|| {
            let shader = shader_of(entry_point);
            let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(shader.name),
                source: wgpu::ShaderSource::Wgsl(shader.text(variant).into()),
            });
            let constants: Vec<(&str, f64)> =
                [variant.constant].into_iter().flatten().map(|(n, v)| (n, f64::from(v))).collect();
            Arc::new(self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: None,
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    zero_initialize_workgroup_memory: false,
                },
                // The constructor of `PipelineCache` is unsafe, and drivers have caches of their
                // own.
                cache: None,
            }))
        }))
    }
}

/// Usage of a buffer that shaders and the host read and write.
pub(crate) const STORAGE: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST).union(wgpu::BufferUsages::COPY_SRC);

/// Usage of a uniform that the host writes.
pub(crate) const UNIFORM: wgpu::BufferUsages = wgpu::BufferUsages::UNIFORM.union(wgpu::BufferUsages::COPY_DST);
