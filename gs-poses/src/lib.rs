#![doc = include_str!("../README.md")]

mod colmap;
mod error;
mod inspection;
mod model;
mod photographs;
mod plan;
mod process;
mod run;
mod settings;
mod upright;
mod verdict;

pub use self::{
    colmap::Colmap,
    error::Error,
    photographs::{Exif, Photograph, Photographs},
    run::{FILES, Observer, Stage, find_poses},
    settings::{LensKind, Pairs, Settings},
    verdict::{LeftOut, Quality, Verdict},
};
