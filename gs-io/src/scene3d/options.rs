//! Options for writing 3D scenes.

use super::trained_with::TrainedWith;
use crate::WorldFrame;

/// Options for writing scenes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct WriteOptions3d {
    /// How the scene was trained, and in which frame it is, which is stored if the format allows it.
    pub trained_with: TrainedWith,
    /// The coordinates of the file.
    pub coordinates: Coordinates,
    /// Options for SPZ.
    pub spz: SpzOptions,
    /// Options for `.gltf`.
    pub gltf_buffer: GltfBuffer,
}

gs_core::impl_with!(WriteOptions3d);

/// The coordinates in which a scene is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Coordinates {
    /// Those of the scene, in its frame.
    #[default]
    Scene,
    /// Those of the world that its frame refers to. Far from the world's origin, PLY has means of
    /// 64 bits then, glTF a node that moves the scene, and other formats cannot hold them.
    World,
}

impl WriteOptions3d {
    /// The frame of the scene, if the file must have coordinates of another.
    pub(super) fn world(&self) -> Option<WorldFrame> {
        let frame = self.trained_with.frame;
        (self.coordinates == Coordinates::World && !frame.is_world()).then_some(frame)
    }
}

/// A version of SPZ that can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum SpzVersion {
    /// One gzip stream, for readers older than 2026.
    V3,
    /// A zstd stream per parameter: smaller, and faster to read.
    #[default]
    V4,
}

/// Options for writing SPZ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct SpzOptions {
    /// The version.
    pub version: SpzVersion,
    /// Bits of SH coefficients of degree 1, 1 to 8. Fewer bits compress better.
    pub degree_1_bits: u8,
    /// Bits of SH coefficients of higher degrees, 1 to 8.
    pub higher_degree_bits: u8,
}

gs_core::impl_with!(SpzOptions);

impl Default for SpzOptions {
    /// Version 4 with 5 and 4 bits, as in Niantic's library.
    fn default() -> Self {
        Self { version: SpzVersion::default(), degree_1_bits: 5, higher_degree_bits: 4 }
    }
}

/// Where the buffer of a `.gltf` is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum GltfBuffer {
    /// In the JSON as base64: a single file, a third larger.
    #[default]
    Inside,
    /// In a `.bin` of the same name.
    Beside,
}
