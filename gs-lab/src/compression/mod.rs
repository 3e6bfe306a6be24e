//! Compressed images compared with other formats: files of the same image, curves of quality over
//! size, and Bjøntegaard rates.

mod codec;
mod curve;

pub use self::{
    codec::{CODECS, Codec, Coded, Original},
    curve::{RateCurve, ms_ssim_decibels},
};
