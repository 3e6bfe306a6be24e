//! Jobs that any number of processes share, on any number of machines: each job is done by one
//! process, whatever process dies.
#![doc = include_str!("../README.md")]

mod claims;
mod error;
pub mod files;
mod queue;
pub mod slurm;
mod store;
mod system;
mod work;

pub use self::{
    claims::{Claim, Claims, Holder},
    error::Error,
    files::Listing,
    queue::{Overseer, Queue},
    store::{Content, JobStore, Keep},
    work::{AtEnd, Shard, WorkSettings},
};
