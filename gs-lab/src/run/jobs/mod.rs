//! Jobs that any number of processes share, on any number of machines: each is done by one process,
//! whatever process dies.
//!
//! Jobs are known by their addresses only. [`WorkSettings`] say how a process takes part, a
//! [`StoreAddress`] where the jobs' files are if not in a folder, and [`slurm`] which part of the
//! jobs an array's task begins with.

mod claims;
pub(crate) mod job_files;
mod queue;
pub(crate) mod run_store;
pub mod slurm;
mod system;
mod work;

pub use self::{
    claims::ClaimNote,
    run_store::StoreAddress,
    work::{AtEnd, Shard, WorkSettings},
};
pub(crate) use self::{
    claims::{Claims, State},
    queue::{Overseer, Queue},
    run_store::{Keep, RunStore},
};
