//! The number of Gaussians that a fit takes for a quality.

use gs_core::{Image, Optimizer, Scene2d};

use super::settings::EncodeTarget;
use crate::{
    error::Error,
    fit::{FitSettings, Forecast, Preset, fit},
};

/// Fits of the settings at most.
const TRIALS: usize = 6;

/// Surplus of PSNR that is small enough, dB.
const SURPLUS_DB: f64 = 0.04;

/// Ratio of two numbers of Gaussians that are as good as equal.
const CLOSE: f64 = 1.01;

/// The smallest number of Gaussians, within about 1 %, with which a fit of `settings` has this PSNR as
/// an 8-bit picture, dB.
///
/// Quick fits forecast the number, and fits of the settings correct it: two or three of them as a rule,
/// six at most. The same fit of the number that is returned reaches the PSNR.
///
/// # Errors
/// [`gs_core::Error::Setting`] for a PSNR outside 10 to 60 dB; [`Error::Unreachable`] where no number
/// up to one for each pixel reaches it; those of [`fit()`].
pub async fn count_for_psnr<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    image: &Image,
    psnr: f64,
    settings: impl Fn(u32) -> FitSettings,
) -> Result<u32, Error> {
    EncodeTarget::Psnr(psnr).validate()?;
    let mut count = forecast(rasterizer, image, psnr, &settings).await?;
    let mut known = Forecast::new(image);
    let most = known.most() as u32;
    let (mut short, mut enough): (u32, Option<u32>) = (0, None);
    for _ in 0..TRIALS {
        let found = fit(rasterizer, image, settings(count), &mut ()).await?.summary.psnr;
        known.add(count, found);
        if found >= psnr {
            enough = Some(enough.map_or(count, |known| known.min(count)));
        } else {
            short = short.max(count);
        }
        let is_close = enough.is_some_and(|enough| f64::from(enough) <= CLOSE * f64::from(short) + 1.0);
        if is_close || found >= psnr && found < psnr + SURPLUS_DB || short >= most {
            break;
        }
        // A little more, as the next fit may be worse than the curve through the others.
        let aim = known.count_where(psnr + 0.5 * SURPLUS_DB, |count| known.psnr(count));
        let (least, largest) = (short + 1, enough.map_or(most, |enough| enough.saturating_sub(1)));
        if least > largest {
            break;
        }
        count = aim.clamp(least, largest);
    }
    enough.ok_or_else(|| Error::Unreachable { target: format!("a PSNR of {psnr} dB by these settings") })
}

/// The number by quick fits, in the rendering of the settings.
async fn forecast<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    image: &Image,
    psnr: f64,
    settings: &impl Fn(u32) -> FitSettings,
) -> Result<u32, Error> {
    let mut forecast = Forecast::new(image);
    let mut count = (forecast.most() / 130.0).max(1.0) as u32;
    for _ in 0..2 {
        let wanted = settings(count);
        let mut quick = Preset::Quick.settings(count, image.size());
        (quick.tune, quick.seed) = (wanted.tune, wanted.seed);
        if quick.render.effects.blend == wanted.render.effects.blend {
            quick.render = wanted.render;
        }
        let found = fit(rasterizer, image, quick, &mut ()).await?.summary.psnr;
        forecast.add_quick(count, found);
        count = forecast.count_where(psnr, |count| forecast.psnr(count)).max(1);
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use gs_cpu::{CpuRasterizer, CpuSettings};
    use pollster::FutureExt as _;

    use super::*;

    #[test]
    fn the_number_reaches_the_psnr_and_a_few_less_do_not() {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let wave = |x: u32, y: u32| ((x * x + 3 * y) as f32 * 0.02).sin() * 0.3 + 0.5;
        let image = Image::from_fn(48, 40, |x, y| [wave(x, y), y as f32 / 40.0, wave(y, x)]).unwrap();
        let settings = |count| FitSettings::standard(count).with_iterations(100);
        let psnr = |count| fit(&cpu, &image, settings(count), &mut ()).block_on().unwrap().summary.psnr;
        let count = count_for_psnr(&cpu, &image, 30.0, settings).block_on().unwrap();
        let (found, fewer) = (psnr(count), psnr(count * 9 / 10));
        assert!((30.0..33.0).contains(&found) && fewer < 30.1, "{count}: {found} dB, {fewer} dB with a tenth less");
        let impossible = count_for_psnr(&cpu, &image, 5.0, settings).block_on().unwrap_err();
        assert!(impossible.to_string().contains("10 to 60 dB"), "{impossible}");
    }

    #[test]
    fn what_no_number_reaches_is_an_error() {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let noise = |x: u32, y: u32, k: u32| ((x * 7919 + y * 104_729 + k * 1299) % 251) as f32 / 250.0;
        let image = Image::from_fn(12, 10, |x, y| [0, 1, 2].map(|k| noise(x, y, k))).unwrap();
        let settings = |count| FitSettings::standard(count).with_iterations(2);
        let refused = count_for_psnr(&cpu, &image, 60.0, settings).block_on().unwrap_err();
        assert!(refused.to_string().contains("a PSNR of 60 dB"), "{refused}");
    }
}
