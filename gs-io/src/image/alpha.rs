//! Colours and their alpha.

use gs_core::{Image, rounded_to_8_bits};

/// Composites an image over a colour: c·α + behind·(1 − α), in the stored values. `alpha` is
/// row-major and as long as the image.
pub(crate) fn composite(image: &mut Image, alpha: &[f32], behind: [f32; 3]) {
    for (color, &alpha) in image.pixels_mut().iter_mut().zip(alpha).filter(|(_, alpha)| **alpha < 1.0) {
        *color = std::array::from_fn(|k| color[k] * alpha + behind[k] * (1.0 - alpha));
    }
}

/// An image with its colours multiplied by their alpha, which is row-major and as long as the image.
pub fn premultiplied(image: &Image, alpha: &[f32]) -> Image {
    let mut image = image.clone();
    composite(&mut image, alpha, [0.0; 3]);
    image
}

/// The straight colours of premultiplied ones, and alpha.
///
/// Of the image `alpha`, of the same size, red counts. Alpha is clamped and rounded to 8 bits, as a
/// file stores it, before colours are divided by it. Where it is 0, the colour is black.
pub fn straight(mut premultiplied: Image, alpha: &Image) -> (Image, Vec<f32>) {
    let alpha: Vec<f32> = alpha.pixels().iter().map(|pixel| rounded_to_8_bits(pixel[0])).collect();
    for (color, &alpha) in premultiplied.pixels_mut().iter_mut().zip(&alpha) {
        *color = color.map(|value| if alpha > 0.0 { value.clamp(0.0, 1.0) / alpha } else { 0.0 });
    }
    (premultiplied, alpha)
}
