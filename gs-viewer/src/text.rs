//! Text over a picture, in the font of figures. Glyphs are rasterised once per size.

use std::collections::HashMap;

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};

use crate::pixels::{Screen, mixed};

/// Height of a line at the usual density of pixels, px.
const LINE_HEIGHT: f32 = 17.0;

/// Space around the text, in line heights.
const MARGIN: f32 = 0.4;

/// Opacity of the panel behind the text, of 256.
const PANEL: u32 = 160;

const INK: u32 = 0x00f0_f0f0;

/// The range of a display's pixel density, relative to the usual one.
const DENSITIES: [f64; 2] = [0.5, 8.0];

/// The shape of a character, relative to the left end and the top of its line.
#[derive(Debug, Clone)]
struct Glyph {
    left: i32,
    top: i32,
    width: usize,
    /// Coverage of each pixel, of 256, row-major.
    coverage: Vec<u32>,
}

/// Writes lines of text.
#[derive(Debug)]
pub(crate) struct Writer {
    font: FontRef<'static>,
    scale: PxScale,
    glyphs: HashMap<char, Option<Glyph>>,
}

impl Writer {
    /// A writer for a display of this pixel density, relative to the usual one.
    pub(crate) fn new(density: f64) -> Self {
        let font = FontRef::try_from_slice(epaint_default_fonts::HACK_REGULAR).expect("the built-in font is a font");
        let [least, most] = DENSITIES;
        let density = if density.is_finite() { density.clamp(least, most) as f32 } else { 1.0 };
        Self { font, scale: PxScale::from((density * LINE_HEIGHT).round()), glyphs: HashMap::new() }
    }

    /// Writes the lines into the top-left corner, on a dark panel. Text that does not fit is cut
    /// off.
    pub(crate) fn write(&mut self, lines: &[String], screen: &mut Screen<'_>) {
        let height = self.scale.y;
        // All characters of the font have one width.
        let advance = self.font.as_scaled(self.scale).h_advance(self.font.glyph_id('0'));
        let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
        if longest == 0 {
            return;
        }
        let margin = MARGIN * height;
        let panel = [longest as f32 * advance + 2.0 * margin, lines.len() as f32 * height + 2.0 * margin];
        let [columns, rows] = panel.map(|side| side.ceil() as usize);
        for row in screen.pixels.chunks_exact_mut(screen.width).take(rows) {
            row.iter_mut().take(columns).for_each(|pixel| *pixel = mixed(*pixel, 0, PANEL));
        }
        for (number, line) in lines.iter().enumerate() {
            let top = (margin + number as f32 * height).round() as i32;
            for (column, character) in line.chars().enumerate() {
                let left = (margin + column as f32 * advance).round();
                if left as usize >= screen.width {
                    break;
                }
                let (font, scale) = (&self.font, self.scale);
                let glyph = self.glyphs.entry(character).or_insert_with(|| Glyph::of(font, scale, character));
                if let Some(glyph) = glyph {
                    glyph.draw(left as i32, top, screen);
                }
            }
        }
    }
}

impl Glyph {
    /// The shape of a character; `None` for a space.
    fn of(font: &FontRef<'_>, scale: PxScale, character: char) -> Option<Self> {
        let ascent = font.as_scaled(scale).ascent();
        let glyph = font.glyph_id(character).with_scale_and_position(scale, point(0.0, ascent));
        let outline = font.outline_glyph(glyph)?;
        let bounds = outline.px_bounds();
        let (width, height) = (bounds.width() as usize, bounds.height() as usize);
        let mut coverage = vec![0; width * height];
        outline.draw(|x, y, share| {
            if let Some(pixel) = coverage.get_mut(y as usize * width + x as usize) {
                *pixel = (share.clamp(0.0, 1.0) * 256.0) as u32;
            }
        });
        Some(Self { left: bounds.min.x as i32, top: bounds.min.y as i32, width, coverage })
    }

    fn draw(&self, left: i32, top: i32, screen: &mut Screen<'_>) {
        for (y, shares) in self.coverage.chunks_exact(self.width.max(1)).enumerate() {
            let row = top + self.top + y as i32;
            if !(0..screen.height as i32).contains(&row) {
                continue;
            }
            let row = &mut screen.pixels[row as usize * screen.width..][..screen.width];
            for (x, &share) in shares.iter().enumerate() {
                let column = usize::try_from(left + self.left + x as i32);
                if let Some(pixel) = column.ok().and_then(|column| row.get_mut(column)) {
                    *pixel = mixed(*pixel, INK, share);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: u32 = 0x0080_8080;

    fn written(lines: &[&str], density: f64, width: usize, height: usize) -> Vec<u32> {
        let lines: Vec<String> = lines.iter().map(|&line| line.to_owned()).collect();
        let mut pixels = vec![GREY; width * height];
        Writer::new(density).write(&lines, &mut Screen { width, height, pixels: &mut pixels });
        pixels
    }

    fn ink(pixels: &[u32]) -> usize {
        pixels.iter().filter(|&&pixel| pixel & 0xff > 0xa0).count()
    }

    #[test]
    fn text_is_bright_on_a_dark_panel() {
        let pixels = written(&["12.5 ms", "×² · ä"], 1.0, 300, 80);
        assert!(ink(&pixels) > 100, "{}", ink(&pixels));
        assert!(pixels[0] & 0xff < 0x60, "the panel is dark: {:x}", pixels[0]);
        assert_eq!(pixels[299], GREY, "and ends");
        assert_eq!(pixels[79 * 300], GREY);
        assert!(ink(&written(&["12.5 ms"], 2.0, 300, 80)) > 2 * ink(&written(&["12.5 ms"], 1.0, 300, 80)));
    }

    #[test]
    fn empty_text_changes_nothing() {
        assert_eq!(written(&[], 1.0, 9, 9), [GREY; 81]);
        assert_eq!(written(&["", ""], 1.0, 9, 9), [GREY; 81]);
        assert_eq!(ink(&written(&["   "], 1.0, 90, 30)), 0);
    }

    #[test]
    fn text_that_does_not_fit_is_cut_off() {
        let long = "a long line ".repeat(1000);
        for (width, height) in [(1, 1), (7, 3), (50, 200)] {
            written(&[long.as_str(); 50], 3.0, width, height);
        }
        written(&[&long], f64::NAN, 20, 20);
        written(&[&long], 1e300, 20, 20);
    }
}
