//! Pixels in the form of windows: `0x00RRGGBB`, row-major from the top-left corner.

use gs_core::Image;

/// A picture to show.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<u32>,
}

/// A window's pixels, to write; at least one row and one column.
#[derive(Debug)]
pub(crate) struct Screen<'a> {
    /// Columns.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    /// `[height · width]`.
    pub(crate) pixels: &'a mut [u32],
}

/// Two neighbouring pixels of a picture, and the share of the second, of 256.
type Between = (usize, usize, u32);

impl Picture {
    /// An image, rounded to 8 bits a channel.
    pub(crate) fn of(image: &Image) -> Self {
        let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u32;
        let pixels = image.pixels().iter().map(|rgb| byte(rgb[0]) << 16 | byte(rgb[1]) << 8 | byte(rgb[2])).collect();
        Self { width: image.width() as usize, height: image.height() as usize, pixels }
    }

    /// Fills the screen with the picture. If the sizes differ, it is stretched bilinearly.
    pub(crate) fn show(&self, screen: &mut Screen<'_>) {
        if (self.width, self.height) == (screen.width, screen.height) {
            screen.pixels.copy_from_slice(&self.pixels);
            return;
        }
        let columns: Vec<Between> = (0..screen.width).map(|x| between(x, screen.width, self.width)).collect();
        for (y, row) in screen.pixels.chunks_exact_mut(screen.width).enumerate() {
            let (above, below, lower) = between(y, screen.height, self.height);
            let [above, below] = [above, below].map(|y| &self.pixels[y * self.width..][..self.width]);
            for (pixel, &(left, right, righter)) in row.iter_mut().zip(&columns) {
                let top = mixed(above[left], above[right], righter);
                *pixel = mixed(top, mixed(below[left], below[right], righter), lower);
            }
        }
    }
}

/// The place of pixel `at` of `of` in a row of `pixels`, at most that of the last.
fn between(at: usize, of: usize, pixels: usize) -> Between {
    let last = pixels - 1;
    let place = ((at as f32 + 0.5) * pixels as f32 / of as f32 - 0.5).clamp(0.0, last as f32);
    let first = place as usize;
    (first, (first + 1).min(last), ((place - first as f32) * 256.0) as u32)
}

/// The two colours mixed, with `share` of 256 of the second; two channels at a time.
pub(crate) fn mixed(a: u32, b: u32, share: u32) -> u32 {
    let mix = |a: u32, b: u32| ((a * (256 - share) + b * share) >> 8) & 0x00ff_00ff;
    mix(a & 0x00ff_00ff, b & 0x00ff_00ff) | mix(a >> 8 & 0x00ff_00ff, b >> 8 & 0x00ff_00ff) << 8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(picture: &Picture, width: usize, height: usize) -> Vec<u32> {
        let mut pixels = vec![0xdead_beef; width * height];
        picture.show(&mut Screen { width, height, pixels: &mut pixels });
        pixels
    }

    fn picture(width: u32, height: u32, color: impl FnMut(u32, u32) -> [f32; 3]) -> Picture {
        Picture::of(&Image::from_fn(width, height, color).unwrap())
    }

    #[test]
    fn colours_are_clamped_and_in_the_order_red_green_blue() {
        let colors = [[1.0, 0.0, 0.0], [0.0, 0.5, -3.0], [f32::NAN, 7.0, 1.0]];
        let three = picture(3, 1, |x, _| colors[x as usize]);
        assert_eq!(shown(&three, 3, 1), [0x00ff_0000, 0x0000_8000, 0x0000_ffff]);
    }

    #[test]
    fn mixing_is_exact() {
        let (a, b) = (0x0010_80ff, 0x00f0_8000);
        assert_eq!((mixed(a, b, 0), mixed(a, b, 256)), (a, b));
        assert_eq!(mixed(a, b, 128), 0x0080_807f);
    }

    #[test]
    fn a_stretched_picture_keeps_its_colours_in_place() {
        let halves = picture(4, 2, |x, y| if x < 2 { [1.0, 0.0, 0.2] } else { [0.0, y as f32, 0.2] });
        let pixels = shown(&halves, 40, 20);
        for (x, y, expected) in [(3, 3, 0x00ff_0033), (12, 15, 0x00ff_0033), (36, 2, 0x33), (36, 18, 0xff33)] {
            assert_eq!(pixels[y * 40 + x], expected, "({x}, {y})");
        }
        let row: Vec<u32> = (0..40).map(|x| pixels[x] >> 16).collect();
        assert!(row.is_sorted_by(|a, b| a >= b), "{row:?}");
        assert_eq!(shown(&halves, 1, 1).len(), 1, "a smaller screen works as well");
        assert_eq!(shown(&picture(1, 1, |_, _| [1.0; 3]), 5, 3), [0x00ff_ffff; 15]);
    }
}
