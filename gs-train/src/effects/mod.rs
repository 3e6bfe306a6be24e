//! What effects do to a scene's pictures and what they cost, measured on any backend: the proof of what [`Effects::called_for`] decides by
//! bounds, and the price of each effect.

mod prices;
mod proof;

#[cfg(doc)]
use gs_core::Effects;
use gs_core::{Camera, Error, Image, Rasterizer, RenderSettings, Scene};
use serde::Serialize;

pub use self::{
    prices::{Price, Prices, prices},
    proof::{Proof, prove},
};

/// How far pictures are from those they stand for, neither clamped.
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
    pub cloud: &'a R::Cloud,
    /// At least one.
    pub views: &'a [S::View],
}

impl<S: Scene, R: Rasterizer<S>> Sight<'_, S, R> {
    /// Its pictures.
    ///
    /// # Errors
    /// Those of [`Rasterizer::forward`].
    pub fn pictures(&self, settings: &RenderSettings) -> Result<Vec<Image>, Error> {
        self.views.iter().map(|view| self.on.image(&self.on.forward(self.cloud, view, settings)?)).collect()
    }

    /// How far the pictures with these settings are from others, one of each view.
    ///
    /// # Errors
    /// Those of [`Rasterizer::forward`], and [`Error::SizesDiffer`].
    pub fn difference(&self, settings: &RenderSettings, pictures: &[Image]) -> Result<Difference, Error> {
        let (mut most, mut squares, mut values) = (0.0f32, 0.0f64, 0usize);
        for (view, picture) in self.views.iter().zip(pictures) {
            let image = self.on.image(&self.on.forward(self.cloud, view, settings)?)?;
            image.same_size(picture)?;
            for (a, b) in image.pixels().as_flattened().iter().zip(picture.pixels().as_flattened()) {
                let difference = (a - b).abs();
                // What is not a number is as far as can be.
                most = if difference <= most { most } else { difference };
                squares += f64::from(difference).powi(2);
            }
            values += 3 * image.pixels().len();
        }
        let most = if most.is_nan() { f32::INFINITY } else { most };
        Ok(Difference { most, psnr: -10.0 * (squares / values.max(1) as f64).log10() })
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
