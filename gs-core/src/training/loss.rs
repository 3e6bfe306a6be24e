//! The losses that training can minimise.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{constants::DSSIM_LAMBDA, error::Error, settings::Choice};

/// Loss between the rendered image C and the target Y, both `[H, W, 3]`, not clamped.
///
/// Every loss is a mean over pixels and channels. Exhaustive: a backend must handle each value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Loss {
    /// mean (C − Y)². *Source:* GaussianImage.
    L2,
    /// mean |C − Y|; its gradient where C = Y is 0.
    L1,
    /// (1 − λ) L1 + λ (1 − SSIM(C, Y)) (*source:* paper eq. 6, 3DGS), SSIM with an 11×11 Gaussian
    /// window of σ 1.5, borders padded with zeros as in 3DGS.
    L1Dssim {
        /// λ in 0..=1; [`DSSIM_LAMBDA`] in the paper.
        lambda: f32,
    },
}

impl Loss {
    /// The paper's loss: L1 and D-SSIM with λ = 0.2.
    pub const PAPER: Self = Self::L1Dssim { lambda: DSSIM_LAMBDA };

    /// Whether the loss is a sum over pixels, so that [`TargetImage::weights`] can be factors of it.
    ///
    /// [`TargetImage::weights`]: crate::TargetImage::weights
    pub const fn is_pointwise(self) -> bool {
        matches!(self, Self::L2 | Self::L1)
    }

    /// Checks λ.
    ///
    /// # Errors
    /// [`Error::Setting`] where λ is outside 0..=1.
    pub fn validate(&self) -> Result<(), Error> {
        match *self {
            Self::L1Dssim { lambda } => Error::within("loss lambda", lambda, 0.0..=1.0, "0 to 1"),
            _ => Ok(()),
        }
    }

    /// [`Self::validate`] for a backend that weights pixels in pointwise losses only, and a target with
    /// weights or without.
    ///
    /// # Errors
    /// Those of [`Self::validate`]; [`Error::Unsupported`].
    pub fn check_weights(&self, backend: &'static str, weighted: bool) -> Result<(), Error> {
        self.validate()?;
        match weighted && !self.is_pointwise() {
            true => Err(Error::unsupported(backend, format!("weights of pixels under loss `{self}`"))),
            false => Ok(()),
        }
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Choice for Loss {
    const CHOICES: &'static [Self] = &[Self::L2, Self::L1, Self::PAPER];

    /// The same for every λ.
    fn name(self) -> &'static str {
        match self {
            Self::L2 => "l2",
            Self::L1 => "l1",
            Self::L1Dssim { .. } => "l1-dssim",
        }
    }

    fn summary(self) -> &'static str {
        match self {
            Self::L2 => "Mean squared difference: the best PSNR",
            Self::L1 => "Mean absolute difference",
            Self::L1Dssim { .. } => "0.8 L1 + 0.2 (1 - SSIM), as in the paper",
        }
    }
}
