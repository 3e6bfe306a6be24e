//! The number of Gaussians that `--psnr` and `--bytes` choose.

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::counted;
use gs_train::{EncodeSettings, EncodeTarget, FitSettings, count_for_psnr, encode};

use super::arguments::CountArgs;
use crate::{failure::Failure, image_fit::FitImage, terminal::output};

impl CountArgs {
    /// Whether a flag chooses the number.
    pub(super) fn chooses(&self) -> bool {
        self.psnr.is_some() || self.bytes.is_some()
    }

    /// Fails where a flag is out of range, before anything is read.
    pub(super) fn validate(&self) -> Result<(), Failure> {
        let targets = [self.psnr.map(EncodeTarget::Psnr), self.bytes.map(EncodeTarget::Bytes)];
        targets.into_iter().flatten().try_for_each(|target| Ok(target.validate()?))
    }

    /// The settings with the number for this target; they stay as they are where no flag chooses it.
    pub(super) fn apply(
        &self,
        on: &AnyRasterizer,
        target: &FitImage,
        settings: FitSettings,
    ) -> Result<FitSettings, Failure> {
        let (count, why) = match (self.psnr, self.bytes) {
            (Some(psnr), _) => {
                let with = |count| settings.clone().with_gaussians(count);
                (count_for_psnr(on, &target.image, psnr, with).block_on()?, format!("for {psnr} dB"))
            }
            (None, Some(bytes)) => {
                let encoding = encoding(EncodeTarget::Bytes(bytes), &settings);
                let encoded = encode(on, &target.image, &encoding, &|_| ()).block_on()?;
                (encoded.gaussians as u32, format!("in a .gsi file of {bytes} bytes"))
            }
            (None, None) => return Ok(settings),
        };
        output::note(format_args!("{}: {} {why}", target.name(), counted(count, "Gaussian")));
        Ok(settings.with_gaussians(count.max(1)))
    }
}

fn encoding(target: EncodeTarget, of_fit: &FitSettings) -> EncodeSettings {
    EncodeSettings::default().with(|s| {
        (s.target, s.tune, s.seed) = (target, of_fit.tune, of_fit.seed);
    })
}
