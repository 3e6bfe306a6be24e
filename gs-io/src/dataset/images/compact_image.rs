//! An image for training in the samples of its file, with its mask.

use super::{PosedImage, Window};
use crate::image::{AnyPixels, Pixels, Sample, with_pixels};

/// A [`PosedImage`] in a quarter of its memory: in 8 bits a channel, 16 where its file has more, or
/// floating-point numbers where its file has those.
#[derive(Debug, Clone, PartialEq)]
pub struct CompactImage {
    pub(crate) pixels: AnyPixels,
    /// Which pixels count; `None` if all do.
    pub(crate) mask: Option<Vec<bool>>,
}

/// Bytes of the header of [`CompactImage::to_bytes`].
const HEADER: usize = 16;

impl CompactImage {
    /// Columns and rows.
    pub fn size(&self) -> (u32, u32) {
        self.pixels.size()
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> u64 {
        let samples = with_pixels!(&self.pixels, pixels => size_of_val(&pixels.samples[..]));
        (samples + self.mask.as_ref().map_or(0, Vec::len)) as u64
    }

    /// A part of the image.
    ///
    /// # Panics
    /// Where the window is not in the image.
    #[must_use]
    pub fn cropped(&self, Window { left, top, width, height }: Window) -> Self {
        let all = self.size().0 as usize;
        let rows = |each: usize| {
            let from = move |y: u32| each * (y as usize * all + left as usize);
            (top..top + height).map(move |y| from(y)..from(y) + each * width as usize)
        };
        let mask = self.mask.as_ref().map(|mask| rows(1).map(|row| &mask[row]).collect::<Vec<_>>().concat());
        let pixels = with_pixels!(&self.pixels, pixels => {
            let has_alpha = pixels.has_alpha;
            let lines: Vec<_> = rows(pixels.channels()).map(|row| &pixels.samples[row]).collect();
            Sample::any(Pixels { width, height, has_alpha, samples: lines.concat() })
        });
        Self { pixels, mask }
    }

    /// The image in floating point: stored integers divided by 255 or 65535.
    ///
    /// # Errors
    /// [`gs_core::Error`] where memory is not sufficient.
    pub fn to_posed(&self) -> Result<PosedImage, gs_core::Error> {
        let (image, alpha) = self.pixels.to_image()?;
        Ok(PosedImage { image, alpha, mask: self.mask.clone() })
    }

    /// The image as bytes, for [`Self::from_bytes`] of the same version of this crate.
    pub fn to_bytes(&self) -> Vec<u8> {
        let (width, height) = self.size();
        let has_alpha = with_pixels!(&self.pixels, pixels => pixels.has_alpha);
        let kind = match self.pixels {
            AnyPixels::Bits8(_) => 1,
            AnyPixels::Bits16(_) => 2,
            AnyPixels::Floats(_) => 4,
        };
        let mut bytes = Vec::with_capacity(HEADER + self.bytes() as usize);
        bytes.extend([width, height].into_iter().flat_map(u32::to_le_bytes));
        bytes.extend([kind, u8::from(has_alpha), u8::from(self.mask.is_some())]);
        bytes.resize(HEADER, 0);
        match &self.pixels {
            AnyPixels::Bits8(pixels) => bytes.extend_from_slice(&pixels.samples),
            AnyPixels::Bits16(pixels) => bytes.extend(pixels.samples.iter().flat_map(|sample| sample.to_le_bytes())),
            AnyPixels::Floats(pixels) => bytes.extend(pixels.samples.iter().flat_map(|sample| sample.to_le_bytes())),
        }
        bytes.extend(self.mask.iter().flatten().map(|&counts| u8::from(counts)));
        bytes
    }

    /// The image of [`Self::to_bytes`]; `None` where these are other bytes.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (header, content) = bytes.split_first_chunk::<HEADER>()?;
        let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let (width, height, [kind, has_alpha, masked]) = (number(0), number(4), [header[8], header[9], header[10]]);
        let count = width as usize * height as usize;
        let has_alpha = has_alpha == 1;
        let samples = count * if has_alpha { 4 } else { 3 };
        let (samples, mask) = content.split_at_checked(samples * usize::from(kind))?;
        let pixels = match kind {
            1 => AnyPixels::Bits8(Pixels { width, height, has_alpha, samples: samples.to_vec() }),
            2 => {
                let samples = samples.as_chunks().0.iter().map(|&bytes| u16::from_le_bytes(bytes)).collect();
                AnyPixels::Bits16(Pixels { width, height, has_alpha, samples })
            }
            _ => {
                let samples = samples.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
                AnyPixels::Floats(Pixels { width, height, has_alpha, samples })
            }
        };
        let is_whole = mask.len() == if masked == 1 { count } else { 0 };
        let mask = (masked == 1).then(|| mask.iter().map(|&counts| counts == 1).collect());
        is_whole.then_some(Self { pixels, mask })
    }
}

impl From<&PosedImage> for CompactImage {
    /// The same image, in floating point.
    fn from(posed: &PosedImage) -> Self {
        let PosedImage { image, alpha, mask } = posed;
        let samples = match alpha {
            None => image.pixels().as_flattened().to_vec(),
            Some(alpha) => image.pixels().iter().zip(alpha).flat_map(|(&[r, g, b], &a)| [r, g, b, a]).collect(),
        };
        let (width, height) = image.size();
        let pixels = AnyPixels::Floats(Pixels { width, height, has_alpha: alpha.is_some(), samples });
        Self { pixels, mask: mask.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_of_all_samples_come_back_from_their_bytes() {
        let (width, height) = (3, 2);
        for has_alpha in [false, true] {
            let count = 6 * if has_alpha { 4 } else { 3 };
            let all = [
                u8::any(Pixels { width, height, has_alpha, samples: (0..count as u8).collect() }),
                u16::any(Pixels { width, height, has_alpha, samples: (0..count as u16).map(|v| 2_500 * v).collect() }),
                f32::any(Pixels { width, height, has_alpha, samples: (0..count).map(|v| v as f32 / 7.0).collect() }),
            ];
            for (pixels, mask) in all.into_iter().zip([None, Some(vec![true, false, true, true, false, false]), None]) {
                let image = CompactImage { pixels, mask };
                let bytes = image.to_bytes();
                assert_eq!(bytes.len() as u64, HEADER as u64 + image.bytes());
                assert_eq!(CompactImage::from_bytes(&bytes).as_ref(), Some(&image));
                assert_eq!(CompactImage::from_bytes(&bytes[..bytes.len() - 1]), None);
                // Floats hold the numbers of all others exactly.
                let posed = image.to_posed().unwrap();
                assert_eq!(CompactImage::from(&posed).to_posed().unwrap(), posed);
            }
        }
    }

    #[test]
    fn integers_are_divided_by_the_largest() {
        let pixels = u8::any(Pixels { width: 1, height: 1, has_alpha: true, samples: vec![255, 0, 51, 102] });
        let posed = CompactImage { pixels, mask: None }.to_posed().unwrap();
        assert_eq!((posed.image.pixels(), posed.alpha), (&[[1.0, 0.0, 0.2]][..], Some(vec![0.4])));
        let pixels = u16::any(Pixels { width: 1, height: 1, has_alpha: false, samples: vec![65535, 0, 1] });
        let posed = CompactImage { pixels, mask: None }.to_posed().unwrap();
        assert_eq!((posed.image.pixels(), posed.alpha), (&[[1.0, 0.0, 1.0 / 65535.0]][..], None));
    }
}
