//! What effects do to a scene's pictures and what they cost, measured on any backend: the proof of what [`Effects::called_for`] decides by
//! bounds, and the price of each effect.

mod prices;
mod proof;

#[cfg(doc)]
use gs_core::Effects;
use gs_core::{Camera, Error, Image, Rasterizer, RenderSettings, Scene};
use pollster::FutureExt as _;
use serde::Serialize;

pub use self::{
    prices::{Price, Prices, prices},
    proof::{Proof, prove},
};

/// How far pictures are from those they stand for, in floats that are neither clamped nor rounded to 8 bits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Difference {
    /// The largest of a channel of a pixel, over all views.
    pub most: f32,
    /// Over all pixels of all views, dB; ∞ where there is none, which JSON writes as `null`.
    pub psnr: f64,
}

/// A scene where a backend computes, and the views that it is looked at through.
#[derive(Debug)]
pub struct Sight<'a, S: Scene, R: Rasterizer<S>> {
    /// What computes.
    pub on: &'a R,
    /// The scene there.
    pub splats: &'a R::Splats,
    /// At least one.
    pub views: &'a [S::View],
}

impl<S: Scene, R: Rasterizer<S>> Sight<'_, S, R> {
    /// How far the pictures with each of these settings are from those with the `wanted`; view by view, so that no more than two pictures are
    /// held, however many views there are.
    ///
    /// # Errors
    /// Those of [`Rasterizer::forward`].
    pub fn differences(&self, wanted: &RenderSettings, others: &[RenderSettings]) -> Result<Vec<Difference>, Error> {
        let mut sums = vec![Sum::default(); others.len()];
        for view in self.views {
            let picture = |settings: &RenderSettings| {
                self.on.image(&self.on.forward(self.splats, view, settings).block_on()?).block_on()
            };
            let expected = picture(wanted)?;
            for (settings, sum) in others.iter().zip(&mut sums) {
                sum.add(&picture(settings)?, &expected);
            }
        }
        Ok(sums.iter().map(Sum::difference).collect())
    }
}

/// A [`Difference`] as far as it is known.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    most: f32,
    squares: f64,
    values: usize,
}

impl Sum {
    /// Adds a view: two pictures of one size.
    fn add(&mut self, image: &Image, expected: &Image) {
        debug_assert_eq!(image.size(), expected.size());
        for (a, b) in image.pixels().as_flattened().iter().zip(expected.pixels().as_flattened()) {
            let difference = (a - b).abs();
            // What is not a number is as far as can be.
            self.most = if difference <= self.most { self.most } else { difference };
            self.squares += f64::from(difference).powi(2);
        }
        self.values += 3 * image.pixels().len();
    }

    fn difference(&self) -> Difference {
        let most = if self.most.is_nan() { f32::INFINITY } else { self.most };
        Difference { most, psnr: -10.0 * (self.squares / self.values.max(1) as f64).log10() }
    }
}

/// Of many views at most so many, evenly spread.
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
