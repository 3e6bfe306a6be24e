//! The target of the oracle as a backend: completed with what is behind it, and weighted.

use gs_core::{Error, Image, Loss, TargetImage, math::completed};

/// A target with its [`TargetImage::coverage`] and its weights.
pub(crate) struct Target {
    image: Image,
    coverage: Option<Vec<f32>>,
    pub(super) weights: Option<Vec<f32>>,
}

impl Target {
    pub(super) fn new(target: &TargetImage<'_>) -> Self {
        let weights = target.weights.map(<[f32]>::to_vec);
        Self { image: target.image.clone(), coverage: target.coverage(), weights }
    }

    pub(super) fn completed(&self, rendered: &Image, background: [f32; 3]) -> Image {
        let mut image = self.image.clone();
        let pixels = image.pixels_mut().iter_mut().zip(rendered.pixels());
        for ((pixel, rendered), &coverage) in pixels.zip(self.coverage.iter().flatten()) {
            *pixel = std::array::from_fn(|k| completed(pixel[k], coverage, background[k], rendered[k]));
        }
        image
    }

    /// The weighted loss of what was rendered, and its gradient by the image.
    pub(super) fn weighted(&self, weights: &[f32], rendered: &Image, loss: Loss) -> Result<(f64, Image), Error> {
        let effect = "weights under D-SSIM".to_owned();
        let (width, height) = rendered.size();
        let (mut value, count) = (0.0, 3.0 * f64::from(width) * f64::from(height));
        let mut v_image = Image::filled(width, height, [0.0; 3])?;
        let pixels = rendered.pixels().iter().zip(self.image.pixels()).zip(weights);
        for (out, ((c, y), &weight)) in v_image.pixels_mut().iter_mut().zip(pixels) {
            for k in 0..3 {
                let d = f64::from(c[k]) - f64::from(y[k]);
                let (of_channel, slope) = match loss {
                    Loss::L2 => (d * d, 2.0 * d),
                    Loss::L1 => (d.abs(), if d == 0.0 { 0.0 } else { d.signum() }),
                    Loss::L1Dssim { .. } => return Err(Error::Unsupported { backend: "oracle", effect }),
                };
                value += f64::from(weight) * of_channel / count;
                out[k] = (f64::from(weight) * slope / count) as f32;
            }
        }
        Ok((value, v_image))
    }
}
