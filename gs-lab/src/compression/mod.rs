//! Compressed images compared with other formats: files of the same image, curves of quality over
//! size, Bjøntegaard rates, and the page of an encoded image.

mod codec;
mod curve;
mod page;

pub use self::{
    codec::{CODECS, Codec, Coded, Original},
    curve::{RateCurve, ms_ssim_decibels},
    page::{EncodePage, page},
};
