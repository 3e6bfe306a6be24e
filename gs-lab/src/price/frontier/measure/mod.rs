//! How time and error are measured: against the exact picture, in turn, and with their noise.

mod noise;
mod picture_error;
mod timing;
mod truth;
mod unseen;

pub use self::{
    noise::{Noise, TimeComparison},
    picture_error::PictureError,
    truth::Verifiable,
    unseen::{unseen_cameras, unseen_canvases},
};
pub(crate) use self::{
    timing::{Candidate, ROUNDS, interleaved},
    truth::Truth,
};
