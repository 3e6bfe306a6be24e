//! Training steps that were sent and whose outcome the host does not know yet, so that host and device work at the same time.
//!
//! Each step ends by copying its status into a small buffer of its own, which is mapped when the device is done with it. The host reads
//! them in order, as late as it can. A step whose lists do not fit changes nothing, nor do those behind it (`shaders/sizes.wgsl`): when
//! the host learns of it, it makes room and sends them all again, so the splats ends as if there had always been room. A step in which a pixel
//! gives up changes nothing, either, nor do those behind it; it is an error, and sent no more.

use std::{
    collections::VecDeque,
    future::poll_fn,
    ops::{Deref, DerefMut},
    sync::{Mutex, PoisonError},
    task::{Poll, Waker},
};

use gs_core::{AdamRates, Binning, Error, Loss, MeanNoise, RenderSettings, TrainStep, Wait};

use crate::{
    answer::Answer,
    dispatch::{Commands, Groups, dispatch_some},
    forward_pass::Pool,
    gpu::Gpu,
    kind::SceneKind,
    layout::{Noise, Status},
    shaders::Variant,
    splats::{Splats, UNIFORM},
    target::Target,
    tiles::{BY_GAUSSIAN, groups_of},
    workspace::Workspace,
};

/// Training steps of splats that may be under way at once; before one more is sent, the host waits for the oldest. Two would do to keep
/// the device at work; with more, a host that is kept busy for a while costs nothing. Each is one more that is sent in vain when buffers
/// must grow, and losses come by so many steps later.
pub const STEPS_IN_FLIGHT: usize = 4;

/// All that it takes to send a step, and to send it again.
#[derive(Debug)]
pub(crate) struct Request<S: SceneKind> {
    view: S::View,
    target: Target,
    settings: RenderSettings,
    loss: Loss,
    rates: AdamRates,
    binning: Binning,
    /// Added to the means after the step.
    noise: Vec<MeanNoise>,
}

impl<S: SceneKind> Request<S> {
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

/// A step under way.
#[derive(Debug)]
struct Sent<S: SceneKind> {
    request: Request<S>,
    /// Where its status goes.
    status: wgpu::Buffer,
    /// Whether that could be mapped.
    mapped: Answer,
    submission: wgpu::SubmissionIndex,
}

/// Where the steps under way are, unless somebody waits for them.
#[derive(Debug)]
pub(crate) struct Home<S: SceneKind> {
    in_flight: Option<InFlight<S>>,
    /// Who else wants them.
    wakers: Vec<Waker>,
}

impl<S: SceneKind> Default for Home<S> {
    fn default() -> Self {
        Self { in_flight: Some(InFlight::default()), wakers: Vec::new() }
    }
}

/// The steps under way in the hands of whoever waits for them. They go back when the waiting ends, and where it is given up.
#[derive(Debug)]
pub(crate) struct Taken<'a, S: SceneKind> {
    home: &'a Mutex<Home<S>>,
    in_flight: InFlight<S>,
}

impl<'a, S: SceneKind> Taken<'a, S> {
    /// Takes them, once nobody else has them.
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

impl<S: SceneKind> Drop for Taken<'_, S> {
    fn drop(&mut self) {
        let mut home = self.home.lock().unwrap_or_else(PoisonError::into_inner);
        home.in_flight = Some(std::mem::take(&mut self.in_flight));
        let wakers = std::mem::take(&mut home.wakers);
        drop(home);
        wakers.into_iter().for_each(Waker::wake);
    }
}

impl<S: SceneKind> Deref for Taken<'_, S> {
    type Target = InFlight<S>;

    fn deref(&self) -> &InFlight<S> {
        &self.in_flight
    }
}

impl<S: SceneKind> DerefMut for Taken<'_, S> {
    fn deref_mut(&mut self) -> &mut InFlight<S> {
        &mut self.in_flight
    }
}

impl<S: SceneKind> Home<S> {
    /// Steps under way; 0 while somebody waits for them.
    pub(crate) fn len(&self) -> usize {
        self.in_flight.as_ref().map_or(0, |in_flight| in_flight.sent.len())
    }

    /// The steps under way of splats that nobody else can look at.
    pub(crate) fn in_flight(&mut self) -> &mut InFlight<S> {
        self.in_flight.get_or_insert_default()
    }
}

/// A splats' steps under way, and what they work in.
#[derive(Debug)]
pub(crate) struct InFlight<S: SceneKind> {
    /// With the lists of the last step that was sent.
    workspace: Option<Workspace<S>>,
    /// Oldest first.
    sent: VecDeque<Sent<S>>,
    /// Buffers for statuses.
    free: Vec<wgpu::Buffer>,
    /// What the device is told of noise.
    noise: Option<wgpu::Buffer>,
    /// Of steps that are done, until they are asked for.
    pub(crate) losses: Vec<f32>,
}

impl<S: SceneKind> Default for InFlight<S> {
    fn default() -> Self {
        Self { workspace: None, sent: VecDeque::new(), free: Vec::new(), noise: None, losses: Vec::new() }
    }
}

impl<S: SceneKind> InFlight<S> {
    /// Sends a step, as soon as there are fewer than [`STEPS_IN_FLIGHT`].
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
        // Those under way may still need it.
        self.workspace = Some(workspace);
        sent.and_then(|()| gpu.check())
    }

    /// Takes note of the steps that are done, or waits until all are.
    pub(crate) async fn settle(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<(), Error> {
        gpu.check()?;
        if wait == Wait::Arrived && !self.sent.is_empty() {
            gpu.look()?;
        }
        while !self.sent.is_empty() && self.finish_oldest(gpu, splats, wait).await? {}
        Ok(())
    }

    /// Whether there was something to do: the oldest step is done, or it and all behind it were sent again. After an error none is under
    /// way.
    async fn finish_oldest(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<bool, Error> {
        let finished = self.try_finish_oldest(gpu, splats, wait).await;
        if finished.is_err() {
            let losses = std::mem::take(&mut self.losses);
            *self = Self { losses, ..Self::default() };
        }
        finished
    }

    async fn try_finish_oldest(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<bool, Error> {
        // It stays in the queue while it is waited for: whoever gives up waiting loses nothing.
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
            self.free.push(oldest.status);
            return Ok(true);
        }
        let mut workspace = self.workspace.take().expect("steps under way have a workspace");
        workspace.make_room(gpu, &status)?;
        // Buffers of those behind are not free yet, so they are given up.
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
        let fresh = request.binning == Binning::Fresh || workspace.edition.is_none();
        if fresh {
            workspace.edition = None;
        }
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let buffer = || gpu.allocate("status to read", STATUS_BYTES, usage);
        let status = self.free.pop().map_or_else(buffer, Ok)?;
        // Written when this step is submitted, behind those before it: each sees its own.
        workspace.write_step(gpu, &workspace.describe(gpu, splats, Some(request.loss), Some(&request.rates)));
        let mut commands = Commands::new(gpu);
        workspace.encode_lists(gpu, &mut commands, splats, fresh);
        workspace.tiles.encode_image_and_gradient(gpu, &mut commands, &request.target, request.loss)?;
        workspace.encode_project_bwd(gpu, &mut commands, splats)?;
        workspace.encode_adam(gpu, &mut commands, splats);
        workspace.tiles.encode_status(&mut commands, &status);
        let submission = commands.submit(gpu);
        let mapped = Gpu::map(&status, STATUS_BYTES);
        // If these lists do not fit, whoever makes room forgets them again.
        workspace.edition = Some(splats.edition);
        for noise in &request.noise {
            self.send_noise(gpu, splats, noise, Some(&workspace.tiles.indirect))?;
        }
        self.sent.push_back(Sent { request, status, mapped, submission });
        Ok(())
    }

    /// Sends noise behind all steps under way: it is added if the last of them is done, and sent again with it.
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
        &MeanNoise { scale, seed, step }: &MeanNoise,
        indirect: Option<&wgpu::Buffer>,
    ) -> Result<(), Error> {
        let uniform = match self.noise.take() {
            Some(uniform) => uniform,
            None => gpu.allocate("noise", size_of::<Noise>() as u64, UNIFORM)?,
        };
        gpu.write(&uniform, bytemuck::bytes_of(&Noise { scale, seed, step, gaussians: splats.len as u32 }));
        let groups = match indirect {
            Some(sizes) => Groups::Indirect(sizes, BY_GAUSSIAN),
            None => groups_of(gpu, splats.len as u64, 64),
        };
        let (entry_point, gaussians) = S::noise(splats);
        let variant = Variant { covariance_factor: S::has_factors(&splats.state), ..Variant::default() };
        let mut commands = Commands::new(gpu);
        dispatch_some(gpu, &mut commands, entry_point, variant, (&[1, 2], &[&uniform, gaussians]), groups);
        commands.submit(gpu);
        self.noise = Some(uniform);
        Ok(())
    }
}
