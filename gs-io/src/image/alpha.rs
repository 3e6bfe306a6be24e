//! Colours and their alpha.

use gs_core::{Error, Image, check_len, rounded_to_8_bits};

/// Composites an image over a colour: c·α + behind·(1 − α), in the stored values. `alpha` is
/// row-major.
///
/// # Errors
/// [`Error::Length`] where `alpha` is not as long as the image.
pub(crate) fn composite(image: &mut Image, alpha: &[f32], behind: [f32; 3]) -> Result<(), Error> {
    check_len("alpha", image.pixels().len(), alpha.len())?;
    for (color, &alpha) in image.pixels_mut().iter_mut().zip(alpha).filter(|(_, alpha)| **alpha < 1.0) {
        *color = std::array::from_fn(|k| color[k] * alpha + behind[k] * (1.0 - alpha));
    }
    Ok(())
}

/// An image with its colours multiplied by their alpha, which is row-major.
///
/// # Errors
/// [`Error::Length`] where `alpha` is not as long as the image.
pub fn premultiplied(image: &Image, alpha: &[f32]) -> Result<Image, Error> {
    let mut image = image.clone();
    composite(&mut image, alpha, [0.0; 3])?;
    Ok(image)
}

/// The straight colours of premultiplied ones, and alpha.
///
/// Alpha is the red channel of the image `alpha`. It is clamped and rounded to 8 bits, as a file
/// stores it, before colours are divided by it. Where it is 0, the colour is black.
///
/// # Errors
/// [`Error::SizesDiffer`] where the images differ in size.
pub fn straight(mut premultiplied: Image, alpha: &Image) -> Result<(Image, Vec<f32>), Error> {
    premultiplied.same_size(alpha)?;
    let alpha: Vec<f32> = alpha.pixels().iter().map(|pixel| rounded_to_8_bits(pixel[0])).collect();
    for (color, &alpha) in premultiplied.pixels_mut().iter_mut().zip(&alpha) {
        *color = color.map(|value| if alpha > 0.0 { value.clamp(0.0, 1.0) / alpha } else { 0.0 });
    }
    Ok((premultiplied, alpha))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_of_another_size_is_refused() {
        let image = Image::filled(12, 2, [0.5; 3]).unwrap();
        let short = Error::Length { what: "alpha", expected: 24, found: 23 };
        assert_eq!(premultiplied(&image, &[0.5; 23]), Err(short));
        let differ = Error::SizesDiffer { left_width: 12, left_height: 2, right_width: 2, right_height: 12 };
        assert_eq!(straight(image, &Image::filled(2, 12, [0.5; 3]).unwrap()), Err(differ));
    }
}
