//! Doing the runs of a plan, and what is stored of them.
//!
//! [`conduct()`] does the runs that are missing in a [`StudyFolder`] and stores a [`Record`] of each;
//! [`replay()`] does one again and compares. Which process does which run is decided by [`gs_jobs`].

mod conduct;
mod folder;
#[cfg(all(test, feature = "object-store-tests"))]
mod in_object_store;
mod record;
mod recorded;
mod replay;
mod result_names;
mod resumption;
mod task;
mod train;
mod trajectory;
mod watcher;

pub use self::{
    conduct::{Conducted, conduct, conduct_with, refuse_unsupported},
    folder::{Existing, RunningRun, Safety, StudyFolder},
    record::{Finished, Record, RunOutcome, ViewResult},
    replay::{recorded_run, replay},
    task::{AnyScene, StudyBackend},
    train::Replayed,
    watcher::Watcher,
};
pub(crate) use self::{
    recorded::Row,
    result_names::{CLAIMS, LATEX, MARKDOWN, PAGE, PLOTS, RESULTS, VIEWS},
    task::PICTURED_VIEWS,
};
