//! A data set that has been read.

use std::path::PathBuf;

use glam::Vec3;
use serde::Serialize;

use super::{Remark, Split, SplitOrigin, View};
use crate::WorldFrame;

/// The kind of a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DatasetKind {
    /// COLMAP's sparse model.
    Colmap,
    /// A `transforms.json`.
    Nerfstudio,
    /// `transforms_train.json` and its companions.
    Blender,
    /// A `reconstruction.json`.
    OpenSfm,
    /// Agisoft XML.
    Metashape,
    /// A CSV of internal and external camera parameters.
    RealityScan,
    /// A `poses_bounds.npy`.
    Llff,
}

impl DatasetKind {
    /// The name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "COLMAP",
            Self::Nerfstudio => "Nerfstudio",
            Self::Blender => "Blender",
            Self::OpenSfm => "OpenSfM",
            Self::Metashape => "Metashape",
            Self::RealityScan => "RealityScan",
            Self::Llff => "LLFF",
        }
    }

    /// The usual background: white for Blender's objects without surroundings, otherwise black.
    pub fn background(self) -> [f32; 3] {
        if self == Self::Blender { [1.0; 3] } else { [0.0; 3] }
    }
}

/// A data set of posed images, with the points that were triangulated from them.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// The kind.
    pub kind: DatasetKind,
    /// The folder.
    pub root: PathBuf,
    /// The frame of all cameras and points, relative to the data set's own world.
    pub frame: WorldFrame,
    /// The usable views, sorted by unique names; never empty, and at least one is for training.
    pub views: Vec<View>,
    /// Points of the scene; often none (Blender).
    pub points: Vec<Point>,
    /// Where the split comes from.
    pub split: SplitOrigin,
    /// Remarks on what was left out, scaled or undistorted.
    pub remarks: Vec<Remark>,
}

impl Dataset {
    /// The views of a split, sorted by name.
    pub fn views_of(&self, split: Split) -> impl Iterator<Item = &View> {
        self.views.iter().filter(move |view| view.split == split)
    }
}

/// A point of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Position in the data set's frame; finite.
    pub position: Vec3,
    /// RGB as in the images, 0 to 1.
    pub color: [f32; 3],
}
