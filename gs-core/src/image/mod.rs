//! Images in memory: RGB in `f32`, as in the image file (no linearisation), 0 black, 1 white, not
//! clamped.

mod target;

pub use self::target::{TargetImage, completed};

use std::sync::Arc;

use crate::{constants::MAX_SIDE_PX, error::Error, memory, scene::check_len};

/// An RGB image, row-major from the top-left corner, `[height, width, 3]`.
///
/// A clone shares the pixels; they are copied when one of the two is written to.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Arc<Vec<[f32; 3]>>,
}

impl Image {
    /// An image of one colour, to fill with [`Self::pixels_mut`].
    ///
    /// ```
    /// let mut image = gs_core::Image::filled(3, 2, [0.0; 3])?;
    /// image.pixels_mut()[5] = [1.0, 0.5, 0.0];
    /// assert_eq!((image.pixel(0, 0), image.pixel(2, 1)), ([0.0; 3], [1.0, 0.5, 0.0]));
    /// # Ok::<(), gs_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Size`] where a side is 0 or longer than [`MAX_SIDE_PX`]; [`Error::Memory`] where
    /// the system refuses.
    pub fn filled(width: u32, height: u32, color: [f32; 3]) -> Result<Self, Error> {
        check_size(width, height)?;
        let pixels = memory::filled(width as usize * height as usize, color, "the pixels of an image")?;
        Ok(Self { width, height, pixels: Arc::new(pixels) })
    }

    /// An image from its pixels, row-major.
    ///
    /// # Errors
    /// [`Error::Size`] for an impossible size; [`Error::Length`] where `pixels` is not width ·
    /// height long.
    pub fn from_pixels(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Result<Self, Error> {
        check_size(width, height)?;
        check_len("pixels", width as usize * height as usize, pixels.len())?;
        Ok(Self { width, height, pixels: Arc::new(pixels) })
    }

    /// An image whose pixel (column, row) is `color(column, row)`.
    ///
    /// # Errors
    /// [`Error::Size`] for an impossible size; [`Error::Memory`].
    pub fn from_fn(width: u32, height: u32, mut color: impl FnMut(u32, u32) -> [f32; 3]) -> Result<Self, Error> {
        check_size(width, height)?;
        let mut pixels = memory::reserved(width as usize * height as usize, "the pixels of an image")?;
        pixels.extend((0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| color(x, y)));
        Ok(Self { width, height, pixels: Arc::new(pixels) })
    }

    /// Number of columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Size as (columns, rows).
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// All pixels, row-major, `[height · width]`.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// All pixels for writing; copied first where a clone shares them.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 3]] {
        let pixels: &mut Vec<_> = Arc::make_mut(&mut self.pixels);
        pixels
    }

    /// One row of pixels, `[width]`.
    ///
    /// # Panics
    /// Where it lies outside the image.
    pub fn row(&self, y: u32) -> &[[f32; 3]] {
        &self.pixels[y as usize * self.width as usize..][..self.width as usize]
    }

    /// The pixel in column `x` and row `y`.
    ///
    /// # Panics
    /// Where it lies outside the image.
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 3] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of a {}x{} image", self.width, self.height);
        self.pixels[(y * self.width + x) as usize]
    }

    /// The image with every value clamped to 0..=1.
    pub fn clamped(&self) -> Self {
        self.with_values(|value| value.clamp(0.0, 1.0))
    }

    /// The values in 8 bits a channel, row-major, as an 8-bit file stores them.
    ///
    /// Values are clamped to 0..=1, multiplied by 255 and rounded, halves up; NaN becomes 0.
    pub fn to_8_bits(&self) -> Vec<u8> {
        self.pixels.as_flattened().iter().map(|&value| to_8_bits(value)).collect()
    }

    /// The image rounded to 8 bits a channel: what a program reads from a file of
    /// [`Self::to_8_bits`].
    pub fn rounded_to_8_bits(&self) -> Self {
        self.with_values(rounded_to_8_bits)
    }

    /// The image of these functions of its values. A plain loop over all values becomes vector
    /// instructions; one that maps each pixel does not.
    fn with_values(&self, of: impl Fn(f32) -> f32) -> Self {
        let mut pixels = Vec::clone(&self.pixels);
        pixels.as_flattened_mut().iter_mut().for_each(|value| *value = of(*value));
        Self { pixels: Arc::new(pixels), ..*self }
    }

    /// Checks that every value is finite; `what` names the image in the error.
    ///
    /// # Errors
    /// [`Error::Pixel`] naming the first value that is not.
    pub fn check_finite(&self, what: &'static str) -> Result<(), Error> {
        let Some(at) = self.pixels.as_flattened().iter().position(|v| !v.is_finite()) else { return Ok(()) };
        let (pixel, width) = (at / 3, self.width as usize);
        let (column, row) = ((pixel % width) as u32, (pixel / width) as u32);
        Err(Error::Pixel { what, column, row, value: self.pixels[pixel][at % 3] })
    }

    /// Checks that `other` has the same size.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] with both sizes.
    pub fn same_size(&self, other: &Self) -> Result<(), Error> {
        check_same_size(self.size(), other.size())
    }
}

/// The value of a channel in 8 bits; see [`Image::to_8_bits`].
#[inline]
pub fn to_8_bits(value: f32) -> u8 {
    /// Smallest number from which on every `f32` is a whole number, so that adding it rounds,
    /// halves to even.
    const WHOLE: f32 = (1 << 23) as f32;
    // `f32::round` is a library call at the default x86-64 target.
    let scaled = value.clamp(0.0, 1.0) * 255.0;
    let even = (scaled + WHOLE) - WHOLE;
    (if scaled - even == 0.5 { even + 1.0 } else { even }) as u8
}

/// The value of a channel rounded to 8 bits.
#[inline]
pub fn rounded_to_8_bits(value: f32) -> f32 {
    f32::from(to_8_bits(value)) / 255.0
}

/// Checks that two sizes, columns and rows, are the same.
///
/// # Errors
/// [`Error::SizesDiffer`] with both sizes.
pub fn check_same_size(left: (u32, u32), right: (u32, u32)) -> Result<(), Error> {
    let ((left_width, left_height), (right_width, right_height)) = (left, right);
    let differ = Error::SizesDiffer { left_width, left_height, right_width, right_height };
    if left == right { Ok(()) } else { Err(differ) }
}

/// Checks the size of an image: both sides must be 1 to [`MAX_SIDE_PX`].
///
/// # Errors
/// [`Error::Size`] where a side is not.
pub fn check_size(width: u32, height: u32) -> Result<(), Error> {
    if width == 0 || height == 0 || width > MAX_SIDE_PX || height > MAX_SIDE_PX {
        return Err(Error::Size { width, height, limit: MAX_SIDE_PX });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bits_are_the_nearest_of_256_levels() {
        let around = |value: f32| (-3..=3).map(move |ulps| f32::from_bits((value.to_bits() as i32 + ulps) as u32));
        let ties = (0..256).flat_map(|level| around((level as f32 + 0.5) / 255.0));
        let spread = (0..100_000).map(|i| i as f32 / 80_000.0 - 0.1);
        let odd = [-0.0, 0.49999997 / 255.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE];
        for value in ties.chain(spread).chain(odd) {
            let expected = (value.clamp(0.0, 1.0) * 255.0).round() as u8;
            assert_eq!(to_8_bits(value), expected, "{value}");
        }
    }

    #[test]
    fn rounding_gives_what_a_file_holds_and_is_idempotent() {
        let image = Image::from_fn(16, 16, |x, y| [(x + 16 * y) as f32 / 255.0, -0.25, 1.5]).unwrap();
        let rounded = image.rounded_to_8_bits();
        let read: Vec<f32> = image.to_8_bits().into_iter().map(|level| f32::from(level) / 255.0).collect();
        assert_eq!(rounded.pixels().as_flattened(), read);
        assert_eq!(rounded, image.clamped(), "every level is its own");
        assert_eq!(rounded.rounded_to_8_bits(), rounded);
    }

    #[test]
    fn clones_share_their_pixels_until_one_is_written_to() {
        let image = Image::filled(3, 2, [0.5; 3]).unwrap();
        let mut other = image.clone();
        assert_eq!(other.pixels().as_ptr(), image.pixels().as_ptr());
        other.pixels_mut()[4] = [1.0; 3];
        assert_eq!((image.row(1), other.row(1)), (&[[0.5; 3]; 3][..], &[[0.5; 3], [1.0; 3], [0.5; 3]][..]));
    }

    #[test]
    fn the_first_value_that_is_not_finite_is_named() {
        let mut image = Image::filled(5, 4, [0.5; 3]).unwrap();
        image.check_finite("the target").unwrap();
        image.pixels_mut()[5 * 2 + 3][1] = f32::NAN;
        let message = image.check_finite("the target").unwrap_err().to_string();
        assert!(message.starts_with("the target is not finite (NaN) in column 3 of row 2"), "{message}");
    }
}
