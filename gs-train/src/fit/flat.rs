//! Images of nearly one colour, such as drawings on white.
//!
//! A sum of Gaussians cannot make a flat colour exactly: it ripples by one level of 8 bits and more
//! in a short fit. A solid background is exact and leaves the Gaussians to the details.

use gs_core::Image;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_colour_is_detected_despite_noise_and_few_details() {
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
}
