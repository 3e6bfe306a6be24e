//! The formats of files with 3D scenes.

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
    /// Streamed SOG: levels of detail of the cells of a tree, as SOGs in the folders next to a file
    /// `lod-meta.json`.
    StreamedSog,
    /// RAD, of Spark, with a tree of levels of detail.
    Rad,
    /// 3D Tiles, the format of CesiumJS for the globe: levels of detail as `.glb` next to a file `tileset.json`. Only
    /// written.
    Tiles3d,
    /// `.ksplat`, of mkkellogg's viewer.
    Ksplat,
    /// A checkpoint of a training run, which [`read_checkpoint`](crate::read_checkpoint) reads
    /// instead of this module.
    Checkpoint,
}
