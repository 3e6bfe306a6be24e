//! Whether kernels are written for an effect, so that a build can leave it out: `cargo xtask effects` measures what an effect costs that is off, beside
//! a kernel in which it never was.
//!
//! In every ordinary build all are `true`. With `--cfg never_written="antialias"`, kernels take that effect for off whatever settings say, and
//! are compiled without what it alone needs; pictures with it are wrong then, and such a build is for measuring alone.

/// An order other than that of the scene's list: the depths by which Gaussians or pixels' lists are sorted.
pub const ORDER: bool = cfg!(not(never_written = "order"));

/// Harmonics above degree 0.
pub const HARMONICS: bool = cfg!(not(never_written = "harmonics"));

/// Dilation, and what compensates for it.
pub const ANTIALIAS: bool = cfg!(not(never_written = "antialias"));

/// A background other than black.
pub const BACKGROUND: bool = cfg!(not(never_written = "background"));
