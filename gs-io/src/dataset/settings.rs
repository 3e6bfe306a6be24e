//! Settings for reading a data set.

use std::num::NonZeroU32;

use crate::WorldFrame;

/// Settings for reading a data set.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DatasetSettings {
    /// The folder with the images, relative to the data set, such as `images_4`. `None` uses the
    /// data set's own, or the first of `images`, `images_2`, `images_4` and `images_8` that has
    /// images. Intrinsics follow the real size.
    pub image_folder: Option<String>,
    /// If the data set has no split, every n-th view by name, starting with the first, is held out
    /// for tests; `None` holds out none. *Source:* Mip-NeRF 360 and 3DGS hold out every 8th.
    pub test_every: Option<NonZeroU32>,
    /// Whether [`Self::test_every`] replaces the data set's own split.
    pub replace_split: bool,
    /// The meaning of the images' alpha channels.
    pub alpha: AlphaMeaning,
    /// Images with a longer side are scaled down to this many pixels when they are read, with their
    /// intrinsics. `None` never scales.
    pub max_side: Option<NonZeroU32>,
    /// The frame of cameras and points, such as that of a scene to render from these views. `None`
    /// chooses one that suits the data set ([`WorldFrame::of`]).
    pub frame: Option<WorldFrame>,
    /// Whether files outside the data set's folder may be read, if the data set refers to them by
    /// absolute paths or `..`. Otherwise such a data set is refused. Links inside the folder are
    /// always followed.
    pub allow_outside: bool,
}

gs_core::impl_with!(DatasetSettings);

impl Default for DatasetSettings {
    fn default() -> Self {
        Self {
            image_folder: None,
            test_every: NonZeroU32::new(8),
            replace_split: false,
            alpha: AlphaMeaning::Opacity,
            max_side: None,
            frame: None,
            allow_outside: false,
        }
    }
}

gs_core::choices! {
    /// The meaning of an image's alpha channel.
    #[derive(Default)]
    pub enum AlphaMeaning {
        /// Opacity of the object: the scene should be as transparent (NeRF-synthetic).
        #[default]
        Opacity = "opacity": "Opacity: transparent pixels stay transparent in the scene",
        /// A mask: pixels count from ½ on.
        Mask = "mask": "A mask: only opaque pixels count",
    }
}
