//! Compares the shapes of images.

/// Whether two sizes are those of the same picture, apart from rounding to whole pixels.
pub(crate) fn same_shape((width, height): (u32, u32), (other_width, other_height): (f64, f64)) -> bool {
    let (width, height) = (f64::from(width), f64::from(height));
    // (w + a)·H = (h + b)·W with |a|, |b| < 1. False for NaN.
    (width * other_height - height * other_width).abs() < other_width + other_height
}
