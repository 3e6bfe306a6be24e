//! The trait that a backend implements: rasterise, differentiate, optimise and edit the Gaussians of one kind of scene.
//!
//! Only [`Rasterizer::upload`], [`Rasterizer::download`], images and the state cross between host and backend; a training step
//! moves no data that grows with the number of Gaussians. A stale frame or a second backward pass is a type error, because
//! [`Rasterizer::backward`] takes the frame by value.

use crate::{
    adam::{AdamRates, Chart},
    edit::EditPlan,
    error::Error,
    image::Image,
    loss::Loss,
    scene::Scene,
    settings::RenderSettings,
    state::CloudState,
    statistics::{Culled, DensityStatistics},
};

/// Whether a training step may use the previous step's lists of which Gaussian touches which pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Binning {
    /// Made anew: exact.
    #[default]
    Fresh,
    /// The last ones of this cloud, if there are any and no edit came between: pixels that a Gaussian has moved to since are missed,
    /// until the next [`Binning::Fresh`]. Saves the `bin` stage.
    Reuse,
}

/// What one call of [`Rasterizer::train_step`] needs besides cloud, view and target.
#[derive(Debug, Clone, Copy)]
pub struct TrainStep<'a> {
    /// Effects and accuracy.
    pub settings: &'a RenderSettings,
    /// What is minimised.
    pub loss: Loss,
    /// Adam's numbers at this step.
    pub rates: &'a AdamRates,
    /// Fresh or reused lists.
    pub binning: Binning,
}

/// A backend for scenes of kind `S`.
pub trait Rasterizer<S: Scene> {
    /// Parameters, Adam moments and statistics, where this backend computes.
    type Cloud;
    /// One forward pass and all that its backward pass needs.
    type Frame;
    /// ∂L/∂(every parameter), where this backend computes.
    type Gradients;
    /// An image to compare with, where this backend computes.
    type Target;

    /// The backend's name and what it runs on, for reports: "cpu (avx512, 2 threads)".
    fn describe(&self) -> String;

    /// Copies a scene to the backend, with fresh moments and statistics.
    ///
    /// # Errors
    /// What [`Scene::validate`] finds; [`Error::Backend`] where memory runs out.
    fn upload(&self, scene: &S, chart: Chart) -> Result<Self::Cloud, Error>;

    /// Copies the parameters back.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn download(&self, cloud: &Self::Cloud) -> Result<S, Error>;

    /// Number of Gaussians, without crossing to the device.
    fn len(&self, cloud: &Self::Cloud) -> usize;

    /// Copies an image to the backend.
    ///
    /// # Errors
    /// [`Error::Backend`] where memory runs out.
    fn upload_target(&self, image: &Image) -> Result<Self::Target, Error>;

    /// The whole state, bit for bit, for a checkpoint.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn save(&self, cloud: &Self::Cloud) -> Result<CloudState, Error>;

    /// A cloud in exactly the state that was saved.
    ///
    /// # Errors
    /// [`Error::State`] where the state is not one of a cloud of this kind.
    fn restore(&self, state: &CloudState) -> Result<Self::Cloud, Error>;

    /// Stages `project`, `bin`, `sort`, `blend`.
    ///
    /// # Errors
    /// [`Error::Setting`], [`Error::Size`] or [`Error::Unsupported`] where view or settings are not possible.
    fn forward(&self, cloud: &Self::Cloud, view: &S::View, settings: &RenderSettings) -> Result<Self::Frame, Error>;

    /// The frame's image, `[H, W, 3]`, not clamped.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn image(&self, frame: &Self::Frame) -> Result<Image, Error>;

    /// How many Gaussians the frame left out, by cause.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn culled(&self, frame: &Self::Frame) -> Result<Culled, Error>;

    /// Stages `loss`, `blend_bwd` and `project_bwd`: the loss and its gradients.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where frame and target differ in size.
    fn backward(
        &self,
        cloud: &Self::Cloud,
        frame: Self::Frame,
        target: &Self::Target,
        loss: &Loss,
    ) -> Result<(f32, Self::Gradients), Error>;

    /// The gradients with respect to the parameters as the scene has them, whatever the chart; a scene of derivatives.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn download_gradients(&self, cloud: &Self::Cloud, gradients: &Self::Gradients) -> Result<S, Error>;

    /// Stage `adam`: moves the cloud against the gradients, and adds to its statistics.
    ///
    /// # Errors
    /// [`Error::State`] where gradients and cloud differ in length.
    fn step(&self, cloud: &mut Self::Cloud, gradients: &Self::Gradients, rates: &AdamRates) -> Result<(), Error>;

    /// One whole training step; returns the loss before it. Backends may fuse its stages; the result is that of
    /// [`Self::forward`], [`Self::backward`] and [`Self::step`], to rounding.
    ///
    /// # Errors
    /// Those of the three.
    fn train_step(
        &self,
        cloud: &mut Self::Cloud,
        view: &S::View,
        target: &Self::Target,
        step: &TrainStep<'_>,
    ) -> Result<f32, Error> {
        let frame = self.forward(cloud, view, step.settings)?;
        let (loss, gradients) = self.backward(cloud, frame, target, &step.loss)?;
        self.step(cloud, &gradients, step.rates)?;
        Ok(loss)
    }

    /// Moves the colours of all Gaussians towards the least-squares solution for the target, all else fixed, by `iterations` of
    /// preconditioned conjugate gradients. [`Blend::Sum`](crate::effects::Blend::Sum) only, where the image is linear in them.
    ///
    /// # Errors
    /// [`Error::Unsupported`] under another blending, and those of [`Self::forward`].
    fn solve_colors(
        &self,
        cloud: &mut Self::Cloud,
        view: &S::View,
        target: &Self::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error>;

    /// Statistics since the last edit.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn statistics(&self, cloud: &Self::Cloud) -> Result<DensityStatistics, Error>;

    /// Applies a plan to parameters, moments and statistics together.
    ///
    /// # Errors
    /// [`Error::Plan`] where the plan contradicts itself or the cloud; the cloud is then as before.
    fn edit(&self, cloud: &mut Self::Cloud, plan: &EditPlan<S::Gaussian>) -> Result<(), Error>;

    /// A picture of a scene, nothing else.
    ///
    /// # Errors
    /// Those of [`Self::upload`] and [`Self::forward`].
    fn render(&self, scene: &S, view: &S::View, settings: &RenderSettings) -> Result<Image, Error> {
        let cloud = self.upload(scene, Chart::ScaleRotation)?;
        self.image(&self.forward(&cloud, view, settings)?)
    }
}
