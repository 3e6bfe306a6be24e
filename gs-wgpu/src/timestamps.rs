//! The device's own clock: timestamps that it writes between stages of one submission, where the adapter has them.

use gs_core::Error;

use crate::{
    dispatch::Commands,
    gpu::{Gpu, STORAGE},
};

/// Timestamps of one submission, in the order in which they are written.
#[derive(Debug)]
pub(crate) struct Timestamps {
    queries: wgpu::QuerySet,
    /// What the queries are turned into, 64 bits each.
    resolved: wgpu::Buffer,
    count: u32,
    /// Seconds per tick.
    period: f64,
}

impl Timestamps {
    /// Room for `count`, or nothing where the adapter offers none.
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

    /// Writes timestamp `index` once everything that was recorded before has been done: at the beginning of a pass that does nothing,
    /// which every adapter with timestamps allows.
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

    /// Makes the timestamps readable; the last command of the submission.
    pub(crate) fn resolve(&self, commands: &mut Commands) {
        commands.encoder().resolve_query_set(&self.queries, 0..self.count, &self.resolved, 0);
    }

    /// Seconds from each timestamp to the next, once the submission has been done.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    pub(crate) async fn laps(&self, gpu: &Gpu) -> Result<Vec<f64>, Error> {
        let ticks: Vec<u64> = gpu.read(&self.resolved, self.count as usize).await?;
        Ok(ticks.windows(2).map(|pair| pair[1].wrapping_sub(pair[0]).cast_signed() as f64 * self.period).collect())
    }
}
