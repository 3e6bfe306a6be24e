//! Sizes of what is kept in memory, and what follows from them alone.

/// A pixel of an image: three `f32`.
pub(super) const IMAGE: u64 = 12;

/// A pixel of one channel.
pub(super) const PLANE: u64 = 4;

/// A pixel of an image that is kept as its file stores it: three of 8 bits.
pub(super) const COMPACT: u64 = 3;

/// Images that are read ahead.
pub(crate) const READ_AHEAD: u64 = 8;

/// A pixel of a view that is evaluated: the rendering and the image, and copies of both, rounded and
/// with mapped colours.
pub(super) const EVALUATED: u64 = 72;

/// Most bytes of the views that are evaluated at the same time, unless a single view needs more.
const MOST_EVALUATED: u64 = 512 << 20;

/// Pixels of all targets above which they are kept compact.
const COMPACT_FROM: u64 = 25_000_000;

/// Memory for code, threads and tables.
pub(super) const BASE: u64 = 60_000_000;

/// A pixel that is encoded, besides the image: measured at 25 megapixels and 1 bit per pixel.
pub(super) const ENCODED: u64 = 110;

/// A pixel of a transparent image besides the picture that is encoded: its colours and its alpha.
pub(crate) const TRANSPARENT: u64 = IMAGE + PLANE;

/// A pixel's weight.
pub(crate) const WEIGHT: u64 = PLANE;

/// Number of pixels of an image of this size that are encoded at once in `most` bytes.
pub(crate) fn encoding_at_once((width, height): (u32, u32), most: u64) -> u64 {
    let pixels = pixels(width, height);
    pixels.min(most.saturating_sub(BASE + pixels * IMAGE) / ENCODED)
}

/// Number of views of at most this many pixels that are evaluated at the same time, a thread for each.
pub(crate) fn evaluated_at_once(pixels: u64) -> usize {
    rayon::current_num_threads().min((MOST_EVALUATED / (EVALUATED * pixels).max(1)) as usize).max(1)
}

/// Whether so many pixels are kept as [`gs_core::TargetImage::compact`] targets: with what D-SSIM
/// adds, other targets would take more than 1.2 GB. A step on the CPU takes about a tenth longer.
pub(crate) fn is_compact(pixels: u64) -> bool {
    pixels > COMPACT_FROM
}

/// Number of pixels in strips of 16 columns.
pub(super) fn pixels(width: u32, height: u32) -> u64 {
    u64::from(width.next_multiple_of(16)) * u64::from(height)
}
