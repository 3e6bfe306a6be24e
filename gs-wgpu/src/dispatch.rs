//! Recording of commands: dispatches of entry points, in as few compute passes as possible.

use crate::{gpu::Gpu, shaders::Variant};

/// The work groups of a dispatch.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Groups<'a> {
    /// Numbers along x and y that the host knows.
    Direct(u32, u32),
    /// Numbers that the device writes at an offset (bytes) of this buffer.
    Indirect(&'a wgpu::Buffer, u64),
}

impl From<(u32, u32)> for Groups<'_> {
    fn from((x, y): (u32, u32)) -> Self {
        Self::Direct(x, y)
    }
}

/// Commands of one submission.
///
/// Consecutive dispatches share a compute pass: a pass costs about as much as a small dispatch.
#[derive(Debug)]
pub struct Commands {
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
}

impl Commands {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        Self { encoder, pass: None }
    }

    /// The encoder for other commands, between compute passes.
    pub(crate) fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        &mut self.encoder
    }

    fn pass(&mut self) -> &mut wgpu::ComputePass<'static> {
        let encoder = &mut self.encoder;
        self.pass.get_or_insert_with(|| encoder.begin_compute_pass(&Default::default()).forget_lifetime())
    }

    pub(crate) fn submit(mut self, gpu: &Gpu) -> wgpu::SubmissionIndex {
        self.pass = None;
        gpu.queue.submit([self.encoder.finish()])
    }
}

/// Records a dispatch of `entry_point`; `bindings` have the numbers 0, 1, 2, …
pub(crate) fn dispatch(
    gpu: &Gpu,
    commands: &mut Commands,
    entry_point: &'static str,
    variant: Variant,
    bindings: &[&wgpu::Buffer],
    groups: Groups<'_>,
) {
    let numbers: Vec<u32> = (0..bindings.len() as u32).collect();
    dispatch_some(gpu, commands, entry_point, variant, (&numbers, bindings), groups);
}

/// Records a dispatch with explicit binding numbers, for an entry point that does not use all
/// bindings of its file.
pub(crate) fn dispatch_some(
    gpu: &Gpu,
    commands: &mut Commands,
    entry_point: &'static str,
    variant: Variant,
    (numbers, buffers): (&[u32], &[&wgpu::Buffer]),
    groups: Groups<'_>,
) {
    let pipeline = gpu.pipeline(entry_point, variant);
    let entries: Vec<wgpu::BindGroupEntry<'_>> = (numbers.iter().zip(buffers))
        .map(|(&binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(entry_point),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    let pass = commands.pass();
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    match groups {
        Groups::Direct(x, y) => pass.dispatch_workgroups(x, y, 1),
        Groups::Indirect(buffer, offset) => pass.dispatch_workgroups_indirect(buffer, offset),
    }
}
