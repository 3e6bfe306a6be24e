//! The traits that a backend implements: [`Rasterizer`] draws and differentiates scenes of one kind, [`Optimizer`] also trains and edits
//! them.
//!
//! What needs an answer from a device is a future, so that nothing here blocks: a program waits where it chooses to, with any executor.
//! The futures are not `Send`: they are waited for on the thread that made them.
//!
//! Between host and backend there are scenes, images and saved states, when they are asked for. A training step moves no data that
//! grows with the number of Gaussians or pixels.
//!
//! A second backward pass of a forward pass is a type error, because [`Rasterizer::backward`] takes the forward pass by value. A forward
//! pass from before an edit is refused. The gradients of a forward pass from before a step are of no use: they belong to the pixels that
//! were, but go back through the parameters that are.

use std::future::Future;

use crate::{
    adam::{AdamRates, Parameterization},
    edit::EditPlan,
    error::Error,
    image::Image,
    loss::Loss,
    noise::MeanNoise,
    scene::Scene,
    settings::RenderSettings,
    state::SplatsState,
    statistics::{Culled, DensityStatistics},
    target::TargetImage,
};

/// Whether a training step may use the previous step's lists of which Gaussian touches which pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Binning {
    /// Made anew: exact.
    #[default]
    Fresh,
    /// The last ones of these splats, if there are any and no edit came between: pixels that a Gaussian has moved to since are missed,
    /// until the next [`Binning::Fresh`]. Saves the `bin` stage.
    Reuse,
}

/// What one call of [`Optimizer::train_step`] needs besides splats, view and target.
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

/// Which losses [`Optimizer::losses`] hands over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wait {
    /// Those that are known by now; waits for none.
    Arrived,
    /// Those of all steps that were sent; waits for the last of them.
    All,
}

/// Anything that computes, by name.
pub trait Backend {
    /// The backend's name and what it runs on, for reports: "cpu (avx512, 2 threads)".
    fn describe(&self) -> String;
}

/// A backend that draws scenes of kind `S` and differentiates their images.
///
/// [`Self::upload`], [`Self::forward`] and [`Self::image`] are enough to draw; with [`Self::upload_target`], [`Self::backward`] and
/// [`Self::gradients`] a program can optimise a scene with an optimiser of its own. [`Optimizer`] is for backends that train.
pub trait Rasterizer<S: Scene>: Backend {
    /// A scene where this backend computes; backends that train keep Adam's moments and statistics beside the parameters.
    type Splats;
    /// One forward pass and all that its backward pass needs.
    type ForwardPass;
    /// ∂L/∂(every parameter), where this backend computes.
    type Gradients;
    /// An image to compare with, where this backend computes.
    type Target;

    /// Copies a scene to the backend, with fresh moments and statistics.
    ///
    /// # Errors
    /// What [`Scene::validate`] finds; [`Error::Backend`] where memory runs out.
    fn upload(&self, scene: &S, parameterization: Parameterization) -> Result<Self::Splats, Error>;

    /// Stages `project`, `bin`, `sort`, `blend`.
    ///
    /// # Errors
    /// [`Error::Setting`], [`Error::Size`] or [`Error::Unsupported`] where view or settings are not possible.
    fn forward(
        &self,
        splats: &Self::Splats,
        view: &S::View,
        settings: &RenderSettings,
    ) -> impl Future<Output = Result<Self::ForwardPass, Error>>;

    /// The pass's image, `[H, W, 3]`, not clamped.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn image(&self, pass: &Self::ForwardPass) -> impl Future<Output = Result<Image, Error>>;

    /// How many Gaussians the forward pass left out, by cause.
    fn culled(&self, pass: &Self::ForwardPass) -> Culled;

    /// Copies an image to the backend, with the alpha and the mask that it may have.
    ///
    /// # Errors
    /// What [`TargetImage::validate`] finds; [`Error::Backend`] where memory runs out.
    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Self::Target, Error>;

    /// Stages `loss`, `blend_bwd` and `project_bwd`: the loss and its gradients.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where pass and target differ in size.
    fn backward(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        target: &Self::Target,
        loss: &Loss,
    ) -> impl Future<Output = Result<(f32, Self::Gradients), Error>>;

    /// Copies gradients back: with respect to the parameters as the scene has them, whatever the parameterization, as a scene of
    /// derivatives.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn gradients(&self, splats: &Self::Splats, gradients: &Self::Gradients) -> impl Future<Output = Result<S, Error>>;

    /// Copies the parameters back.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn download(&self, splats: &Self::Splats) -> impl Future<Output = Result<S, Error>>;

    /// Number of Gaussians.
    fn len(&self, splats: &Self::Splats) -> usize;

    /// The image of splats, not clamped, and how many Gaussians it leaves out, where no backward pass follows: what [`Self::forward`],
    /// [`Self::image`] and [`Self::culled`] find, to the bit. Backends may need less memory for it.
    ///
    /// # Errors
    /// Those of the three.
    fn draw(
        &self,
        splats: &Self::Splats,
        view: &S::View,
        settings: &RenderSettings,
    ) -> impl Future<Output = Result<(Image, Culled), Error>> {
        async {
            let pass = self.forward(splats, view, settings).await?;
            Ok((self.image(&pass).await?, self.culled(&pass)))
        }
    }

    /// A picture of a scene, nothing else.
    ///
    /// # Errors
    /// Those of [`Self::upload`] and [`Self::draw`].
    fn render(
        &self,
        scene: &S,
        view: &S::View,
        settings: &RenderSettings,
    ) -> impl Future<Output = Result<Image, Error>> {
        async {
            let splats = self.upload(scene, Parameterization::ScaleRotation)?;
            Ok(self.draw(&splats, view, settings).await?.0)
        }
    }
}

/// A backend that trains scenes of kind `S` where it computes.
///
/// A backend may compute later than it is asked to: [`Self::train_step`] sends a step, and [`Self::losses`] reports what came of it.
/// Everything else behaves as if each step had been done when it was sent: whatever looks at splats waits for the steps under way. What a
/// backend cannot foresee when a step is sent, such as a lost device or memory that has run out, is therefore an error of some later call
/// with the same splats; the steps that it prevented are not done then, and have no loss.
pub trait Optimizer<S: Scene>: Rasterizer<S> {
    /// Sends one whole training step, which may still be under way afterwards; its loss comes with [`Self::losses`]. Waits where too many
    /// steps are under way already. Backends may fuse its stages; the result is that of [`Rasterizer::forward`],
    /// [`Rasterizer::backward`] and [`Self::step`], to rounding.
    ///
    /// # Errors
    /// Those of the three, after which this step is not done; also those of steps that were sent before.
    fn train_step(
        &self,
        splats: &mut Self::Splats,
        view: &S::View,
        target: &Self::Target,
        step: &TrainStep<'_>,
    ) -> impl Future<Output = Result<(), Error>>;

    /// Adds to `losses` the loss before each of these splats' training steps since the last call, in their order and each once. Edits
    /// in between make no difference. A backend that computes at once has them all, whatever the `wait`.
    ///
    /// Splats keep four bytes a step until the losses are collected.
    ///
    /// # Errors
    /// [`Error::Backend`] where a step that was sent could not be done; losses that are known by then come with the next call.
    fn losses(
        &self,
        splats: &mut Self::Splats,
        wait: Wait,
        losses: &mut Vec<f32>,
    ) -> impl Future<Output = Result<(), Error>>;

    /// Stage `adam`: moves the splats against the gradients, and adds to its statistics.
    ///
    /// # Errors
    /// [`Error::State`] where gradients and splats differ in length.
    fn step(
        &self,
        splats: &mut Self::Splats,
        gradients: &Self::Gradients,
        rates: &AdamRates,
    ) -> impl Future<Output = Result<(), Error>>;

    /// Statistics since the last edit.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn statistics(&self, splats: &Self::Splats) -> impl Future<Output = Result<DensityStatistics, Error>>;

    /// Applies a plan to parameters, moments and statistics together.
    ///
    /// # Errors
    /// [`Error::Plan`] where the plan contradicts itself or the splats; they are then as before.
    fn edit(&self, splats: &mut Self::Splats, plan: &EditPlan<S::Gaussian>) -> impl Future<Output = Result<(), Error>>;

    /// Adds noise to the means, as [`MeanNoise`] defines it; all else, moments included, stays as it is. Without opacities nothing moves.
    /// Noise is no edit, and may be sent between steps that are still under way.
    ///
    /// # Errors
    /// What [`MeanNoise::validate`] finds; those of a device.
    fn add_noise(&self, splats: &mut Self::Splats, noise: &MeanNoise) -> Result<(), Error>;

    /// Moves the colours of all Gaussians towards the least-squares solution for the target, all else fixed, by `iterations` of
    /// preconditioned conjugate gradients. [`Blend::Sum`](crate::effects::Blend::Sum) only, where the image is linear in them.
    ///
    /// # Errors
    /// [`Error::Unsupported`] under another blending or where the target has an alpha or a mask, and those of [`Rasterizer::forward`].
    fn solve_colors(
        &self,
        splats: &mut Self::Splats,
        view: &S::View,
        target: &Self::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> impl Future<Output = Result<(), Error>>;

    /// The whole state, bit for bit, for a checkpoint.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn save(&self, splats: &Self::Splats) -> impl Future<Output = Result<SplatsState, Error>>;

    /// Splats in exactly the state that was saved.
    ///
    /// # Errors
    /// [`Error::State`] where the state is not one of splats of this kind.
    fn restore(&self, state: &SplatsState) -> Result<Self::Splats, Error>;
}
