//! Trainings in blocks whose blocks are jobs that any number of processes share.
//!
//! [`BlocksFolder`] holds the [`BlocksPlan`], the Gaussians that each block begins with, and the results;
//! [`conduct()`] does the blocks that have no record. The result does not depend on the number of processes, on the
//! order of the blocks, or on interruptions.

mod conduct;
mod folder;
mod map;

pub use self::{
    conduct::conduct,
    folder::{BlockOutcome, BlockRecord, BlocksFolder, BlocksOrigin, Preparing},
    map::map,
};
#[cfg(doc)]
use gs_train::blocks::BlocksPlan;
