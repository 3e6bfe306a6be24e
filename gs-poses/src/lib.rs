#![doc = include_str!("../README.md")]

mod colmap;
mod error;
mod gps;
mod heic;
mod inspection;
mod model;
mod photographs;
mod plan;
mod process;
mod program;
mod run;
mod settings;
mod source;
mod upright;
mod verdict;
mod video;

pub use self::{
    colmap::Colmap,
    error::Error,
    gps::Gps,
    photographs::{Exif, Photograph, Photographs},
    run::{FILES, Observer, Stage, find_poses, refuse_other_models},
    settings::{LensKind, Pairs, Settings},
    source::Source,
    verdict::{LeftOut, Quality, Verdict},
    video::{Video, is_video},
};
