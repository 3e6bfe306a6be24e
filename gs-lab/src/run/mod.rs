//! Doing the runs of a plan, and what is stored of them.
//!
//! [`conduct()`] does the runs that are missing in a [`StudyFolder`] and stores a `Record` of each.
//! Which process does which run is decided by [`gs_jobs`].

mod conduct;
mod folder;
mod record;
mod result_names;
mod resumption;
mod task;
mod train;
mod trajectory;
mod watcher;

#[cfg(test)]
pub(crate) use self::record::tests;
pub(crate) use self::{
    conduct::message as panic_message,
    record::{Record, ViewResult},
    result_names::{CLAIMS, PAGE, PLOTS, VIEWS},
    resumption::{Interruptions, JobCheckpoints, remove_checkpoint},
    task::PICTURED_VIEWS,
};
pub use self::{
    conduct::{Conducted, conduct, refuse_unsupported},
    folder::{Existing, Preparation, StudyFolder},
    record::{Finished, RunOutcome},
    watcher::{Job, Watcher},
};
