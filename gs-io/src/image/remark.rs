//! Remarks on an image file.

use thiserror::Error;

/// A remark on an image file. Its text is one line that follows the image's name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Error)]
#[non_exhaustive]
pub enum ImageRemark {
    /// The colours were converted to sRGB.
    #[error("colours converted from {from} to sRGB")]
    Converted {
        /// The profile's name, or the gamma.
        from: String,
    },
    /// The colours were read as sRGB though the file declares something else.
    #[error("colours taken for sRGB, although {why}")]
    ProfileIgnored {
        /// The reason.
        why: String,
    },
}
