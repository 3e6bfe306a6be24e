//! Scenes, views and targets for tests: seeded generators, and proptest strategies.

mod scene2d;
mod scene3d;

use gs_core::{
    Error, Image, RenderSettings, Scene2d,
    effects::{Antialias, Blend},
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

pub use self::{
    scene2d::{Kind2d, draws, kinds, scene, views},
    scene3d::{Kind3d, camera, draws_3d, kinds_3d, scene_3d},
};
use crate::{oracle::OracleView, subject::Subject};

/// The inputs of a rendering.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw<S: Subject = Scene2d> {
    /// The kind of the scene.
    pub kind: S::Kind2d,
    /// The Gaussians.
    pub scene: S,
    /// The view.
    pub view: S::View,
    /// Effects, accuracy and background.
    pub settings: RenderSettings,
    /// The seed for [`target`].
    pub target_seed: u64,
}

impl<S: Subject> Draw<S> {
    /// The drawing with another view.
    #[must_use]
    pub fn through(self, view: S::View) -> Self {
        Self { view, ..self }
    }

    /// The drawing with another antialiasing.
    #[must_use]
    pub fn antialiased(mut self, antialias: Antialias) -> Self {
        self.settings.effects.antialias = antialias;
        self
    }

    /// The drawing with a solid background.
    #[must_use]
    pub fn on(self, background: [f32; 3]) -> Self {
        Self { settings: self.settings.on(background), ..self }
    }

    /// A target of the view's size.
    ///
    /// # Errors
    /// [`Error::Size`] for an impossible view.
    pub fn target(&self) -> Result<Image, Error> {
        let (width, height) = self.view.size();
        target(width, height, self.target_seed)
    }
}

/// A photo-like image: soft gradients, a hard edge and a little noise, 0 to 1. Determined by the
/// seed.
///
/// # Errors
/// [`Error::Size`] for an impossible size.
pub fn target(width: u32, height: u32, seed: u64) -> Result<Image, Error> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let phase: f32 = rng.random_range(0.0..6.0);
    Image::from_fn(width, height, |x, y| {
        let (u, v) = ((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        let edge = if u + 0.6 * v > 0.8 { 0.25 } else { 0.0 };
        [0.0f32, 1.0, 2.0].map(|k| {
            let slope = 0.4 + 0.2 * (3.0 * u + 5.0 * v * (1.0 + k) + phase + k).sin();
            slope + edge + rng.random_range(-0.05..0.05)
        })
    })
}

/// Widths and heights from 1 px to these.
fn sizes(columns: u32, rows: u32) -> impl Strategy<Value = (u32, u32)> + Clone {
    (1..=columns, 1..=rows)
}

/// Number of Gaussians in drawn scenes.
fn counts() -> impl Strategy<Value = usize> {
    1_usize..=24
}

/// Both blends.
pub fn blends() -> impl Strategy<Value = Blend> {
    prop_oneof![Just(Blend::Sum), Just(Blend::Over)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_images_of_their_size() {
        let image = target(17, 1, 3).unwrap();
        assert_eq!(image.size(), (17, 1));
        assert!(image.pixels().as_flattened().iter().all(|v| (0.0..=1.0).contains(v)));
        assert!(target(0, 4, 3).is_err());
    }
}
