//! Pending training steps: the host submits the next step before it knows the outcome of the last.
//!
//! Each step ends by copying its status into a small buffer of its own, which is mapped when the
//! step is done. The host reads the statuses in order, as late as it can. A step whose lists do not
//! fit changes nothing, and neither do the steps after it (`shaders/sizes.wgsl`). When the host
//! reads such a status, it enlarges the buffers and submits all these steps again, so the result is
//! the same as with large buffers. A step with an unfinished pixel changes nothing, either, and is
//! an error.

use std::{
    collections::VecDeque,
    future::poll_fn,
    ops::{Deref, DerefMut},
    sync::{Mutex, PoisonError},
    task::{Poll, Waker},
};

use gs_core::{AdamRates, Binning, CameraGradient, Error, Loss, MeanNoise, RenderSettings, TrainStep, Wait};

use crate::{
    answer::Answer,
    dispatch::{Commands, Groups, dispatch_some},
    gpu::{Gpu, UNIFORM},
    kind::{Kind, State as _},
    layout::{BY_GAUSSIAN, Noise, Status},
    shaders::Variant,
    splats::Splats,
    target::Target,
    tiles::groups_of,
    workspace::{Pool, Workspace},
};

/// Largest number of pending training steps of some splats. The host waits for the oldest before it
/// submits another.
///
/// Two would keep the device busy; more cover short delays of the host. When buffers must grow, all
/// pending steps are repeated, and losses arrive this many steps late.
pub const STEPS_IN_FLIGHT: usize = 4;

/// The arguments of a step, to submit it and to repeat it.
#[derive(Debug)]
pub(crate) struct Request<S: Kind> {
    view: S::View,
    target: Target,
    settings: RenderSettings,
    loss: Loss,
    rates: AdamRates,
    binning: Binning,
    /// Noise that is added to the means after the step.
    noise: Vec<MeanNoise>,
}

impl<S: Kind> Request<S> {
    pub(crate) fn new(view: &S::View, target: &Target, step: &TrainStep<'_>) -> Self {
        Self {
            view: view.clone(),
            target: target.clone(),
            settings: *step.settings,
            loss: step.loss,
            rates: *step.rates,
            binning: step.binning,
            noise: Vec::new(),
        }
    }
}

const STATUS_BYTES: u64 = size_of::<Status>() as u64;

/// A pending step.
#[derive(Debug)]
struct Sent<S: Kind> {
    request: Request<S>,
    /// The buffer for its status.
    status: wgpu::Buffer,
    /// Whether the buffer could be mapped.
    mapped: Answer,
    submission: wgpu::SubmissionIndex,
}

/// The pending steps, unless a future waits for them.
#[derive(Debug)]
pub(crate) struct Home<S: Kind> {
    in_flight: Option<InFlight<S>>,
    /// Wakers of other futures that wait for them.
    wakers: Vec<Waker>,
}

impl<S: Kind> Default for Home<S> {
    fn default() -> Self {
        Self { in_flight: Some(InFlight::default()), wakers: Vec::new() }
    }
}

/// The pending steps while a future waits for them. They go back when this is dropped.
#[derive(Debug)]
pub(crate) struct Taken<'a, S: Kind> {
    home: &'a Mutex<Home<S>>,
    in_flight: InFlight<S>,
}

impl<'a, S: Kind> Taken<'a, S> {
    /// Takes the pending steps, once no other future has them.
    pub(crate) async fn from(home: &'a Mutex<Home<S>>) -> Self {
        poll_fn(|context| {
            let mut found = home.lock().unwrap_or_else(PoisonError::into_inner);
            match found.in_flight.take() {
                Some(in_flight) => Poll::Ready(Self { home, in_flight }),
                None => {
                    found.wakers.push(context.waker().clone());
                    Poll::Pending
                }
            }
        })
        .await
    }
}

impl<S: Kind> Drop for Taken<'_, S> {
    fn drop(&mut self) {
        let mut home = self.home.lock().unwrap_or_else(PoisonError::into_inner);
        home.in_flight = Some(std::mem::take(&mut self.in_flight));
        let wakers = std::mem::take(&mut home.wakers);
        drop(home);
        wakers.into_iter().for_each(Waker::wake);
    }
}

impl<S: Kind> Deref for Taken<'_, S> {
    type Target = InFlight<S>;

    fn deref(&self) -> &InFlight<S> {
        &self.in_flight
    }
}

impl<S: Kind> DerefMut for Taken<'_, S> {
    fn deref_mut(&mut self) -> &mut InFlight<S> {
        &mut self.in_flight
    }
}

impl<S: Kind> Home<S> {
    /// Number of pending steps; 0 while a future waits for them.
    pub(crate) fn len(&self) -> usize {
        self.in_flight.as_ref().map_or(0, |in_flight| in_flight.sent.len())
    }

    /// The pending steps, through a unique reference.
    pub(crate) fn in_flight(&mut self) -> &mut InFlight<S> {
        self.in_flight.get_or_insert_default()
    }
}

/// The pending steps of some splats, and their buffers.
#[derive(Debug)]
pub(crate) struct InFlight<S: Kind> {
    /// Buffers with the lists of the last submitted step.
    workspace: Option<Workspace<S>>,
    /// Oldest first.
    sent: VecDeque<Sent<S>>,
    /// Unused buffers for statuses.
    free: Vec<wgpu::Buffer>,
    /// The uniform for noise.
    noise: Option<wgpu::Buffer>,
    /// Losses of finished steps that the caller has not taken yet.
    pub(crate) losses: Vec<f32>,
    /// Gradients by the camera of finished steps that asked for them, not taken yet either.
    pub(crate) camera_gradients: Vec<CameraGradient>,
}

impl<S: Kind> Default for InFlight<S> {
    fn default() -> Self {
        Self {
            workspace: None,
            sent: VecDeque::new(),
            free: Vec::new(),
            noise: None,
            losses: Vec::new(),
            camera_gradients: Vec::new(),
        }
    }
}

impl<S: Kind> InFlight<S> {
    /// Submits a step, as soon as fewer than [`STEPS_IN_FLIGHT`] are pending.
    pub(crate) async fn train(
        &mut self,
        gpu: &Gpu,
        pool: &Pool<S>,
        splats: &Splats<S>,
        step: Request<S>,
    ) -> Result<(), Error> {
        gpu.check()?;
        while self.sent.len() >= STEPS_IN_FLIGHT {
            self.finish_oldest(gpu, splats, Wait::All).await?;
        }
        let mut workspace = match self.workspace.take() {
            Some(workspace) => workspace,
            None => pool.take(gpu)?,
        };
        let sent = self.send(gpu, splats, &mut workspace, step);
        // Pending steps may still need it.
        self.workspace = Some(workspace);
        sent.and_then(|()| gpu.check())
    }

    /// Reads the statuses of finished steps, or waits for all steps.
    pub(crate) async fn settle(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<(), Error> {
        gpu.check()?;
        if wait == Wait::Arrived && !self.sent.is_empty() {
            gpu.look()?;
        }
        while !self.sent.is_empty() && self.finish_oldest(gpu, splats, wait).await? {}
        Ok(())
    }

    /// Finishes the oldest step, or submits it and all later ones again. Returns whether it did
    /// either.
    ///
    /// After an error no step is pending.
    async fn finish_oldest(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<bool, Error> {
        let finished = self.try_finish_oldest(gpu, splats, wait).await;
        if finished.is_err() {
            let (losses, camera_gradients) =
                (std::mem::take(&mut self.losses), std::mem::take(&mut self.camera_gradients));
            *self = Self { losses, camera_gradients, ..Self::default() };
        }
        finished
    }

    async fn try_finish_oldest(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<bool, Error> {
        // The step stays in the queue during the wait, because this future may be dropped.
        let Some(Sent { mapped, submission, .. }) = self.sent.front() else { return Ok(false) };
        let mapped = match (mapped.given(), wait) {
            (Some(mapped), _) => mapped,
            (None, Wait::Arrived) => return Ok(false),
            (None, Wait::All) => gpu.wait_for(mapped, submission).await,
        };
        let Some(oldest) = self.sent.pop_front() else { return Ok(false) };
        let status: Status = gpu.contents(&oldest.status, STATUS_BYTES, mapped, bytemuck::pod_read_unaligned)?;
        status.check()?;
        if status.overflow == 0 {
            self.losses.push(status.loss);
            self.camera_gradients.extend(status.camera_gradient(&oldest.request.settings));
            self.free.push(oldest.status);
            return Ok(true);
        }
        let mut workspace = self.workspace.take().expect("pending steps have a workspace");
        workspace.make_room(gpu, &status)?;
        // The status buffers of later steps are still in use, so they are dropped.
        let behind = std::mem::take(&mut self.sent).into_iter().map(|sent| sent.request);
        for request in [oldest.request].into_iter().chain(behind) {
            self.send(gpu, splats, &mut workspace, request)?;
        }
        self.workspace = Some(workspace);
        Ok(true)
    }

    fn send(
        &mut self,
        gpu: &Gpu,
        splats: &Splats<S>,
        workspace: &mut Workspace<S>,
        request: Request<S>,
    ) -> Result<(), Error> {
        workspace.set(gpu, splats, &request.view, &request.settings)?;
        let fresh = request.binning == Binning::Fresh || workspace.version.is_none();
        if fresh {
            workspace.version = None;
        }
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let buffer = || gpu.allocate("status to read", STATUS_BYTES, usage);
        let status = self.free.pop().map_or_else(buffer, Ok)?;
        // The queue orders this write after the earlier steps, so each step has its own uniform.
        let step = workspace.describe(gpu, splats, Some(request.loss), Some(&request.rates));
        workspace.write_step(gpu, &step);
        let mut commands = Commands::new(gpu);
        workspace.encode_lists(gpu, &mut commands, splats, fresh);
        workspace.tiles.encode_image_and_gradient(gpu, &mut commands, &request.target, request.loss)?;
        workspace.encode_project_bwd(gpu, &mut commands, splats)?;
        workspace.encode_adam(gpu, &mut commands, splats);
        workspace.tiles.encode_status(&mut commands, &status);
        let submission = commands.submit(gpu);
        let mapped = Gpu::map(&status, STATUS_BYTES);
        // If these lists do not fit, `make_room` resets this.
        workspace.version = Some(splats.version);
        for noise in &request.noise {
            self.send_noise(gpu, splats, noise, Some(&workspace.tiles.indirect))?;
        }
        self.sent.push_back(Sent { request, status, mapped, submission });
        Ok(())
    }

    /// Submits noise after all pending steps. It is added only if the last of them succeeds, and is
    /// repeated with that step.
    pub(crate) fn add_noise(&mut self, gpu: &Gpu, splats: &Splats<S>, noise: &MeanNoise) -> Result<(), Error> {
        gpu.check()?;
        let indirect = match (self.sent.back_mut(), &self.workspace) {
            (Some(last), Some(workspace)) => {
                last.request.noise.push(*noise);
                Some(workspace.tiles.indirect.clone())
            }
            _ => None,
        };
        self.send_noise(gpu, splats, noise, indirect.as_ref())
    }

    fn send_noise(
        &mut self,
        gpu: &Gpu,
        splats: &Splats<S>,
        &MeanNoise { scale, seed, step, fixed }: &MeanNoise,
        indirect: Option<&wgpu::Buffer>,
    ) -> Result<(), Error> {
        let uniform = match self.noise.take() {
            Some(uniform) => uniform,
            None => gpu.allocate("noise", size_of::<Noise>() as u64, UNIFORM)?,
        };
        let gaussians = splats.len as u32;
        gpu.write(&uniform, bytemuck::bytes_of(&Noise { scale, seed, step, gaussians, fixed }));
        let groups = match indirect {
            Some(sizes) => Groups::Indirect(sizes, BY_GAUSSIAN),
            None => groups_of(gpu, splats.len as u64, 64),
        };
        let (entry_point, gaussians) = S::noise(splats);
        let variant = Variant { covariance_factor: splats.state.has_factors(), ..Variant::default() };
        let mut commands = Commands::new(gpu);
        dispatch_some(gpu, &mut commands, entry_point, variant, (&[1, 2], &[&uniform, gaussians]), groups);
        commands.submit(gpu);
        self.noise = Some(uniform);
        Ok(())
    }
}
