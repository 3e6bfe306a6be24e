//! Transparent images: alpha is a picture of its own, next to premultiplied colours.

use gs_codec::{Alpha, Picture};
use gs_core::{
    Image, Optimizer, Scene2d,
    metrics::{mse_of_psnr, psnr_of_mse},
    to_8_bits,
};
use gs_io::premultiplied;

use super::{
    encoder::{Encoder, Part},
    layers::FirstLayer,
    progress::Report,
    settings::{EncodeSettings, EncodeTarget},
};
use crate::encode::Made;
use crate::{error::Error, memory::TRANSPARENT};

/// Bytes of the header that a file of alpha alone has, and that alpha with colours does not need.
const HEADER_BYTES: u64 = 12;

/// Share of a size that alpha gets, and PSNR of alpha, dB, of which more is not worth its bytes.
///
/// On four images at 0.3 and 1 bits per pixel, the PSNR of alpha and colours is 0.1 dB below the best of
/// nine ways to share the bytes, as a mean, and 0.4 dB at most. Without [`ENOUGH_DB`] it is 0.3 dB and
/// 0.9 dB below it.
const SHARE: f64 = 0.2;
const ENOUGH_DB: f64 = 50.0;

/// Encodes alpha first, so that the colours get the bytes that it leaves.
pub(super) async fn transparent<R: Optimizer<Scene2d>>(
    on: &R,
    image: &Image,
    alpha: &[f32],
    target: EncodeTarget,
    settings: &EncodeSettings,
    report: &Report<'_>,
) -> Result<Made, Error> {
    let (first, background) = (FirstLayer::of(settings.layers), median(alpha));
    let waiting = alpha.len() as u64 * TRANSPARENT;
    let settings = &settings.with(|s| s.memory = s.memory.saturating_sub(waiting));
    let grey = Image::from_pixels(image.width(), image.height(), alpha.iter().map(|&alpha| [alpha; 3]).collect())?;
    let of_alpha = async |target| {
        let encoder = Encoder::new(on, &grey, [background; 3], None, settings, report)?;
        encoder.encode(target, first.map(FirstLayer::of_alpha)).await
    };
    let alpha_part = match target {
        EncodeTarget::Bytes(bytes) => {
            let part = of_alpha(EncodeTarget::Bytes((SHARE * bytes as f64) as u64)).await?;
            match part.psnr > ENOUGH_DB {
                false => part,
                true => match of_alpha(EncodeTarget::Psnr(ENOUGH_DB)).await {
                    Err(Error::Unreachable { .. }) => part,
                    enough => Some(enough?).filter(|enough| enough.bytes < part.bytes).unwrap_or(part),
                },
            }
        }
        target => of_alpha(target).await?,
    };
    drop(grey);
    let colors = premultiplied(image, alpha)?;
    // Pixels that are not seen count most, as their black has no contrast. To fade them by their alpha
    // loses 0.4 dB and 0.0007 of MS-SSIM on white.
    let encoder = Encoder::new(on, &colors, [0; 3], settings.tune.weights(&colors), settings, report)?;
    let target = target.without(alpha_part.bytes - HEADER_BYTES);
    let colors = encoder.encode(target, first.map(FirstLayer::of_colors)).await?;
    Ok(joined(colors, alpha_part, background))
}

/// Both pictures in one.
fn joined(colors: Part, alpha: Part, background: u8) -> Made {
    let psnr = psnr_of_mse(0.75 * mse_of_psnr(colors.psnr) + 0.25 * mse_of_psnr(alpha.psnr));
    let gaussians = colors.gaussians + alpha.gaussians;
    let alpha = Some(Alpha { background, layers: alpha.picture.layers });
    Made { picture: Picture { alpha, ..colors.picture }, gaussians, psnr }
}

/// The alpha of most pixels, where most have one.
fn median(alpha: &[f32]) -> u8 {
    let mut levels: Vec<u8> = alpha.iter().map(|&alpha| to_8_bits(alpha)).collect();
    let middle = levels.len() / 2;
    *levels.select_nth_unstable(middle).1
}
