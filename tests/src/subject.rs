//! What the suite must know about a kind of scene, so that one case tests backends of either.

use std::fmt::Debug;

use glam::{DQuat, Mat2, Mat3};
use gs_core::{
    Adam, Error, Gaussian2d, MeanNoise, Parameterization, Scene, Scene2d, Scene3d,
    adam::Group,
    covariance_factor::{self, PrincipalAxes},
    effects::Blend,
    whitened,
};

use crate::{
    oracle::{OracleScene, OracleView, PARAMETER_NAMES, Parameters, SPATIAL_SH, rows_of_gradients},
    scenes::{Draw, Kind, Kind3d},
};

/// A kind of scene that the suite can draw and the oracle can render.
pub trait Subject: Scene<View: OracleView + PartialEq> {
    /// What is particular about a drawn scene.
    type Kind: Copy + Debug + PartialEq;

    /// The parameterizations that backends train in. The first they must offer; another may be refused as unsupported.
    const CHARTS: &'static [Parameterization];

    /// Numbers of a mean.
    const DIMENSIONS: usize;

    /// Tensors of a saved state that may be missing: where all are opaque.
    const OPTIONAL_TENSORS: &'static [&'static str];

    /// Whether backends must solve for colours under [`Blend::Sum`].
    const SOLVES_COLORS: bool;

    /// The column of the opacity in the saved moments of splats in this parameterization.
    fn opacity_moment(parameterization: Parameterization) -> usize;

    /// Rates that move drawn scenes by a small part of what they are, and limits of the scales that they are within.
    fn adam() -> Adam;

    /// Fails where a view cannot be looked through.
    ///
    /// # Errors
    /// What gs-core finds.
    fn check_view(view: &Self::View) -> Result<(), Error>;

    /// The scene as the oracle sees it.
    fn rows(&self) -> OracleScene;

    /// The same with the shapes of these frames, as splats in [`Parameterization::CovarianceFactor`] saves them, in `f64`: in `f32`, a shape that is read from a
    /// frame has a needle turned by as much as its aspect times the rounding. A frame without extent along an axis leaves the row as it is; one
    /// that is not finite has scales that are not.
    fn rows_of_factors(&self, frames: &[f32]) -> OracleScene;

    /// A frame as it is beside moments of this parent, both as splats in [`Parameterization::CovarianceFactor`] saves them.
    fn aligned(frame: &[f32], parent: &[f32]) -> Vec<f32>;

    /// The logits of all opacities.
    fn opacity_logits_mut(&mut self) -> &mut [f32];

    /// By how much noise moves the means, `[N, DIMENSIONS]`.
    fn shifts(&self, noise: &MeanNoise) -> Vec<f32>;

    /// No Gaussians of the same kind, SH degree included.
    fn emptied(&self) -> Self;

    /// The Gaussians at some indices, in that order.
    fn picked(&self, indices: impl IntoIterator<Item = usize>) -> Self {
        let mut picked = self.emptied();
        indices.into_iter().for_each(|i| picked.push(self.gaussian(i)));
        picked
    }

    /// The rows of a scene of derivatives.
    fn rows_of_gradients(&self) -> Vec<Parameters>;

    /// What entry `index` of a row is.
    fn parameter_name(index: usize) -> String;

    /// A seeded scene of the usual kind, `size` px.
    fn typical(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self>;

    /// A seeded scene in which many Gaussians are at each pixel.
    fn overlapping(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self>;

    /// The same view at another scale: a larger or smaller picture of the same.
    fn resized(view: &Self::View, size: (u32, u32)) -> Self::View;
}

impl Subject for Scene2d {
    type Kind = Kind;

    const CHARTS: &'static [Parameterization] = &[Parameterization::ScaleRotation, Parameterization::CovarianceFactor];
    const DIMENSIONS: usize = 2;
    const OPTIONAL_TENSORS: &'static [&'static str] = &["opacity_logit"];
    const SOLVES_COLORS: bool = true;

    fn opacity_moment(_: Parameterization) -> usize {
        8
    }

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

    fn rows_of_factors(&self, frames: &[f32]) -> OracleScene {
        let mut rows = self.rows();
        for (row, &[a, b, c, d]) in rows.gaussians.iter_mut().zip(frames.as_chunks().0) {
            let frame = Mat2::from_cols_array(&[a, b, c, d]);
            let PrincipalAxes { axes, scales, .. } = PrincipalAxes::of(Mat3::from_mat2(frame));
            if !frame.is_finite() {
                row[2..4].fill(f64::NAN);
            } else if scales.min_element() > 0.0 {
                // The larger first, as `Gaussian2d::shape_of_factor` has it.
                let (large, small, axis) = if scales.x < scales.y {
                    (scales.y, scales.x, axes.y_axis)
                } else {
                    (scales.x, scales.y, axes.x_axis)
                };
                row[2..5].copy_from_slice(&[large.ln(), small.ln(), axis.y.atan2(axis.x)]);
            }
        }
        rows
    }

    fn aligned(frame: &[f32], parent: &[f32]) -> Vec<f32> {
        let [frame, parent] = [frame, parent].map(Mat2::from_cols_slice);
        whitened::aligned(frame, parent).to_cols_array().to_vec()
    }

    fn rows_of_gradients(&self) -> Vec<Parameters> {
        rows_of_gradients(self)
    }

    fn parameter_name(index: usize) -> String {
        PARAMETER_NAMES[index].to_owned()
    }

    fn typical(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self> {
        Draw::new(Kind::Typical, blend, count, size, seed)
    }

    fn overlapping(blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Draw<Self> {
        Draw::new(Kind::Overlapping, blend, count, size, seed)
    }

    fn resized(view: &Self::View, (width, height): (u32, u32)) -> Self::View {
        view.resized(width, height)
    }
}

impl Subject for Scene3d {
    type Kind = Kind3d;

    const CHARTS: &'static [Parameterization] = &[Parameterization::ScaleRotation, Parameterization::CovarianceFactor];
    const DIMENSIONS: usize = 3;
    const OPTIONAL_TENSORS: &'static [&'static str] = &[];
    const SOLVES_COLORS: bool = false;

    fn opacity_moment(parameterization: Parameterization) -> usize {
        match parameterization {
            Parameterization::ScaleRotation => 10,
            Parameterization::CovarianceFactor => 9,
        }
    }

    fn adam() -> Adam {
        let color_rest = Group::constant(2e-3);
        Adam { mean: Group::constant(0.01), color_rest, min_scale: 1e-6, max_scale: 1e6, ..Adam::default() }
    }

    fn check_view(view: &Self::View) -> Result<(), Error> {
        view.validate()
    }

    fn opacity_logits_mut(&mut self) -> &mut [f32] {
        &mut self.opacity_logits
    }

    fn shifts(&self, noise: &MeanNoise) -> Vec<f32> {
        let shift = |i: usize| {
            let factor = covariance_factor::frame_of(self.log_scales[i], self.rotations[i]).unwrap_or(Mat3::ZERO);
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

    fn rows_of_factors(&self, frames: &[f32]) -> OracleScene {
        let mut rows = self.rows();
        for (row, frame) in rows.gaussians.iter_mut().zip(frames.as_chunks::<9>().0) {
            let frame = Mat3::from_cols_array(frame);
            let PrincipalAxes { axes, scales, .. } = PrincipalAxes::of(frame);
            if !frame.is_finite() {
                row[3..6].fill(f64::NAN);
            } else if scales.min_element() > 0.0 {
                let q = DQuat::from_mat3(&axes);
                row[3..6].copy_from_slice(&scales.map(f64::ln).to_array());
                row[6..10].copy_from_slice(&[q.w, q.x, q.y, q.z]);
            }
        }
        rows
    }

    fn aligned(frame: &[f32], parent: &[f32]) -> Vec<f32> {
        let [frame, parent] = [frame, parent].map(Mat3::from_cols_slice);
        covariance_factor::aligned(frame, parent).to_cols_array().to_vec()
    }

    fn rows_of_gradients(&self) -> Vec<Parameters> {
        self.rows().gaussians
    }

    fn parameter_name(index: usize) -> String {
        const NAMES: [&str; SPATIAL_SH] = [
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
        match index.checked_sub(SPATIAL_SH) {
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
