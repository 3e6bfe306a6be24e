#![doc = include_str!("../README.md")]
//! # What is read and written
//!
//! | what | read | written |
//! |---|---|---|
//! | images (PNG, JPEG, BMP, TIFF, WebP, GIF, PNM) | [`read_image`] | [`write_png`] |
//! | … with alpha and ICC profiles | [`read_stored_image`] | [`write_png_with`] |
//! | … and places on a map (GeoTIFF, world files) | – | [`write_tiff`], [`write_world_file`] |
//! | grey images of 16 bits, such as depth maps | – | [`write_grey_png`] |
//! | animations (APNG) | – | [`write_animation`] |
//! | a scene of any kind: a scene file, a checkpoint, an output folder | [`read_scene`] | – |
//! | 2D scenes, `.gs2d.safetensors`, lossless | [`read_2d`] | [`write_2d`] |
//! | 2D scenes, `.gsi`, compressed | [`read_gsi`] | [`gs_codec::Picture::encode`] |
//! | checkpoints of a training run, lossless | [`read_checkpoint`] | [`write_checkpoint`] |
//! | 3D scenes: PLY, `.splat`, SPZ, SOG, RAD, glTF; `.ksplat` is read only | [`read_3d`] | [`write_3d`] |
//! | … with levels of detail: streamed SOG, RAD | [`read_3d`], [`LodFile3d`] | [`write_3d`] |
//! | … with levels of detail: 3D Tiles | – | [`write_3d`] |
//! | edits of 3D scenes: moving, cropping, joining and the like | [`Edit`] | – |
//! | data sets of posed images: COLMAP, Nerfstudio, Blender, OpenSfM, Metashape, RealityScan, LLFF | [`dataset::read_dataset`] | – |
//!
//! [`write_atomically`] makes a file appear complete or not at all; [`write_durably`], used for
//! scenes and checkpoints, also syncs it to the disk before it replaces another. A [`FolderClaim`]
//! keeps a run from replacing files that no run wrote.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod animation;
mod any_scene;
mod atomic;
mod checkpoint;
mod container;
pub mod dataset;
#[cfg(feature = "write")]
mod earth;
#[cfg(feature = "write")]
mod edit;
mod error;
#[doc(hidden)]
pub mod fuzzing;
mod image;
mod inputs;
mod npy;
mod output_folder;
mod picture;
mod scene2d;
mod scene3d;
mod text;
mod world_frame;

pub use gs_codec::Extent;

#[cfg(feature = "write")]
pub use crate::edit::{Done, Edit, EditError, Filter};

#[cfg(feature = "write")]
pub use self::scene3d::write_levels_of_parts_3d;
pub use crate::{
    animation::{Animation, write_animation},
    any_scene::{AnyScene, FRAME_ENTRY, SceneFile, Values, decode_scene, is_scene, read_scene, readable_in, scene_in},
    atomic::{abandon_writes, prepare_folder, remove_leftovers, write_atomically, write_durably},
    checkpoint::{Checkpoint, decode_checkpoint, encode_checkpoint, read_checkpoint, write_checkpoint},
    error::Error,
    image::{
        GeoReference, IccProfile, ImageRemark, LoadedImage, Orientation, PngExtras, StoredImage, heic_files,
        image_files, png_bytes, png_bytes_with, premultiplied, read_image, read_image_on, read_image_size,
        read_stored_image, straight, unreadable_photographs, write_grey_png, write_png, write_png_with, write_tiff,
        write_world_file,
    },
    inputs::Inputs,
    output_folder::{FolderClaim, OutputFolder},
    picture::draw_with_alpha,
    scene2d::{
        File2d, GSI_EXTENSION, GsiFile, SCENE_EXTENSION, decode_gsi, encode_2d, is_gsi, read_2d, read_gsi, write_2d,
    },
    scene3d::{
        ConversionLoss, Coordinates, Encoded3d, File3d, FilesInMemory, Format3d, LevelsInMemory, LodFile3d, Parts3d,
        SpzVersion, TrainedWith, WriteOptions3d, Written3d, decode_3d, encode_3d, format_3d, move_scene, read_3d,
        transform_scene, write_3d, write_parts_3d, writes_parts_3d,
    },
    text::{percent_decoded, utf8_text},
    world_frame::WorldFrame,
};
