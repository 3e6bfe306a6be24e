//! Timestamps of the device between the stages of one submission, if the adapter has them.

use gs_core::Error;

use crate::{
    dispatch::Commands,
    gpu::{Gpu, STORAGE},
};

/// The timestamps of one submission, in order.
#[derive(Debug)]
pub(crate) struct Timestamps {
    queries: wgpu::QuerySet,
    /// The resolved queries, 64 bits each.
    resolved: wgpu::Buffer,
    count: u32,
    /// Seconds per tick.
    period: f64,
}

impl Timestamps {
    /// `count` timestamps; `None` if the adapter has none.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    pub(crate) fn new(gpu: &Gpu, count: u32) -> Result<Option<Self>, Error> {
        if !gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return Ok(None);
        }
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timestamps"),
            ty: wgpu::QueryType::Timestamp,
            count,
        });
        let usage = STORAGE | wgpu::BufferUsages::QUERY_RESOLVE;
        let resolved = gpu.allocate("timestamps", u64::from(count) * 8, usage)?;
        Ok(Some(Self { queries, resolved, count, period: f64::from(gpu.queue.get_timestamp_period()) * 1e-9 }))
    }

    /// Records timestamp `index`, which the device writes after all earlier commands.
    ///
    /// It is at the beginning of an empty pass, which every adapter with timestamps allows.
    pub(crate) fn mark(&self, commands: &mut Commands, index: u32) {
        let timestamp_writes = Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(index),
            end_of_pass_write_index: None,
        });
        commands
            .encoder()
            .begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("timestamp"), timestamp_writes });
    }

    /// Resolves the timestamps; the last command of the submission.
    pub(crate) fn resolve(&self, commands: &mut Commands) {
        commands.encoder().resolve_query_set(&self.queries, 0..self.count, &self.resolved, 0);
    }

    /// Seconds from each timestamp to the next, after the submission is done.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    pub(crate) async fn laps(&self, gpu: &Gpu) -> Result<Vec<f64>, Error> {
        let ticks: Vec<u64> = gpu.read(&self.resolved, self.count as usize).await?;
        Ok(ticks.windows(2).map(|pair| pair[1].wrapping_sub(pair[0]).cast_signed() as f64 * self.period).collect())
    }
}
