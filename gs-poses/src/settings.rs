//! What a caller can choose.

use std::path::PathBuf;

gs_core::choices! {
    /// The kind of lens.
    #[derive(Default)]
    pub enum LensKind {
        /// By the EXIF data.
        #[default]
        Auto = "auto": "By the EXIF data, perspective without any",
        /// A lens that keeps straight lines nearly straight.
        Perspective = "perspective": "Straight lines are nearly straight",
        /// A fish-eye.
        Fisheye = "fisheye": "A fish-eye, or an action camera at its widest",
    }
}

gs_core::choices! {
    /// Which pairs of photographs are compared.
    #[derive(Default)]
    pub enum Pairs {
        /// By their number.
        #[default]
        Auto = "auto": "All of up to 150 photographs, neighbours of more",
        /// All.
        All = "all": "All pairs, whose number grows with the square of that of photographs",
        /// Those next to each other by time or name, as in a video.
        Neighbours = "neighbours": "Those next to each other by time or name, as in a video",
    }
}

/// Settings for finding poses.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Settings {
    /// The kind of lens.
    pub lens: LensKind,
    /// Which pairs are compared.
    pub pairs: Pairs,
    /// Photographs with a longer side are scaled down to this many pixels to find features, px; at
    /// least 100.
    pub max_size: u32,
    /// A vocabulary tree of COLMAP, by which neighbours are complemented by photographs that show the
    /// same place. Without one, that which COLMAP 3.12 and later fetch is used.
    pub vocabulary: Option<PathBuf>,
    /// Number of threads; `None` is one for each core.
    pub threads: Option<u32>,
}

gs_core::impl_with!(Settings);

impl Default for Settings {
    fn default() -> Self {
        Self { lens: LensKind::Auto, pairs: Pairs::Auto, max_size: 1600, vocabulary: None, threads: None }
    }
}
