//! A picture with a line of text below it.

use gs_core::Image;
use plotters::{
    prelude::*,
    style::text_anchor::{HPos, VPos},
};

use super::{embed_font, surface::Surface};
use crate::error::Error;

/// Height of the line and size of its letters, px.
const HEIGHT: u32 = 24;
const LETTERS: f64 = 17.0;

/// Adds a line of text on white below a picture. Its letters become smaller where the picture is
/// narrow.
///
/// # Errors
/// [`Error::Picture`] with what the drawing library reports.
pub fn captioned(picture: &Image, text: &str) -> Result<Image, Error> {
    embed_font();
    let failed = |message: String| Error::Picture { name: "the caption".to_owned(), message };
    let width = picture.width();
    let mut bytes = vec![255; 3 * (width * HEIGHT) as usize];
    let mut surface = Surface::Pixels(BitMapBackend::with_buffer(&mut bytes, (width, HEIGHT)));
    // A letter is half as wide as its size.
    let fitting = f64::from(width) / (0.5 * text.chars().count().max(1) as f64);
    let place = (width as i32 / 2, HEIGHT as i32 / 2);
    surface.text(text, place, LETTERS.min(fitting), (HPos::Center, VPos::Center)).map_err(failed)?;
    surface.finish().map_err(failed)?;
    let line = bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0));
    let pixels = picture.pixels().iter().copied().chain(line).collect();
    Image::from_pixels(width, picture.height() + HEIGHT, pixels).map_err(|error| failed(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_below_the_picture_at_any_width() {
        for width in [1, 40, 400] {
            let picture = Image::filled(width, 30, [0.2, 0.4, 0.6]).unwrap();
            let made = captioned(&picture, "step 3 of 400: 9000 Gaussians").unwrap();
            assert_eq!(made.size(), (width, 30 + HEIGHT));
            assert_eq!(made.pixel(width - 1, 29), [0.2, 0.4, 0.6]);
            let dark =
                (0..width).flat_map(|x| (30..54).map(move |y| (x, y))).filter(|&(x, y)| made.pixel(x, y)[0] < 0.5);
            assert!(width < 400 || dark.count() > 20, "{width}");
        }
    }
}
