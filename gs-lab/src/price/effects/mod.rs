//! What effects change in a scene's pictures and what they cost in time, measured on any backend.
//! Renderings prove the bounds behind [`Effects::required`], and each effect is timed.

mod prices;
mod proof;
mod training;

use gs_backend::FutureExt as _;
#[cfg(doc)]
use gs_core::Effects;
use gs_core::{Camera, Error, Image, Rasterizer, RenderSettings, Scene, metrics::psnr_of_mse};
use serde::Serialize;

pub use self::{
    prices::{Price, Prices, prices},
    proof::{Proof, prove},
    training::{TrainingEffect, TrainingOutcome, TrainingPrice, training_prices},
};

/// The difference between pictures, without clamping or rounding to 8 bits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Difference {
    /// The largest difference of any channel of any pixel, over all views.
    pub most: f32,
    /// PSNR over all pixels of all views, dB; ∞ without a difference, which JSON writes as `null`.
    pub psnr: f64,
}

/// A scene uploaded to a backend, and views of it.
#[derive(Debug)]
pub struct UploadedScene<'a, S: Scene, R: Rasterizer<S>> {
    /// The backend.
    pub rasterizer: &'a R,
    /// The uploaded scene.
    pub splats: &'a R::Splats,
    /// The views, at least one.
    pub views: &'a [S::View],
}

impl<S: Scene, R: Rasterizer<S>> UploadedScene<'_, S, R> {
    /// The differences between the pictures with `wanted` settings and those with each of the
    /// `others`. Works view by view, so that at most two pictures are in memory.
    ///
    /// # Errors
    /// Those of [`Rasterizer::forward`].
    pub fn differences(&self, wanted: &RenderSettings, others: &[RenderSettings]) -> Result<Vec<Difference>, Error> {
        let mut sums = vec![Sum::default(); others.len()];
        for view in self.views {
            let picture = |settings: &RenderSettings| {
                self.rasterizer.image(&self.rasterizer.forward(self.splats, view, settings).block_on()?).block_on()
            };
            let expected = picture(wanted)?;
            for (settings, sum) in others.iter().zip(&mut sums) {
                sum.add(&picture(settings)?, &expected)?;
            }
        }
        Ok(sums.iter().map(Sum::difference).collect())
    }
}

/// A [`Difference`] that is being accumulated.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    most: f32,
    squares: f64,
    values: usize,
}

impl Sum {
    /// Adds two pictures of a view.
    fn add(&mut self, image: &Image, expected: &Image) -> Result<(), Error> {
        image.same_size(expected)?;
        for (a, b) in image.pixels().as_flattened().iter().zip(expected.pixels().as_flattened()) {
            let difference = (a - b).abs();
            // NaN counts as the largest possible difference.
            self.most = if difference <= self.most { self.most } else { difference };
            self.squares += f64::from(difference).powi(2);
        }
        self.values += 3 * image.pixels().len();
        Ok(())
    }

    fn difference(&self) -> Difference {
        let most = if self.most.is_nan() { f32::INFINITY } else { self.most };
        Difference { most, psnr: psnr_of_mse(self.squares / self.values.max(1) as f64) }
    }
}

/// Selects at most `most` of the cameras, evenly spread.
pub fn sampled(cameras: &[Camera], most: usize) -> Vec<Camera> {
    let count = cameras.len().min(most);
    (0..count).map(|number| cameras[number * cameras.len() / count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_spread_evenly() {
        let camera = |width| Camera::looking_forward(width, 8, 1.0);
        let widths = |most| sampled(&(1..=10).map(camera).collect::<Vec<_>>(), most).iter().map(|c| c.width).collect();
        let [few, all, none]: [Vec<u32>; 3] = [widths(4), widths(99), widths(0)];
        assert_eq!((few, all.len(), none), (vec![1, 3, 6, 8], 10, vec![]));
    }
}
