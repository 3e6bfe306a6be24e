//! An image in memory: RGB in `f32`, as the image file has it (no linearisation), 0 black, 1 white, not clamped.

use crate::{constants::MAX_SIDE_PX, error::Error};

/// An RGB image, row-major from the top-left corner, `[height, width, 3]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 3]>,
}

impl Image {
    /// An image of one colour.
    ///
    /// # Errors
    /// [`Error::Size`] when a side is 0 or longer than [`MAX_SIDE_PX`].
    pub fn filled(width: u32, height: u32, color: [f32; 3]) -> Result<Self, Error> {
        check_size(width, height)?;
        Ok(Self { width, height, pixels: vec![color; width as usize * height as usize] })
    }

    /// An image from its pixels, row-major.
    ///
    /// # Errors
    /// [`Error::Size`] for an impossible size, [`Error::Length`] when `pixels` is not width · height long.
    pub fn from_pixels(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Result<Self, Error> {
        check_size(width, height)?;
        let expected = width as usize * height as usize;
        if pixels.len() != expected {
            return Err(Error::Length { what: "pixels", expected, found: pixels.len() });
        }
        Ok(Self { width, height, pixels })
    }

    /// An image whose pixel (column, row) is `color(column, row)`.
    ///
    /// # Errors
    /// [`Error::Size`] for an impossible size.
    pub fn from_fn(width: u32, height: u32, mut color: impl FnMut(u32, u32) -> [f32; 3]) -> Result<Self, Error> {
        check_size(width, height)?;
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| color(x, y)).collect();
        Ok(Self { width, height, pixels })
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// (columns, rows).
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// All pixels, row-major, `[height · width]`.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// All pixels, to write.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 3]] {
        &mut self.pixels
    }

    /// The pixel in column `x` and row `y`.
    ///
    /// # Panics
    /// When it lies outside the image.
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 3] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of a {}x{} image", self.width, self.height);
        self.pixels[(y * self.width + x) as usize]
    }

    /// The same image with every value in 0..=1 (what a display or an 8-bit file shows).
    pub fn clamped(&self) -> Self {
        let pixels = self.pixels.iter().map(|p| p.map(|v| v.clamp(0.0, 1.0))).collect();
        Self { pixels, ..*self }
    }

    /// The image as it is written in 8 bits a channel: values in 0..=1, rounded to multiples of 1/255.
    pub fn rounded_to_8_bits(&self) -> Self {
        let pixels = self.pixels.iter().map(|p| p.map(|v| (v.clamp(0.0, 1.0) * 255.0).round() / 255.0)).collect();
        Self { pixels, ..*self }
    }

    /// Fails unless every value is finite; `what` is what the image is.
    ///
    /// # Errors
    /// [`Error::Pixel`] naming the first that is not.
    pub fn check_finite(&self, what: &'static str) -> Result<(), Error> {
        let Some(at) = self.pixels.as_flattened().iter().position(|v| !v.is_finite()) else { return Ok(()) };
        let (pixel, width) = (at / 3, self.width as usize);
        let (column, row) = ((pixel % width) as u32, (pixel / width) as u32);
        Err(Error::Pixel { what, column, row, value: self.pixels[pixel][at % 3] })
    }

    /// Fails unless `other` has the same size.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] with both sizes.
    pub fn same_size(&self, other: &Self) -> Result<(), Error> {
        if self.size() == other.size() {
            return Ok(());
        }
        Err(Error::SizesDiffer {
            left_width: self.width,
            left_height: self.height,
            right_width: other.width,
            right_height: other.height,
        })
    }
}

/// Fails unless both sides are 1 to [`MAX_SIDE_PX`].
///
/// # Errors
/// [`Error::Size`].
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
    fn the_first_value_that_is_not_finite_is_named() {
        let mut image = Image::filled(5, 4, [0.5; 3]).unwrap();
        image.check_finite("the target").unwrap();
        image.pixels_mut()[5 * 2 + 3][1] = f32::NAN;
        let message = image.check_finite("the target").unwrap_err().to_string();
        assert!(message.starts_with("the target is not finite (NaN) in column 3 of row 2"), "{message}");
    }
}
