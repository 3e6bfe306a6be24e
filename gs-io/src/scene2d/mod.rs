//! Files of 2D scenes.
//!
//! [`read_2d`] and [`write_2d`] are lossless; [`read_gsi`] reads compressed pictures.

mod gsi;
mod scene_file;

pub(crate) use self::scene_file::{decode_2d, is_2d, read_2d_unchecked};
pub use self::{
    gsi::{GSI_EXTENSION, GsiFile, decode_gsi, is_gsi, read_gsi},
    scene_file::{File2d, SCENE_EXTENSION, encode_2d, read_2d, write_2d},
};
