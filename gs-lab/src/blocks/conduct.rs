//! Does the blocks that have no record.

use std::panic::{AssertUnwindSafe, catch_unwind};

use gs_backend::FutureExt as _;
use gs_core::{Error as CoreError, Optimizer, Scene3d};
use gs_jobs::{Queue, WorkSettings};
use gs_train::{
    Error as TrainError, Trainer3d,
    blocks::{begin, block_views},
    train::Views,
};

use super::folder::{BlockOutcome, BlocksFolder};
use crate::{
    error::Error,
    run::{Conducted, Interruptions, JobCheckpoints, Watcher, panic_message, remove_checkpoint},
};

/// Does all blocks of a folder that have no record, one after the other. `views` are those of the data set, at the
/// size for the blocks. Other processes may work in the same folder: each block is done by one of them.
///
/// Blocks that fail or panic are recorded and do not stop the others. Nothing is recorded of a block whose backend
/// fails or whose images cannot be read, which says nothing about the block.
///
/// # Errors
/// [`Error::Jobs`] and [`Error::Io`] where a block cannot be claimed or its result cannot be stored; [`Error::Fit`]
/// where the backend fails or an image is missing or another one; [`Error::Folder`] where what a block begins with is
/// damaged, and where it was taken over and both processes ended it, in two results.
pub fn conduct<R: Optimizer<Scene3d>>(
    folder: &BlocksFolder,
    on: &R,
    views: &Views,
    settings: &WorkSettings,
    watcher: &dyn Watcher<usize>,
) -> Result<Conducted, Error> {
    settings.validate()?;
    let addresses = folder.addresses().iter().map(String::as_str).collect();
    let queue = Queue::new(addresses, folder.store().clone(), settings);
    queue.keep_alive(|| {
        while let Some((block, claim)) = queue.next(|block| format!("block {}", block + 1), &watcher)? {
            watcher.begun(&block);
            // A claim that is dropped leaves the block to others.
            let outcome = match train(folder, block, on, views, (settings, watcher)) {
                Ok(Some(trained)) => folder.store_result(block, trained.steps, trained.seconds, trained.scene)?,
                Ok(None) => return Ok(()),
                Err(Failed::OfProcess(error)) => return Err(error),
                Err(Failed::OfBlock(error)) => folder.store_outcome(block, BlockOutcome::Failed { error })?,
            };
            remove_checkpoint(folder.store(), &folder.addresses()[block]);
            claim.finish();
            watcher.ended(&block, &outcome);
        }
        Ok(())
    })?;
    Conducted::of(&queue, watcher.wants_stop())
}

/// A block whose steps are all done.
struct Trained {
    steps: u32,
    seconds: f64,
    scene: Scene3d,
}

/// Why a block was not trained.
enum Failed {
    /// It would fail elsewhere, too.
    OfBlock(String),
    /// This process cannot do it.
    OfProcess(Error),
}

impl From<TrainError> for Failed {
    fn from(error: TrainError) -> Self {
        match error {
            TrainError::Core(CoreError::Backend { .. })
            | TrainError::Io(_)
            | TrainError::OtherImages { .. }
            | TrainError::OtherViews { .. } => Self::OfProcess(error.into()),
            error => Self::OfBlock(error.to_string()),
        }
    }
}

/// Trains a block, from its checkpoint on if it has one; `None` where the watcher stopped it.
fn train<R: Optimizer<Scene3d>>(
    folder: &BlocksFolder,
    block: usize,
    on: &R,
    all: &Views,
    (settings, watcher): (&WorkSettings, &dyn Watcher<usize>),
) -> Result<Option<Trained>, Failed> {
    let checkpoints = JobCheckpoints::new(folder.store(), &folder.addresses()[block], settings.lease);
    let mut interruptions = Interruptions::new(&block, watcher, checkpoints);
    let trained = catch_unwind(AssertUnwindSafe(|| {
        let views = block_views(folder.plan(), block, all)?;
        let resumed =
            interruptions.checkpoint().map(|checkpoint| Trainer3d::resume_views(on, views.clone(), checkpoint));
        let mut trainer = match resumed {
            Some(Ok(trainer)) => {
                interruptions.resumed(trainer.step());
                trainer
            }
            Some(Err(error @ TrainError::Core(CoreError::Backend { .. }))) => return Err(error.into()),
            other => {
                other.and_then(Result::err).iter().for_each(|error| interruptions.refuse(error));
                let start = folder.start(block).map_err(Failed::OfProcess)?;
                begin(on, folder.plan(), block, views, start).block_on()?
            }
        };
        trainer.run(&mut interruptions).block_on()?;
        if !trainer.is_finished() {
            return Ok(None);
        }
        let (steps, seconds, scene) = (trainer.step(), trainer.seconds(), trainer.scene().block_on()?);
        Ok(Some(Trained { steps, seconds, scene }))
    }));
    trained.unwrap_or_else(|panic| Err(Failed::OfBlock(format!("panicked: {}", panic_message(panic.as_ref())))))
}
