//! The files of all images in all formats, with their sizes, qualities and times.

use std::{error::Error, fmt::Write as _, hint::black_box, time::Instant};

use gs_codec::Extent;
use gs_core::{Canvas, Image, Rasterizer as _, profile::Quantiles};
use gs_cpu::CpuRasterizer;
use gs_io::decode_gsi;
use gs_train::{EncodeSettings, EncodeTarget, ImageQuality, Tune, encode};
use pollster::FutureExt as _;
use ssimulacra2::{ColorPrimaries, Rgb, TransferCharacteristic, compute_frame_ssimulacra2};

use crate::{
    codec::{CODECS, Original},
    curve::{RateCurve, ms_ssim_decibels},
    images::BenchImage,
};

/// Names of our format, tuned for PSNR and for SSIM.
pub(crate) const OURS: &str = "gsi";
pub(crate) const TUNED: &str = "gsi --tune ssim";

/// A file of an image.
pub(crate) struct Point {
    pub(crate) image: String,
    pub(crate) format: &'static str,
    /// Size, bits per pixel.
    pub(crate) bpp: f64,
    pub(crate) quality: ImageQuality,
    pub(crate) ssimulacra2: f64,
    pub(crate) own: Option<Own>,
}

/// What is known of our files only.
pub(crate) struct Own {
    pub(crate) bytes: Vec<u8>,
    /// Times of encoding, of decoding to Gaussians, and of decoding and rendering, s.
    pub(crate) seconds: [f64; 3],
}

/// A measure of quality.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measure {
    Psnr,
    /// In dB: see [`ms_ssim_decibels`].
    MsSsim,
    Ssimulacra2,
}

impl Measure {
    pub(crate) const ALL: [Self; 3] = [Self::Psnr, Self::MsSsim, Self::Ssimulacra2];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Psnr => "PSNR",
            Self::MsSsim => "MS-SSIM",
            Self::Ssimulacra2 => "SSIMULACRA2",
        }
    }

    fn of(self, point: &Point) -> f64 {
        match self {
            Self::Psnr => point.quality.psnr,
            Self::MsSsim => point.quality.ms_ssim.map_or(f64::NAN, ms_ssim_decibels),
            Self::Ssimulacra2 => point.ssimulacra2,
        }
    }
}

/// All files.
#[derive(Default)]
pub(crate) struct Points(pub(crate) Vec<Point>);

impl Points {
    /// Adds a file of our format, [`OURS`] or [`TUNED`].
    pub(crate) fn add_gsi(
        &mut self,
        rasterizer: &CpuRasterizer,
        of: &BenchImage,
        format: &'static str,
        bpp: f64,
    ) -> Result<(), Box<dyn Error>> {
        let pixels = of.image.pixels().len() as f64;
        let settings = EncodeSettings::default().with(|s| {
            s.target = EncodeTarget::Bytes((bpp * pixels / 8.0) as u64);
            s.tune = if format == TUNED { Tune::Ssim } else { Tune::Psnr };
        });
        let encoded = encode(rasterizer, &of.image, &settings, &|_| ()).block_on()?;
        let median = |times: Vec<f64>| Quantiles::of(&times).median;
        let decoding = median(try_time(5, || decode_gsi(&encoded.bytes, Extent::Whole))?);
        let to_pixels = median(try_time(5, || rendered(rasterizer, &encoded.bytes, Extent::Whole))?);
        let picture = rendered(rasterizer, &encoded.bytes, Extent::Whole)?;
        let own = Own { seconds: [encoded.seconds, decoding, to_pixels], bytes: encoded.bytes };
        let bpp = own.bytes.len() as f64 * 8.0 / pixels;
        self.0.push(point(of, format, bpp, &picture, Some(own))?);
        Ok(())
    }

    /// Adds the files of the other formats.
    pub(crate) fn add_others(&mut self, of: &BenchImage, is_quick: bool) -> Result<(), Box<dyn Error>> {
        let original = Original::new(&of.image)?;
        for codec in CODECS.iter().filter(|codec| codec.is_there()) {
            let levels: Vec<u32> = codec.levels.iter().copied().step_by(if is_quick { 3 } else { 1 }).collect();
            for file in codec.files(&original, &levels)? {
                let bpp = file.bytes as f64 * 8.0 / of.image.pixels().len() as f64;
                self.0.push(point(of, codec.name, bpp, &file.picture, None)?);
            }
        }
        Ok(())
    }

    /// The files of an image in a format, the smallest first.
    pub(crate) fn of(&self, image: &str, format: &str) -> Vec<&Point> {
        let mut of: Vec<&Point> = self.0.iter().filter(|p| p.image == image && p.format == format).collect();
        of.sort_by(|a, b| a.bpp.total_cmp(&b.bpp));
        of
    }

    /// The curve through the files of an image in a format.
    pub(crate) fn curve(&self, image: &str, format: &str, measure: Measure) -> Option<RateCurve> {
        RateCurve::new(self.of(image, format).into_iter().map(|point| (point.bpp, measure.of(point))))
    }

    /// A line per file.
    pub(crate) fn to_csv(&self) -> String {
        let mut csv = "image,format,bpp,psnr,ssim,ms_ssim,ssimulacra2,encoding_s,decoding_s,to_pixels_s\n".to_owned();
        for Point { image, format, bpp, quality, ssimulacra2, own } in &self.0 {
            let ms_ssim = quality.ms_ssim.map_or_else(String::new, |value| format!("{value:.5}"));
            let times = own
                .as_ref()
                .map_or_else(|| ",,".to_owned(), |own| own.seconds.map(|seconds| format!("{seconds:.5}")).join(","));
            let ImageQuality { psnr, ssim, .. } = quality;
            writeln!(csv, "{image},{format},{bpp:.5},{psnr:.4},{ssim:.5},{ms_ssim},{ssimulacra2:.3},{times}")
                .expect("a string takes all that is written to it");
        }
        csv
    }
}

/// The picture of a file, not rounded.
pub(crate) fn rendered(rasterizer: &CpuRasterizer, bytes: &[u8], extent: Extent) -> Result<Image, Box<dyn Error>> {
    let file = decode_gsi(bytes, extent)?.colors;
    let canvas = Canvas::new(file.width, file.height);
    Ok(rasterizer.render(&file.scene, &canvas, &file.settings).block_on()?)
}

fn point(
    of: &BenchImage,
    format: &'static str,
    bpp: f64,
    picture: &Image,
    own: Option<Own>,
) -> Result<Point, Box<dyn Error>> {
    let quality = ImageQuality::as_written(picture, &of.image)?;
    let ssimulacra2 = compute_frame_ssimulacra2(rgb(&of.image)?, rgb(&picture.rounded_to_8_bits())?)?;
    Ok(Point { image: of.name.clone(), format, bpp, quality, ssimulacra2, own })
}

fn rgb(image: &Image) -> Result<Rgb, Box<dyn Error>> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let (curve, primaries) = (TransferCharacteristic::SRGB, ColorPrimaries::BT709);
    Ok(Rgb::new(image.pixels().to_vec(), width, height, curve, primaries)?)
}

/// Seconds of each of `repetitions` runs that can fail.
fn try_time<T, E>(repetitions: usize, mut run: impl FnMut() -> Result<T, E>) -> Result<Vec<f64>, E> {
    let mut seconds = Vec::with_capacity(repetitions);
    for _ in 0..repetitions {
        let start = Instant::now();
        black_box(run()?);
        seconds.push(start.elapsed().as_secs_f64());
    }
    Ok(seconds)
}
