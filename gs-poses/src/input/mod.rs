//! What poses are found of: photographs in a folder, or frames of a video.

pub(crate) mod heic;
pub(crate) mod photographs;
pub(crate) mod source;
pub(crate) mod video;
