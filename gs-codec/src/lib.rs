#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod coder;
mod error;
mod exp2;
mod file;
mod grid;
mod layer;
mod local;
mod mixer;
mod number;
mod quantizer;

pub use error::Error;
pub use file::{Decoded, Extent, Layer, MAGIC, Picture, decode, is_gsi};
pub use layer::{Code, LayerHead};
pub use quantizer::Quantizer;
