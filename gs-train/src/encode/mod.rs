//! Encoding images as `.gsi` files.
//!
//! The colours of a transparent image are stored premultiplied, on black, and its alpha as a second
//! picture, in grey.

mod bands;
mod draw;
mod encoder;
mod forecast;
mod layers;
mod progress;
mod sequence;
mod settings;
mod transparent;

use gs_codec::{Picture, profile_bytes};
use gs_core::{Image, Optimizer, Scene2d, TargetImage, to_8_bits};
use gs_io::StoredImage;
use web_time::Instant;

pub(crate) use self::bands::LEAST_FITTED_ROWS;
pub use self::{
    draw::draw_picture,
    progress::{EncodeProgress, EncodeWork},
    settings::{EncodeLayers, EncodeSettings, EncodeTarget},
};
use self::{
    encoder::{Encoder, Part},
    layers::FirstLayer,
    progress::Report,
    transparent::transparent,
};
use crate::{error::Error, fit::mean_color, memory};

/// An image to encode.
#[derive(Debug, Clone, Copy)]
pub struct EncodeImage<'a> {
    /// Colours, not premultiplied.
    pub image: &'a Image,
    /// Alpha of each pixel, `[height · width]`, row-major, 0..=1; `None` where all are 1 in 8 bits.
    pub alpha: Option<&'a [f32]>,
    /// ICC profile of the colours, which the file keeps, at most 65,535 bytes; empty for sRGB.
    pub profile: &'a [u8],
}

impl<'a> From<&'a Image> for EncodeImage<'a> {
    fn from(image: &'a Image) -> Self {
        Self { image, alpha: None, profile: &[] }
    }
}

impl<'a> From<&'a StoredImage> for EncodeImage<'a> {
    fn from(StoredImage { image, alpha, profile, .. }: &'a StoredImage) -> Self {
        let profile = profile.as_ref().map_or(&[][..], |profile| profile.bytes());
        Self { image, alpha: alpha.as_deref(), profile }
    }
}

/// An encoded image.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Encoded {
    /// The `.gsi` file.
    pub bytes: Vec<u8>,
    /// Number of Gaussians, with those of alpha.
    pub gaussians: usize,
    /// PSNR of the decoded 8-bit image, dB; ∞ for equal images. Of a transparent image, that of its
    /// premultiplied colours and its alpha, four channels.
    pub psnr: f64,
    /// Time of encoding, s.
    pub seconds: f64,
}

/// Encodes an image. The target holds for the colours and for alpha; a size holds for both together.
///
/// Calls `observer` with the progress at the beginning of each stage and after each of its steps.
///
/// # Errors
/// [`gs_core::Error::Setting`] for a target or an alpha out of range, for a profile that is too long and
/// for a transparent image that the memory would divide into bands,
/// [`gs_core::Error::Pixel`] where the image is not finite, [`gs_core::Error::Length`] for an alpha of
/// another size, [`Error::Unreachable`] where the target cannot be met, and those of the backend.
pub async fn encode<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    image: impl Into<EncodeImage<'_>>,
    settings: &EncodeSettings,
    observer: &dyn Fn(EncodeProgress),
) -> Result<Encoded, Error> {
    settings.validate()?;
    let EncodeImage { image, alpha, profile } = image.into();
    TargetImage { alpha, ..image.into() }.validate()?;
    let most = usize::from(u16::MAX);
    gs_core::Error::within("the length of the profile", profile.len(), ..=most, "at most 65,535 bytes")?;
    let alpha = alpha.filter(|alpha| alpha.iter().any(|&alpha| to_8_bits(alpha) < u8::MAX));
    if alpha.is_some() {
        check_one_piece(image.size(), settings)?;
    }
    let started = Instant::now();
    let target = settings.target.without(profile_bytes(profile) as u64);
    let report = Report::new(observer);
    let made = match alpha {
        None => opaque(rasterizer, image, target, settings, &report).await,
        Some(alpha) => transparent(rasterizer, image, alpha, target, settings, &report).await,
    };
    let Made { picture, gaussians, psnr } = made.map_err(|error| match error {
        Error::Unreachable { .. } => settings.target.unreachable(),
        error => error,
    })?;
    let bytes = Picture { profile: profile.to_vec(), ..picture }.encode()?;
    Ok(Encoded { bytes, gaussians, psnr, seconds: started.elapsed().as_secs_f64() })
}

/// Fails where a transparent image would be encoded in bands. Few and large Gaussians fill the flat parts
/// of alpha, and those of a band would reach into bands that are done.
fn check_one_piece(size: (u32, u32), settings: &EncodeSettings) -> Result<(), gs_core::Error> {
    let needed = memory::encoding(size, true, &settings.with(|s| s.memory = u64::MAX));
    if settings.memory >= needed {
        return Ok(());
    }
    let found = format!("{} of the {needed} bytes that it takes", settings.memory);
    Err(gs_core::Error::setting("the memory for a transparent image", found, "all of them, as alpha has no bands"))
}

/// A picture as it will be in the file.
struct Made {
    picture: Picture,
    gaussians: usize,
    psnr: f64,
}

async fn opaque<R: Optimizer<Scene2d>>(
    on: &R,
    image: &Image,
    target: EncodeTarget,
    settings: &EncodeSettings,
    report: &Report<'_>,
) -> Result<Made, Error> {
    let background = mean_color(image).map(to_8_bits);
    let encoder = Encoder::new(on, image, background, settings.tune.weights(image), settings, report)?;
    let Part { picture, gaussians, psnr, .. } = encoder.encode(target, FirstLayer::of(settings.layers)).await?;
    Ok(Made { picture, gaussians, psnr })
}
