//! One pass through the stages: the tiles, what is the kind of scene's own, and the order in which the stages' commands are recorded.

use gs_core::{AdamRates, Error, Loss, RenderSettings};

use crate::{
    cloud::Cloud,
    dispatch::Commands,
    gpu::Gpu,
    kind::Kind,
    layout::{Status, Step},
    tiles::{Growing, Tiles},
};

/// One pass's inputs and results.
#[derive(Debug)]
pub struct Workspace<S: Kind> {
    pub(crate) tiles: Tiles,
    /// Once there was a pass.
    pub(crate) view: Option<S::View>,
    pub(crate) own: S::Own,
    /// As many as the kind of scene has.
    pub(crate) gradients: Vec<Growing>,
    /// The cloud's edition that the lists were made for.
    pub(crate) edition: Option<u64>,
}

impl<S: Kind> Workspace<S> {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, Error> {
        Ok(Self { tiles: Tiles::new(gpu)?, view: None, own: S::own(gpu)?, gradients: Vec::new(), edition: None })
    }

    /// Makes the pass one of this cloud, view and settings; lists that were made for anything else are forgotten.
    pub(crate) fn set(
        &mut self,
        gpu: &Gpu,
        cloud: &Cloud<S>,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<(), Error> {
        let seen = self.view.as_ref() == Some(view) && self.tiles.settings == *settings;
        if !(S::LISTS_LAST && seen && self.edition == Some(cloud.edition)) {
            self.edition = None;
        }
        self.view = Some(view.clone());
        self.tiles.set(gpu, cloud.len, S::size(view), settings)?;
        let sizes = S::gradient_bytes(cloud);
        while self.gradients.len() < sizes.len() {
            self.gradients.push(Growing::new(gpu, "gradients")?);
        }
        for (gradients, bytes) in self.gradients.iter_mut().zip(sizes) {
            gradients.ensure(gpu, bytes)?;
        }
        S::ensure(self, gpu, cloud)
    }

    /// What this pass tells the device.
    pub(crate) fn describe(&self, gpu: &Gpu, cloud: &Cloud<S>, loss: Option<Loss>, rates: Option<&AdamRates>) -> Step {
        let mut step = self.tiles.describe(gpu, loss, rates);
        if let Some(view) = &self.view {
            S::describe(view, &self.tiles.settings, cloud, &mut step);
        }
        step
    }

    pub(crate) fn write_step(&self, gpu: &Gpu, step: &Step) {
        gpu.write(&self.tiles.step, bytemuck::bytes_of(step));
        if let Some(view) = &self.view {
            S::write_view(self, gpu, view);
        }
    }

    /// Stages `project` to `ranges`; without `lists` only `project`, and the last lists stay.
    pub(crate) fn encode_lists(&self, gpu: &Gpu, commands: &mut Commands, cloud: &Cloud<S>, lists: bool) {
        self.encode_project(gpu, commands, cloud, lists);
        if lists {
            self.tiles.encode_offsets(gpu, commands);
            self.tiles.encode_bin(gpu, commands);
            self.tiles.encode_sort(gpu, commands);
            self.tiles.encode_ranges(gpu, commands);
        }
    }

    /// Stage `project`; with `lists` it counts the tiles that each Gaussian touches.
    pub(crate) fn encode_project(&self, gpu: &Gpu, commands: &mut Commands, cloud: &Cloud<S>, lists: bool) {
        self.tiles.encode_clear(commands, lists);
        S::encode_project(self, gpu, commands, cloud, lists);
    }

    /// The gradients that `project_bwd` leaves.
    pub(crate) fn gradient_buffers(&self) -> Vec<&wgpu::Buffer> {
        self.gradients.iter().map(|growing| &growing.buffer).collect()
    }

    /// Stage `adam`, in a pass whose lists may not have fitted, or whose pixels may have given up: then it does nothing.
    pub(crate) fn encode_adam(&self, gpu: &Gpu, commands: &mut Commands, cloud: &Cloud<S>) {
        self.tiles.encode_stop(gpu, commands);
        let Tiles { step, indirect, .. } = &self.tiles;
        S::encode_adam(gpu, commands, cloud, step, &self.gradient_buffers(), Some(indirect));
    }

    /// Makes room for what a pass asked for in vain, and forgets that it did.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, status: &Status) -> Result<(), Error> {
        self.edition = None;
        self.tiles.make_room(gpu, status)
    }
}
