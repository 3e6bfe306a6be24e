//! Training a large scene in blocks, each of them a training of its own.
//!
//! A coarse model of the whole is trained first. Its Gaussians say where the work is: the ground is divided into
//! [`Cell`]s of equal work, and a block trains the Gaussians in its cell and in a margin around it, from the views
//! that they contribute to, while all other Gaussians that these views show stay as they are
//! ([`TrainSettings::fixed`](crate::TrainSettings::fixed)). Of a view, a block only has the window that its Gaussians
//! contribute to. Exposure and poses are those that the coarse model was trained with.
//!
//! A Gaussian of the result belongs to the block in whose cell its mean lies, so that merging is exact.
//!
//! *Source:* cells on the ground with equally many cameras and a margin, of VastGaussian (Lin et al. 2024); a coarse
//! model that every block begins with, and views by what the block contributes to them, of CityGaussian (Liu et al.
//! 2024); a frozen surrounding, of hierarchical 3DGS (Kerbl et al. 2024).

mod assignment;
mod cells;
mod merge;
mod plan;
mod training;
mod window;

pub use self::{
    cells::{Cell, Grid, Ground},
    merge::{BlockQuality, BlocksEvaluation, Edges, evaluate, own},
    plan::{BlockPlan, BlockView, BlocksPlan, BlocksSettings, SettledView},
    training::{begin, block_views, settle},
};
