//! The formats of files with 3D scenes.

use std::fmt;

/// A file format of 3D scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format3d {
    /// 3DGS PLY.
    Ply,
    /// PlayCanvas compressed PLY. Readers treat it like [`Self::Ply`], because the header
    /// distinguishes them.
    CompressedPly,
    /// `.splat`.
    Splat,
    /// SPZ.
    Spz,
    /// `.gltf`.
    Gltf,
    /// `.glb`. Readers treat it like [`Self::Gltf`], because the first bytes distinguish them.
    Glb,
    /// SOG, PlayCanvas's format for the web, in one file: `.sog`.
    Sog,
    /// SOG as images next to a file `meta.json`.
    SogFolder,
    /// `.ksplat`, of mkkellogg's viewer.
    Ksplat,
    /// A checkpoint of a training run, which [`read_checkpoint`](crate::read_checkpoint) reads
    /// instead of this module.
    Checkpoint,
}

impl fmt::Display for Format3d {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ply => "3DGS PLY",
            Self::CompressedPly => "compressed PLY",
            Self::Splat => ".splat",
            Self::Spz => "SPZ",
            Self::Gltf => "glTF",
            Self::Glb => "binary glTF",
            Self::Sog => "SOG",
            Self::SogFolder => "SOG in a folder",
            Self::Ksplat => ".ksplat",
            Self::Checkpoint => "checkpoint",
        })
    }
}
