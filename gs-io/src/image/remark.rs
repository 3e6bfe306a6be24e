//! Remarks on an image file.

use std::fmt;

use serde::Serialize;

/// A remark on an image file. Its text is one line that follows the image's name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ImageRemark {
    /// The file is an animation; its first frame was read.
    FirstFrame,
    /// The file has several pages; the first was read.
    FirstPage,
    /// The colours were converted to sRGB.
    Converted {
        /// The profile's name, or the gamma.
        from: String,
    },
    /// The colours were read as sRGB though the file declares something else.
    ProfileIgnored {
        /// The reason.
        why: String,
    },
}

impl fmt::Display for ImageRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FirstFrame => f.write_str("animated: only the first frame is used"),
            Self::FirstPage => f.write_str("several pages: only the first is used"),
            Self::Converted { from } => write!(f, "colours converted from {from} to sRGB"),
            Self::ProfileIgnored { why } => write!(f, "colours taken for sRGB, although {why}"),
        }
    }
}
