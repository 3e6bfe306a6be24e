//! The interface of 2D and 3D scenes for the suite, so that one case can test both.

use std::fmt::Debug;

use glam::{DMat2, Mat2, Mat3};
use gs_core::{
    Adam, Error, Gaussian2d, MeanNoise, Parameterization, Scene, Scene2d, Scene3d, adam::Group, effects::Blend,
    math::whitened,
};

use crate::{
    oracle::{OPACITY, OracleScene, OracleView, PARAMETER_NAMES, Parameters, SH_3D},
    scenes::{Draw, Kind2d, Kind3d},
};

/// A kind of scene that the suite can draw and the oracle can render.
pub trait Subject: Scene<View: OracleView + Copy + PartialEq> {
    /// The kinds of generated scenes.
    type Kind2d: Copy + Debug + PartialEq;

    /// The parameterizations. Backends must offer the first, and may refuse others as unsupported.
    const PARAMETERIZATIONS: &'static [Parameterization];

    /// Numbers per mean.
    const DIMENSIONS: usize;

    /// Tensors that a saved state does not have if all Gaussians are opaque.
    const OPTIONAL_TENSORS: &'static [&'static str];

    /// Whether backends must solve for colours under [`Blend::Sum`].
    const SOLVES_COLORS: bool;

    /// The column of the opacity in the saved moments.
    const OPACITY_MOMENT: usize;

    /// Rates that move generated scenes by little, with limits that include their scales.
    fn adam() -> Adam;

    /// Fails for an invalid view.
    ///
    /// # Errors
    /// The error of gs-core's check.
    fn check_view(view: &Self::View) -> Result<(), Error>;

    /// The scene in the oracle's form.
    fn rows(&self) -> OracleScene;

    /// The scene in the oracle's form with the shapes of these factors, as saved in
    /// [`Parameterization::CovarianceFactor`].
    ///
    /// Computed in `f64`: in `f32`, the rotation of a needle is off by its aspect times the
    /// rounding. A factor without extent along an axis leaves the row unchanged. One that is not
    /// finite yields scales that are not finite. Used for kinds of scenes with this
    /// parameterization only.
    fn rows_of_factors(&self, _: &[f32]) -> OracleScene {
        self.rows()
    }

    /// The factor that matches a parent's moments, in the form of
    /// [`Parameterization::CovarianceFactor`].
    fn aligned(factor: &[f32], _: &[f32]) -> Vec<f32> {
        factor.to_vec()
    }

    /// The opacity logits.
    fn opacity_logits_mut(&mut self) -> &mut [f32];

    /// The shifts of the means by noise, `[N, DIMENSIONS]`.
    fn shifts(&self, noise: &MeanNoise) -> Vec<f32>;

    /// An empty scene with the same SH degree.
    fn emptied(&self) -> Self;

    /// The Gaussians at these indices, in this order.
    fn picked(&self, indices: impl IntoIterator<Item = usize>) -> Self {
        let mut picked = self.emptied();
        indices.into_iter().for_each(|i| picked.push(self.gaussian(i)));
        picked
    }

    /// The rows of a scene of derivatives. A missing opacity gradient is 0.
    fn rows_of_gradients(&self) -> Vec<Parameters>;

    /// The name of entry `index` of a row.
    fn parameter_name(index: usize) -> String;

    /// A seeded typical scene, `size` px.
    fn typical(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self>;

    /// A seeded scene with many Gaussians at each pixel.
    fn overlapping(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self>;

    /// Returns this view at another resolution.
    fn resized(view: &Self::View, size: (u32, u32)) -> Self::View;
}

impl Subject for Scene2d {
    type Kind2d = Kind2d;

    const PARAMETERIZATIONS: &'static [Parameterization] =
        &[Parameterization::ScaleRotation, Parameterization::CovarianceFactor];
    const DIMENSIONS: usize = 2;
    const OPACITY_MOMENT: usize = 8;
    const OPTIONAL_TENSORS: &'static [&'static str] = &["opacity_logit"];
    const SOLVES_COLORS: bool = true;

    fn adam() -> Adam {
        Adam::default()
    }

    fn check_view(view: &Self::View) -> Result<(), Error> {
        view.validate()
    }

    fn opacity_logits_mut(&mut self) -> &mut [f32] {
        &mut self.opacity_logits
    }

    fn shifts(&self, noise: &MeanNoise) -> Vec<f32> {
        let shift = |(i, g): (usize, Gaussian2d)| noise.shift_2d(i as u32, g.factor(), g.opacity_logit).to_array();
        self.iter().enumerate().flat_map(shift).collect()
    }

    fn emptied(&self) -> Self {
        Self::default()
    }

    fn rows(&self) -> OracleScene {
        OracleScene::from(self)
    }

    fn rows_of_factors(&self, factors: &[f32]) -> OracleScene {
        let mut rows = self.rows();
        for (row, &[a, b, c, d]) in rows.gaussians.iter_mut().zip(factors.as_chunks().0) {
            let factor = DMat2::from_cols_array(&[a, b, c, d].map(f64::from));
            let [xx, xy, _, yy] = (factor * factor.transpose()).to_cols_array();
            // The larger scale first, as in `Gaussian2d::shape_of_factor`.
            let large = (0.5 * (xx + yy + (xx - yy).hypot(2.0 * xy))).sqrt();
            let small = factor.determinant().abs() / large;
            if !factor.is_finite() {
                row[2..4].fill(f64::NAN);
            } else if small > 0.0 {
                row[2..5].copy_from_slice(&[large.ln(), small.ln(), 0.5 * (2.0 * xy).atan2(xx - yy)]);
            }
        }
        rows
    }

    fn aligned(factor: &[f32], parent: &[f32]) -> Vec<f32> {
        let [factor, parent] = [factor, parent].map(Mat2::from_cols_slice);
        whitened::aligned(factor, parent).to_cols_array().to_vec()
    }

    fn rows_of_gradients(&self) -> Vec<Parameters> {
        let mut rows = OracleScene::from(self).gaussians;
        if !self.has_opacity() {
            rows.iter_mut().for_each(|row| row[OPACITY] = 0.0);
        }
        rows
    }

    fn parameter_name(index: usize) -> String {
        PARAMETER_NAMES[index].to_owned()
    }

    fn typical(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self> {
        Draw::new(Kind2d::Typical, blend, count, size, seed)
    }

    fn overlapping(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self> {
        Draw::new(Kind2d::Overlapping, blend, count, size, seed)
    }

    fn resized(view: &Self::View, (width, height): (u32, u32)) -> Self::View {
        view.resized(width, height)
    }
}

impl Subject for Scene3d {
    type Kind2d = Kind3d;

    const PARAMETERIZATIONS: &'static [Parameterization] = &[Parameterization::ScaleRotation];
    const DIMENSIONS: usize = 3;
    const OPACITY_MOMENT: usize = 10;
    const OPTIONAL_TENSORS: &'static [&'static str] = &[];
    const SOLVES_COLORS: bool = false;

    fn adam() -> Adam {
        let color_rest = Group::constant(2e-3);
        Adam::default().with(|s| {
            s.mean = Group::constant(0.01);
            s.color_rest = color_rest;
            s.min_scale = 1e-6;
            s.max_scale = 1e6;
        })
    }

    fn check_view(view: &Self::View) -> Result<(), Error> {
        view.validate()
    }

    fn opacity_logits_mut(&mut self) -> &mut [f32] {
        &mut self.opacity_logits
    }

    fn shifts(&self, noise: &MeanNoise) -> Vec<f32> {
        let shift = |i: usize| {
            let factor = self.gaussian(i).factor().unwrap_or(Mat3::ZERO);
            noise.shift_3d(i as u32, factor, self.opacity_logits[i]).to_array()
        };
        (0..self.len()).flat_map(shift).collect()
    }

    fn emptied(&self) -> Self {
        Self { sh_degree: self.sh_degree, ..Self::default() }
    }

    fn rows(&self) -> OracleScene {
        OracleScene::from(self)
    }

    fn rows_of_gradients(&self) -> Vec<Parameters> {
        self.rows().gaussians
    }

    fn parameter_name(index: usize) -> String {
        const NAMES: [&str; SH_3D] = [
            "mean x",
            "mean y",
            "mean z",
            "ln-scale 1",
            "ln-scale 2",
            "ln-scale 3",
            "quaternion w",
            "quaternion x",
            "quaternion y",
            "quaternion z",
            "opacity logit",
        ];
        match index.checked_sub(SH_3D) {
            None => NAMES[index].to_owned(),
            Some(color) => format!("SH coefficient {}, {}", color / 3, ["red", "green", "blue"][color % 3]),
        }
    }

    fn typical(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self> {
        Draw::for_3d(Kind3d::Typical, blend, count, size, seed)
    }

    fn overlapping(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self> {
        Draw::for_3d(Kind3d::Overlapping, blend, count, size, seed)
    }

    fn resized(view: &Self::View, (width, height): (u32, u32)) -> Self::View {
        let zoom = glam::Vec2::new(width as f32 / view.width as f32, height as f32 / view.height as f32);
        Self::View { focal: view.focal * zoom, center: view.center * zoom, width, height, ..*view }
    }
}
