#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod coder;
mod decode;
mod error;
mod exp2;
mod file;
mod grid;
mod layer;
mod local;
mod mixer;
mod number;
mod profile;
mod quantizer;

pub use decode::{Decoded, DecodedAlpha, Extent, decode, is_gsi};
pub use error::Error;
pub use file::{Alpha, Layer, MAGIC, Picture};
pub use layer::{Code, LayerHead};
pub use profile::profile_bytes;
pub use quantizer::Quantizer;
