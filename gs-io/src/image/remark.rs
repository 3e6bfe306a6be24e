//! What is worth knowing about an image that was read.

use std::fmt;

use serde::Serialize;

/// Something that an image's pixels alone do not say. Its text is one line, made to follow the image's name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ImageRemark {
    /// The file holds an animation, of which the first frame is the image.
    FirstFrame,
    /// The file holds several pages, of which the first is the image.
    FirstPage,
    /// The colours were converted to sRGB.
    Converted {
        /// From what: a profile's name, or a gamma.
        from: String,
    },
    /// The colours are not known to be sRGB, and are taken as if they were.
    ProfileIgnored {
        /// Why they were not converted.
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
