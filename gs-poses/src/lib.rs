#![doc = include_str!("../README.md")]

mod colmap;
mod error;
mod gps;
mod input;
mod inspection;
mod model;
mod plan;
mod reporter;
mod run;
mod settings;
mod upright;
mod verdict;
mod work;

pub use self::{
    colmap::Colmap,
    error::Error,
    gps::Gps,
    input::Input,
    input::photographs::{Exif, Photograph, Photographs},
    input::video::{Video, is_video},
    reporter::{Reporter, Stage},
    run::{find_poses, refuse_other_models},
    settings::{LensKind, Pairs, Settings},
    verdict::{LeftOut, PoseQuality, Verdict},
    work::FILES,
};
