#![doc = include_str!("../README.md")]

mod colmap;
mod error;
mod gps;
mod input;
mod inspection;
mod model;
mod observer;
mod plan;
mod run;
mod settings;
mod upright;
mod verdict;
mod work;

pub use self::{
    colmap::Colmap,
    error::Error,
    gps::Gps,
    input::photographs::{Exif, Photograph, Photographs},
    input::source::Source,
    input::video::{Video, is_video},
    observer::{Observer, Stage},
    run::{find_poses, refuse_other_models},
    settings::{LensKind, Pairs, Settings},
    verdict::{LeftOut, Quality, Verdict},
    work::FILES,
};
