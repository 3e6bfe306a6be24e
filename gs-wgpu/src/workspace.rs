//! A pass through the stages: its buffers, and the order in which the stages are recorded.

use std::sync::{Arc, Mutex, PoisonError};

use gs_core::{AdamRates, Error, Loss, RenderSettings, Scene2d, Scene3d};

use crate::{
    dispatch::Commands,
    gpu::Gpu,
    kind::Kind,
    layout::{Status, Step},
    splats::Splats,
    tiles::{Growing, Tiles},
};

/// Inputs and results of a pass.
#[derive(Debug)]
pub struct Workspace<S: Kind> {
    pub(crate) tiles: Tiles,
    /// `None` before the first pass.
    pub(crate) view: Option<S::View>,
    pub(crate) buffers: S::Buffers,
    /// Empty before the first backward pass.
    pub(crate) gradients: Vec<Growing>,
    /// The version of the splats that the lists were made for.
    pub(crate) version: Option<u64>,
}

impl<S: Kind> Workspace<S> {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, Error> {
        Ok(Self {
            tiles: Tiles::new(gpu)?,
            view: None,
            buffers: S::buffers(gpu)?,
            gradients: Vec::new(),
            version: None,
        })
    }

    /// Sets the splats, view and settings of the pass. Lists that were made for others become
    /// invalid.
    pub(crate) fn set(
        &mut self,
        gpu: &Gpu,
        splats: &Splats<S>,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<(), Error> {
        let same_view = self.view.as_ref() == Some(view) && self.tiles.settings == *settings;
        if !(S::LISTS_LAST && same_view && self.version == Some(splats.version)) {
            self.version = None;
        }
        self.view = Some(view.clone());
        self.tiles.set(gpu, splats.len, S::size(view), settings)?;
        S::ensure(self, gpu, splats)
    }

    /// The uniform of this pass.
    pub(crate) fn describe(
        &self,
        gpu: &Gpu,
        splats: &Splats<S>,
        loss: Option<Loss>,
        rates: Option<&AdamRates>,
    ) -> Step {
        let mut step = self.tiles.describe(gpu, loss, rates);
        if let Some(view) = &self.view {
            S::describe(view, &self.tiles.settings, splats, &mut step);
        }
        step
    }

    pub(crate) fn write_step(&self, gpu: &Gpu, step: &Step) {
        gpu.write(&self.tiles.step, bytemuck::bytes_of(step));
        if let Some(view) = &self.view {
            S::write_view(self, gpu, view);
        }
    }

    /// Records stages `project` to `ranges`; without `lists` only `project`, and the lists stay.
    pub(crate) fn encode_lists(&self, gpu: &Gpu, commands: &mut Commands, splats: &Splats<S>, lists: bool) {
        self.encode_project(gpu, commands, splats, lists);
        if lists {
            self.tiles.encode_offsets(gpu, commands);
            self.tiles.encode_bin(gpu, commands);
            self.tiles.encode_sort(gpu, commands);
            self.tiles.encode_ranges(gpu, commands);
        }
    }

    /// Records stage `project`. With `lists` it counts the tiles that each Gaussian touches.
    pub(crate) fn encode_project(&self, gpu: &Gpu, commands: &mut Commands, splats: &Splats<S>, lists: bool) {
        self.tiles.encode_clear(commands, lists);
        S::encode_project(self, gpu, commands, splats, lists);
    }

    /// Records stage `project_bwd`, and allocates its gradients: a pass without it needs none.
    pub(crate) fn encode_project_bwd(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<S>,
    ) -> Result<(), Error> {
        let sizes = S::gradient_bytes(splats, &self.tiles.settings);
        while self.gradients.len() < sizes.len() {
            self.gradients.push(Growing::new(gpu, "gradients")?);
        }
        for (gradients, bytes) in self.gradients.iter_mut().zip(sizes) {
            gradients.ensure(gpu, bytes)?;
        }
        S::encode_project_bwd(self, gpu, commands, splats);
        Ok(())
    }

    /// The buffers that `project_bwd` writes.
    pub(crate) fn gradient_buffers(&self) -> Vec<&wgpu::Buffer> {
        self.gradients.iter().map(|growing| &growing.buffer).collect()
    }

    /// Records stage `adam`. It does nothing if the lists did not fit or a pixel stayed unfinished.
    pub(crate) fn encode_adam(&self, gpu: &Gpu, commands: &mut Commands, splats: &Splats<S>) {
        self.tiles.encode_stop(gpu, commands);
        let Tiles { step, indirect, .. } = &self.tiles;
        S::encode_adam(gpu, commands, splats, step, &self.gradient_buffers(), Some(indirect));
    }

    /// Enlarges the buffers that were too small for a pass, and resets its status.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, status: &Status) -> Result<(), Error> {
        self.version = None;
        self.tiles.make_room(gpu, status)
    }

    /// Makes new lists and runs `encode` on them. Repeats with larger buffers until the lists fit.
    pub(crate) async fn with_lists(
        &mut self,
        gpu: &Gpu,
        splats: &Splats<S>,
        step: impl Fn(&Self) -> Step,
        mut encode: impl FnMut(&mut Self, &mut Commands) -> Result<(), Error>,
    ) -> Result<Status, Error> {
        loop {
            self.write_step(gpu, &step(self));
            let mut commands = Commands::new(gpu);
            self.encode_lists(gpu, &mut commands, splats, true);
            encode(self, &mut commands)?;
            commands.submit(gpu);
            let status = self.tiles.read_status(gpu).await?;
            if status.overflow == 0 {
                status.check()?;
                self.version = Some(splats.version);
                return Ok(status);
            }
            self.make_room(gpu, &status)?;
        }
    }
}

/// Workspaces that are not in use.
#[derive(Debug)]
pub struct Pool<S: Kind>(Mutex<Vec<Workspace<S>>>);

impl<S: Kind> Default for Pool<S> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<S: Kind> Pool<S> {
    pub(crate) fn take(&self, gpu: &Gpu) -> Result<Workspace<S>, Error> {
        match self.0.lock().unwrap_or_else(PoisonError::into_inner).pop() {
            Some(mut workspace) => {
                // A step with `Binning::Reuse` must not use another's lists.
                workspace.version = None;
                Ok(workspace)
            }
            None => Workspace::new(gpu),
        }
    }

    pub(crate) fn give(&self, workspace: Workspace<S>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}

/// The pools of both kinds of scenes.
#[derive(Debug, Default)]
pub struct Pools {
    pub(crate) pool_2d: Arc<Pool<Scene2d>>,
    pub(crate) pool_3d: Arc<Pool<Scene3d>>,
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Canvas, Gaussian2d, Image, Loss, Parameterization, Rasterizer, RenderSettings, Scene2d};
    use pollster::FutureExt as _;

    use crate::{WgpuRasterizer, WgpuSettings};

    #[test]
    fn wgpu_drawing_allocates_no_gradients() {
        let wgpu =
            WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
        let gaussian = Gaussian2d {
            mean: Vec2::splat(8.0),
            log_scale: Vec2::ONE,
            rotation: 0.0,
            opacity_logit: 0.0,
            color: Vec3::ONE,
        };
        let scene: Scene2d = [gaussian].into_iter().collect();
        let splats = wgpu.upload(&scene, Parameterization::ScaleRotation).unwrap();
        let pass = wgpu.forward(&splats, &Canvas::new(16, 16), &RenderSettings::default()).block_on().unwrap();
        assert!(pass.workspace().gradients.is_empty());
        let target = wgpu.for_2d().upload_target(&Image::filled(16, 16, [0.5; 3]).unwrap()).unwrap();
        let (_, gradients) = wgpu.backward(&splats, pass, &target, &Loss::L2).block_on().unwrap();
        assert_ne!(wgpu.gradients(&splats, &gradients).block_on().unwrap().colors, [Vec3::ZERO]);
    }
}
