//! Options for writing 3D scenes.

use std::path::Path;

use gs_core::Scene3d;

use super::{Format3d, trained_with::TrainedWith};
use crate::WorldFrame;

/// Options for writing scenes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct WriteOptions3d {
    /// How the scene was trained, and in which frame it is, which is stored if the format allows it.
    pub trained_with: TrainedWith,
    /// The coordinates of the file.
    pub coordinates: Coordinates,
    /// The version of an SPZ.
    pub spz_version: SpzVersion,
    /// The EPSG code of the world's coordinates, which places 3D Tiles on the globe: 4978 for ECEF, or a zone of UTM.
    pub epsg: Option<u16>,
}

gs_core::impl_with!(WriteOptions3d);

gs_core::choices! {
    /// The coordinates in which a scene is written.
    #[derive(Default)]
    pub enum Coordinates {
        /// Those of the scene, in its frame.
        #[default]
        Scene = "scene",
        /// Those of the world that its frame refers to. Far from the world's origin, PLY has means of
        /// 64 bits then, glTF a node that moves the scene, and other formats cannot hold them.
        World = "world",
    }
}

impl WriteOptions3d {
    /// The frame of the scene, if the file must have coordinates of another.
    pub(super) fn world(&self) -> Option<WorldFrame> {
        let frame = self.trained_with.frame;
        (self.coordinates == Coordinates::World && !frame.is_world()).then_some(frame)
    }
}

/// A scene to encode.
pub(crate) struct ToWrite<'a> {
    pub(super) format: Format3d,
    /// The place of the file, for errors and for the names of further files.
    pub(super) path: &'a Path,
    pub(super) scene: &'a Scene3d,
    pub(super) options: &'a WriteOptions3d,
}

gs_core::choices! {
    /// A version of SPZ that can be written.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum SpzVersion {
        /// One gzip stream, for readers older than 2026.
        V3 = "3",
        /// A zstd stream per parameter: smaller, and faster to read.
        #[default]
        V4 = "4",
    }
}
