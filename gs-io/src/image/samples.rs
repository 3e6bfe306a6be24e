//! Pixels in the samples of their file: 8 or 16 bits, or floating point.

use gs_core::Image;
use image::DynamicImage;
use rayon::prelude::*;

use super::color::Colors;

/// Pixels per call of a conversion of colours.
const CHUNK: usize = 4096;

/// Pixels that a thread converts at once.
const PARALLEL_CHUNK: usize = 1 << 16;

/// A sample of a pixel.
pub(crate) trait Sample: Copy + Default + Send + Sync + 'static {
    /// The number that stands for 1.
    const WHITE: f32;

    /// The sample as a number, unscaled.
    fn number(self) -> f32;

    /// The sample closest to a number, unscaled.
    fn nearest(number: f32) -> Self;

    /// Pixels of such samples.
    fn any(pixels: Pixels<Self>) -> AnyPixels;
}

impl Sample for u8 {
    const WHITE: f32 = 255.0;

    fn number(self) -> f32 {
        self.into()
    }

    fn nearest(number: f32) -> Self {
        rounded(number) as Self
    }

    fn any(pixels: Pixels<Self>) -> AnyPixels {
        AnyPixels::Bits8(pixels)
    }
}

impl Sample for u16 {
    const WHITE: f32 = 65535.0;

    fn number(self) -> f32 {
        self.into()
    }

    fn nearest(number: f32) -> Self {
        rounded(number) as Self
    }

    fn any(pixels: Pixels<Self>) -> AnyPixels {
        AnyPixels::Bits16(pixels)
    }
}

/// The nearest integer to a number from 0 to 65535, the even one of two: means of a few integers are
/// often halfway, and would become lighter. Without SSE 4.1, `round_ties_even` is a call.
fn rounded(number: f32) -> f32 {
    // Floats have no fractions from here on.
    const WHOLE: f32 = 8_388_608.0;
    (number + WHOLE) - WHOLE
}

impl Sample for f32 {
    const WHITE: f32 = 1.0;

    fn number(self) -> f32 {
        self
    }

    fn nearest(number: f32) -> Self {
        number
    }

    fn any(pixels: Pixels<Self>) -> AnyPixels {
        AnyPixels::Floats(pixels)
    }
}

/// Pixels with three samples each (RGB), or four (RGB and alpha, not premultiplied).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pixels<S> {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) has_alpha: bool,
    /// Row-major, pixel by pixel.
    pub(crate) samples: Vec<S>,
}

impl<S: Sample> Pixels<S> {
    /// The pixels of decoded samples with `CHANNELS` = 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 (RGB,
    /// alpha) channels. Grey is repeated in all channels.
    fn of<const CHANNELS: usize>((width, height): (u32, u32), samples: Vec<S>, colors: &Colors) -> AnyPixels {
        let pixels = samples.as_chunks::<CHANNELS>().0;
        let samples = match CHANNELS {
            1 => pixels.iter().flat_map(|pixel| [pixel[0]; 3]).collect(),
            2 => pixels.iter().flat_map(|pixel| [pixel[0], pixel[0], pixel[0], pixel[1]]).collect(),
            _ => samples,
        };
        let mut pixels = Self { width, height, has_alpha: CHANNELS.is_multiple_of(2), samples };
        pixels.convert(colors);
        S::any(pixels)
    }

    /// Converts the colours to sRGB.
    fn convert(&mut self, colors: &Colors) {
        if !matches!(colors, Colors::Converted(_)) {
            return;
        }
        let channels = self.channels();
        let mut converted = Vec::with_capacity(CHUNK);
        for pixels in self.samples.chunks_mut(channels * CHUNK) {
            converted.clear();
            let color = |pixel: &[S]| [pixel[0], pixel[1], pixel[2]].map(|sample| sample.number() / S::WHITE);
            converted.extend(pixels.chunks_exact(channels).map(color));
            colors.apply(&mut converted);
            for (pixel, color) in pixels.chunks_exact_mut(channels).zip(&converted) {
                for (sample, value) in pixel.iter_mut().zip(color) {
                    *sample = S::nearest(value * S::WHITE);
                }
            }
        }
    }

    /// Samples of a pixel.
    pub(crate) fn channels(&self) -> usize {
        if self.has_alpha { 4 } else { 3 }
    }

    /// The unscaled numbers of grey pixels; `None` if a pixel is not grey.
    pub(crate) fn grey(&self) -> Option<Vec<f32>> {
        let grey = |pixel: &[S]| {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(Sample::number);
            (r == g && g == b).then_some(r)
        };
        self.samples.chunks_exact(self.channels()).map(grey).collect()
    }

    /// The numbers of a pixel; alpha is 1 without an alpha channel.
    pub(crate) fn number(&self, index: usize) -> [f32; 4] {
        let channels = self.channels();
        let pixel = &self.samples[index * channels..][..channels];
        [pixel[0].number(), pixel[1].number(), pixel[2].number(), pixel.get(3).map_or(S::WHITE, |alpha| alpha.number())]
    }
}

/// Pixels of any samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum AnyPixels {
    Bits8(Pixels<u8>),
    Bits16(Pixels<u16>),
    Floats(Pixels<f32>),
}

/// Evaluates an expression with pixels of whichever samples there are.
macro_rules! with_pixels {
    ($any:expr, $pixels:ident => $value:expr) => {
        match $any {
            $crate::image::AnyPixels::Bits8($pixels) => $value,
            $crate::image::AnyPixels::Bits16($pixels) => $value,
            $crate::image::AnyPixels::Floats($pixels) => $value,
        }
    };
}
pub(crate) use with_pixels;

impl AnyPixels {
    /// The pixels of a decoded image, in sRGB.
    pub(super) fn of_image(decoded: DynamicImage, colors: &Colors) -> Self {
        let size = (decoded.width(), decoded.height());
        match decoded {
            DynamicImage::ImageLuma8(b) => Pixels::of::<1>(size, b.into_raw(), colors),
            DynamicImage::ImageLumaA8(b) => Pixels::of::<2>(size, b.into_raw(), colors),
            DynamicImage::ImageRgb8(b) => Pixels::of::<3>(size, b.into_raw(), colors),
            DynamicImage::ImageRgba8(b) => Pixels::of::<4>(size, b.into_raw(), colors),
            DynamicImage::ImageLuma16(b) => Pixels::of::<1>(size, b.into_raw(), colors),
            DynamicImage::ImageLumaA16(b) => Pixels::of::<2>(size, b.into_raw(), colors),
            DynamicImage::ImageRgb16(b) => Pixels::of::<3>(size, b.into_raw(), colors),
            DynamicImage::ImageRgba16(b) => Pixels::of::<4>(size, b.into_raw(), colors),
            DynamicImage::ImageRgb32F(b) => Pixels::of::<3>(size, b.into_raw(), colors),
            other => Pixels::of::<4>(size, other.into_rgba32f().into_raw(), colors),
        }
    }

    /// The image, and its alpha if it has any: stored integers divided by 255 or 65535.
    pub(crate) fn to_image(&self) -> Result<(Image, Option<Vec<f32>>), gs_core::Error> {
        let (width, height) = self.size();
        let (colors, alpha) = with_pixels!(self, pixels => floats(pixels));
        Ok((Image::from_pixels(width, height, colors)?, alpha))
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> (u32, u32) {
        with_pixels!(self, pixels => (pixels.width, pixels.height))
    }
}

/// Colours and alpha in floating point.
fn floats<S: Sample>(pixels: &Pixels<S>) -> (Vec<[f32; 3]>, Option<Vec<f32>>) {
    let channels = pixels.channels();
    let count = pixels.samples.len() / channels;
    let value = |sample: S| sample.number() / S::WHITE;
    let mut colors = vec![[0.0; 3]; count];
    let chunks = colors.par_chunks_mut(PARALLEL_CHUNK).zip(pixels.samples.par_chunks(channels * PARALLEL_CHUNK));
    if !pixels.has_alpha {
        chunks.for_each(|(colors, samples)| {
            colors.as_flattened_mut().iter_mut().zip(samples).for_each(|(color, &sample)| *color = value(sample));
        });
        return (colors, None);
    }
    chunks.for_each(|(colors, samples)| {
        for (color, pixel) in colors.iter_mut().zip(samples.as_chunks::<4>().0) {
            color.iter_mut().zip(pixel).for_each(|(color, &sample)| *color = value(sample));
        }
    });
    let alpha = pixels.samples.as_chunks::<4>().0.iter().map(|pixel| value(pixel[3])).collect();
    (colors, Some(alpha))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_to_the_nearest_sample_and_the_even_one_of_two() {
        let numbers = [0.0, 0.5, 1.5, 2.5, 7.49, 7.51, 254.5, 255.0, 255.00002];
        assert_eq!(numbers.map(u8::nearest), [0, 0, 2, 2, 7, 8, 254, 255, 255]);
        assert_eq!([0.5, 65533.5, 65534.5, 65535.0].map(u16::nearest), [0, 65534, 65534, 65535]);
        assert_eq!(f32::nearest(0.3), 0.3);
    }
}
