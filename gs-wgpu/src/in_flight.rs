//! Training steps that were sent and whose outcome the host does not know yet, so that host and device work at the same time.
//!
//! Each step ends by copying its status into a small buffer of its own, which is mapped when the device is done with it. The host reads
//! them in order, as late as it can. A step whose lists do not fit changes nothing, nor do those behind it (`shaders/sizes.wgsl`): when
//! the host learns of it, it makes room and sends them all again, so the splats ends as if there had always been room. A step in which a pixel
//! gives up changes nothing, either, nor do those behind it; it is an error, and sent no more.

use std::{
    collections::VecDeque,
    sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel},
};

use gs_core::{AdamRates, Binning, Error, Loss, RenderSettings, TrainStep, Wait};

use crate::{
    dispatch::Commands,
    forward_pass::Pool,
    gpu::{Gpu, MOST_PATIENCE},
    kind::SceneKind,
    layout::Status,
    splats::Splats,
    target::Target,
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
        }
    }
}

/// Where one step's status goes.
#[derive(Debug)]
struct Slot {
    staging: wgpu::Buffer,
    tell: SyncSender<bool>,
    /// Whether the buffer could be mapped, once that is known.
    told: Receiver<bool>,
}

const STATUS_BYTES: u64 = size_of::<Status>() as u64;

impl Slot {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let (tell, told) = sync_channel(1);
        Ok(Self { staging: gpu.allocate("status to read", STATUS_BYTES, usage)?, tell, told })
    }

    /// Asks for the contents; to be called when what fills them has been submitted.
    fn map(&self) {
        let tell = self.tell.clone();
        self.staging.map_async(wgpu::MapMode::Read, ..STATUS_BYTES, move |result| {
            // Nobody listens where the slot was given up.
            let _ = tell.try_send(result.is_ok());
        });
    }

    /// What `submission` has left here, if it is done; the slot can then be used again.
    fn status(&self, gpu: &Gpu, submission: &wgpu::SubmissionIndex, wait: Wait) -> Result<Option<Status>, Error> {
        let mapped = match (self.told.try_recv(), wait) {
            (Ok(mapped), _) => mapped,
            (Err(TryRecvError::Empty), Wait::Arrived) => return Ok(None),
            (Err(_), _) => {
                gpu.wait_for(submission)?;
                // Another thread's waiting may be what calls back, a little later.
                self.told.recv_timeout(MOST_PATIENCE).unwrap_or(false)
            }
        };
        gpu.contents(&self.staging, STATUS_BYTES, mapped, bytemuck::pod_read_unaligned).map(Some)
    }
}

/// A step under way.
#[derive(Debug)]
struct Sent<S: SceneKind> {
    request: Request<S>,
    slot: Slot,
    submission: wgpu::SubmissionIndex,
}

/// A splats' steps under way, and what they work in.
#[derive(Debug)]
pub(crate) struct InFlight<S: SceneKind> {
    /// With the lists of the last step that was sent.
    workspace: Option<Workspace<S>>,
    /// Oldest first.
    sent: VecDeque<Sent<S>>,
    free: Vec<Slot>,
    /// Of steps that are done, until they are asked for.
    pub(crate) losses: Vec<f32>,
}

impl<S: SceneKind> Default for InFlight<S> {
    fn default() -> Self {
        Self { workspace: None, sent: VecDeque::new(), free: Vec::new(), losses: Vec::new() }
    }
}

impl<S: SceneKind> InFlight<S> {
    pub(crate) fn len(&self) -> usize {
        self.sent.len()
    }

    /// Sends a step, as soon as there are fewer than [`STEPS_IN_FLIGHT`].
    pub(crate) fn train(
        &mut self,
        gpu: &Gpu,
        pool: &Pool<S>,
        splats: &Splats<S>,
        step: Request<S>,
    ) -> Result<(), Error> {
        gpu.check()?;
        while self.sent.len() >= STEPS_IN_FLIGHT {
            self.finish_oldest(gpu, splats, Wait::All)?;
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
    pub(crate) fn settle(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<(), Error> {
        gpu.check()?;
        if wait == Wait::Arrived && !self.sent.is_empty() {
            gpu.look()?;
        }
        while !self.sent.is_empty() && self.finish_oldest(gpu, splats, wait)? {}
        Ok(())
    }

    /// Whether there was something to do: the oldest step is done, or it and all behind it were sent again. After an error none is under
    /// way.
    fn finish_oldest(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<bool, Error> {
        let finished = self.try_finish_oldest(gpu, splats, wait);
        if finished.is_err() {
            let losses = std::mem::take(&mut self.losses);
            *self = Self { losses, ..Self::default() };
        }
        finished
    }

    fn try_finish_oldest(&mut self, gpu: &Gpu, splats: &Splats<S>, wait: Wait) -> Result<bool, Error> {
        let Some(oldest) = self.sent.pop_front() else { return Ok(false) };
        let Some(status) = oldest.slot.status(gpu, &oldest.submission, wait)? else {
            self.sent.push_front(oldest);
            return Ok(false);
        };
        status.check()?;
        if status.overflow == 0 {
            self.losses.push(status.loss);
            self.free.push(oldest.slot);
            return Ok(true);
        }
        let mut workspace = self.workspace.take().expect("steps under way have a workspace");
        workspace.make_room(gpu, &status)?;
        // Slots of those behind are not free yet, so they are given up.
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
        let slot = self.free.pop().map_or_else(|| Slot::new(gpu), Ok)?;
        // Written when this step is submitted, behind those before it: each sees its own.
        workspace.write_step(gpu, &workspace.describe(gpu, splats, Some(request.loss), Some(&request.rates)));
        let mut commands = Commands::new(gpu);
        workspace.encode_lists(gpu, &mut commands, splats, fresh);
        workspace.tiles.encode_image_and_gradient(gpu, &mut commands, &request.target, request.loss)?;
        workspace.encode_project_bwd(gpu, &mut commands, splats)?;
        workspace.encode_adam(gpu, &mut commands, splats);
        workspace.tiles.encode_status(&mut commands, &slot.staging);
        let submission = commands.submit(gpu);
        slot.map();
        // If these lists do not fit, whoever makes room forgets them again.
        workspace.edition = Some(splats.edition);
        self.sent.push_back(Sent { request, slot, submission });
        Ok(())
    }
}
