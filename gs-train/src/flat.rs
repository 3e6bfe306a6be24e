//! Images of nearly one colour, such as drawings on white.
//!
//! A sum of Gaussians cannot make a flat colour exactly: it ripples by one level of 8 bits and more
//! in a short fit. A solid background is exact and leaves the Gaussians to the details.

use gs_core::{Blend, Image, effects::Background};

use crate::settings::FitSettings;

/// Least share of pixels of one colour in an image of one colour.
const FLAT_SHARE: f64 = 0.9;

/// Largest difference between pixels of one colour in any channel, in levels of 8 bits; compression
/// changes flat areas by as much.
const SAME_LEVELS: u8 = 2;

/// The colour of nine tenths of an image's pixels, to two levels of 8 bits; `None` where they
/// differ.
pub(crate) fn flat_color(image: &Image) -> Option<[f32; 3]> {
    let levels = image.to_8_bits();
    let pixels = levels.as_chunks::<3>().0;
    let median = |channel: usize| {
        let mut counts = [0usize; 256];
        pixels.iter().for_each(|pixel| counts[usize::from(pixel[channel])] += 1);
        let mut passed = 0;
        let level = counts.iter().position(|&count| {
            passed += count;
            2 * passed >= pixels.len()
        });
        level.and_then(|level| u8::try_from(level).ok()).unwrap_or(u8::MAX)
    };
    let color = [0, 1, 2].map(median);
    let has_it = |pixel: &&[u8; 3]| pixel.iter().zip(color).all(|(&level, of_it)| level.abs_diff(of_it) <= SAME_LEVELS);
    let share = pixels.iter().filter(has_it).count() as f64 / pixels.len() as f64;
    (share >= FLAT_SHARE).then(|| color.map(|level| f32::from(level) / 255.0))
}

/// Mean colour of an image.
pub fn mean_color(image: &Image) -> [f32; 3] {
    let count = image.pixels().len() as f64;
    let sum = image
        .pixels()
        .iter()
        .fold([0.0; 3], |sum: [f64; 3], pixel| std::array::from_fn(|channel| sum[channel] + f64::from(pixel[channel])));
    sum.map(|channel| (channel / count) as f32)
}

impl FitSettings {
    /// Returns this fit with the colour of nine tenths of the target's pixels as background, if
    /// they have one colour, Gaussians are summed, and there is no background yet.
    #[must_use]
    pub fn before_flat_color(mut self, target: &Image) -> Self {
        let effects = &self.render.effects;
        if effects.blend == Blend::Sum
            && effects.background == Background::None
            && let Some(color) = flat_color(target)
            && color != [0.0; 3]
        {
            self.render = self.render.on(color);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_colour_is_found_under_details_and_noise_and_none_where_there_are_two() {
        let of = |share: u32| {
            let pixel = |x: u32, y: u32| match x + 10 * y {
                place if place < share => [(200 + place % 5) as f32 / 255.0 - 2.0 / 255.0, 0.5, 1.25],
                place => [place as f32 / 100.0, 0.0, 0.25],
            };
            flat_color(&Image::from_fn(10, 10, pixel).unwrap())
        };
        assert_eq!(of(90), Some([200.0 / 255.0, 128.0 / 255.0, 1.0]));
        assert_eq!(of(85), None);
    }

    #[test]
    fn only_a_sum_before_nothing_gets_a_background() {
        let white = Image::filled(4, 4, [1.0; 3]).unwrap();
        let settings = FitSettings::standard(10);
        assert_eq!(settings.clone().before_flat_color(&white).render.background_color(), [1.0; 3]);
        let given = FitSettings { render: settings.render.on([0.5; 3]), ..settings.clone() };
        assert_eq!(given.clone().before_flat_color(&white), given);
        let grey = Image::filled(4, 4, [0.25; 3]).unwrap();
        assert_eq!(FitSettings::paper().before_flat_color(&grey), FitSettings::paper());
        let black = Image::filled(4, 4, [0.0; 3]).unwrap();
        assert_eq!(settings.clone().before_flat_color(&black), settings, "nothing is black already");
        let ramp = Image::from_fn(16, 1, |x, _| [x as f32 / 15.0; 3]).unwrap();
        assert_eq!(settings.clone().before_flat_color(&ramp), settings);
    }
}
