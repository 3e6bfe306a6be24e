//! What an encoder aims at.

use gs_core::Error;

use crate::{error, fit::Tune};

gs_core::impl_with!(EncodeSettings);

/// What decides about the size of an encoded image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EncodeTarget {
    /// As good as possible in at most this many bytes.
    Bytes(u64),
    /// As small as possible with at least this PSNR of the decoded 8-bit image, dB.
    Psnr(f64),
    /// A step of quantization, 1 (small file) to 100 (best image). The number of Gaussians follows
    /// from it and the image.
    Quality(u8),
}

/// What the beginning of a file shows before the rest is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EncodeLayers {
    /// The upper part of the picture: the file has one layer.
    #[default]
    One,
    /// A coarse picture, in the first 300 bytes, not counting a profile. At half a bit per pixel, the whole
    /// loses 0.1 dB at most. Files below about a kilobyte have none.
    Preview,
    /// Of the first third, the picture nearly as well as a file of that size. The whole is then 1.4 dB
    /// worse than a file of one layer, as a mean over 14 images
    /// (`benchmarks/2026-11-25-epyc-2-cores/compression.md`).
    Progressive,
}

/// Settings of [`encode`](crate::encode()).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct EncodeSettings {
    /// What to aim at. Default [`EncodeTarget::Quality`] 50.
    pub target: EncodeTarget,
    /// The measure that the colours are tuned for; alpha is not tuned. [`EncodeTarget::Psnr`] still
    /// means PSNR. Default [`Tune::Psnr`].
    pub tune: Tune,
    /// What the beginning of the file shows. Default [`EncodeLayers::One`].
    pub layers: EncodeLayers,
    /// Memory that encoding may take, the image included, bytes. An image that would take more is
    /// encoded in bands of rows; a transparent one is refused. Default 4 GB.
    pub memory: u64,
    /// Seed of all random numbers. Default 0.
    pub seed: u32,
}

impl Default for EncodeSettings {
    fn default() -> Self {
        Self {
            target: EncodeTarget::Quality(50),
            tune: Tune::Psnr,
            layers: EncodeLayers::One,
            memory: 4_000_000_000,
            seed: 0,
        }
    }
}

/// Least length of a file: header, the head of a layer and a few Gaussians.
pub(super) const LEAST_BYTES: u64 = 64;

impl EncodeTarget {
    /// Checks its range.
    fn validate(self) -> Result<(), Error> {
        match self {
            Self::Bytes(bytes) => Error::within("the number of bytes", bytes, LEAST_BYTES.., "at least 64"),
            Self::Psnr(psnr) => Error::within("the PSNR", psnr, 10.0..=60.0, "10 to 60 dB"),
            Self::Quality(quality) => Error::within("the quality", quality, 1..=100, "1 to 100"),
        }
    }

    /// The target of the rest of a file, of which `taken` bytes are spent.
    pub(super) fn without(self, taken: u64) -> Self {
        match self {
            Self::Bytes(bytes) => Self::Bytes(bytes.saturating_sub(taken)),
            other => other,
        }
    }

    /// That it cannot be met.
    pub(super) fn unreachable(self) -> error::Error {
        let target = match self {
            Self::Bytes(bytes) => format!("a size of {bytes} bytes"),
            Self::Psnr(psnr) => format!("a PSNR of {psnr} dB"),
            Self::Quality(quality) => format!("quality {quality}"),
        };
        error::Error::Unreachable { target }
    }
}

impl EncodeSettings {
    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size below 64 bytes, a PSNR outside 10 to 60 dB, or a quality outside 1
    /// to 100.
    pub fn validate(&self) -> Result<(), Error> {
        self.target.validate()
    }
}
