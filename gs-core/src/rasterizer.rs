//! The traits that a backend implements: [`Rasterizer`] draws and differentiates scenes of one
//! kind, [`Optimizer`] also trains and edits them.
//!
//! Calls that need an answer from a device return a future, so that nothing here blocks: a program
//! waits where it chooses to, with any executor. The futures are not `Send`: await them on the
//! thread that made them.
//!
//! Only scenes, images and saved states move between host and backend, on request. A training step
//! moves no data that grows with the number of Gaussians or pixels.
//!
//! A second backward pass of a forward pass is a type error, because [`Rasterizer::backward`] and
//! [`Rasterizer::image_vjp`] take the forward pass by value. A forward pass from before an edit is
//! refused. After a step, the gradients of an earlier forward pass are meaningless: they belong to
//! the old pixels, but go back through the new parameters.

use std::future::Future;

use crate::{
    adam::{AdamRates, Parameterization},
    edit::EditPlan,
    error::Error,
    image::{Image, TargetImage},
    scene::Scene,
    settings::RenderSettings,
    state::{SavedState, SplatsState},
    training::{Culled, DensityStatistics, Loss, MeanNoise},
    view::CameraGradient,
};

/// Gives a rasterizer of both kinds of scenes the methods `for_2d` and `for_3d`.
///
/// The type must be defined in the calling crate, and implement [`Profiler`](crate::profile::Profiler) for
/// [`Scene2d`](crate::Scene2d) and [`Scene3d`](crate::Scene3d).
#[macro_export]
macro_rules! impl_for_kinds {
    ($rasterizer:ty) => {
        impl $rasterizer {
            $crate::impl_for_kinds! { for_2d, $crate::Scene2d, "2D" }
            $crate::impl_for_kinds! { for_3d, $crate::Scene3d, "3D" }
        }
    };
    ($name:ident, $scene:ty, $kind:literal) => {
        #[doc = concat!("Returns this rasterizer for ", $kind, " scenes only.")]
        ///
        /// Use it where the types of the arguments do not determine the kind of scene.
        pub fn $name(
            &self,
        ) -> &impl $crate::profile::Profiler<
            $scene,
            Splats = <Self as $crate::Rasterizer<$scene>>::Splats,
            ForwardPass = <Self as $crate::Rasterizer<$scene>>::ForwardPass,
            Gradients = <Self as $crate::Rasterizer<$scene>>::Gradients,
            Target = <Self as $crate::Rasterizer<$scene>>::Target,
        > {
            self
        }
    };
}

/// Whether a training step may reuse the previous step's lists of which Gaussian touches which
/// pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Binning {
    /// Makes new lists: exact.
    #[default]
    Fresh,
    /// Reuses the last lists of these splats, if there are any and no edit came between. Saves the
    /// `bin` stage.
    ///
    /// Pixels that a Gaussian has moved to since are missed until the next [`Binning::Fresh`].
    Reuse,
}

/// Arguments of [`Optimizer::train_step`] besides splats, view and target. Exhaustive: a backend
/// must handle each field.
#[derive(Debug, Clone, Copy)]
pub struct TrainStep<'a> {
    /// Effects and accuracy.
    pub settings: &'a RenderSettings,
    /// Loss to minimise.
    pub loss: Loss,
    /// Settings of Adam at this step.
    pub rates: &'a AdamRates,
    /// Fresh or reused lists.
    pub binning: Binning,
}

/// The losses that [`Optimizer::losses`] returns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wait {
    /// The losses that have arrived; does not wait.
    Arrived,
    /// The losses of all steps that were sent; waits for the last of them.
    All,
}

/// A backend's description.
pub trait Backend {
    /// Name of the backend and what it runs on, for reports: "cpu (avx512, 2 threads)".
    fn describe(&self) -> String;
}

/// A backend that draws scenes of kind `S` and differentiates their images.
///
/// [`Self::upload`], [`Self::forward`] and [`Self::image`] are enough to draw; with
/// [`Self::upload_target`], [`Self::backward`] and [`Self::gradients`] a program can optimise a
/// scene with an optimizer of its own, and with [`Self::image_vjp`] by a loss of its own.
/// [`Optimizer`] is for backends that train.
pub trait Rasterizer<S: Scene>: Backend {
    /// A scene where this backend computes; backends that train keep Adam's moments and statistics
    /// with the parameters.
    type Splats;
    /// A forward pass with all that its backward pass needs.
    type ForwardPass;
    /// ∂L/∂ every parameter, where this backend computes.
    type Gradients;
    /// A target image, where this backend computes.
    type Target;

    /// Copies a scene to the backend, with fresh moments and statistics.
    ///
    /// # Errors
    /// Those of [`Scene::validate`]; [`Error::Backend`] where memory runs out.
    fn upload(&self, scene: &S, parameterization: Parameterization) -> Result<Self::Splats, Error>;

    /// Draws the splats: the stages `project`, `bin`, `sort`, `blend`.
    ///
    /// # Errors
    /// [`Error::Setting`], [`Error::Size`] or [`Error::Unsupported`] where view or settings are not
    /// possible.
    fn forward(
        &self,
        splats: &Self::Splats,
        view: &S::View,
        settings: &RenderSettings,
    ) -> impl Future<Output = Result<Self::ForwardPass, Error>>;

    /// The image of a forward pass, `[H, W, 3]`, not clamped.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn image(&self, pass: &Self::ForwardPass) -> impl Future<Output = Result<Image, Error>>;

    /// Numbers of Gaussians that the forward pass left out, by cause.
    fn culled(&self, pass: &Self::ForwardPass) -> Culled;

    /// Copies a target image to the backend, with its alpha and mask.
    ///
    /// # Errors
    /// Those of [`TargetImage::validate`]; [`Error::Backend`] where memory runs out.
    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Self::Target, Error>;

    /// The loss and its gradients: the stages `loss`, `blend_bwd` and `project_bwd`.
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

    /// The loss of [`Self::backward`] without its gradients, bit for bit.
    ///
    /// Backends may need less time and memory for it.
    ///
    /// # Errors
    /// Those of [`Self::backward`].
    fn loss(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        target: &Self::Target,
        loss: &Loss,
    ) -> impl Future<Output = Result<f32, Error>> {
        async { Ok(self.backward(splats, pass, target, loss).await?.0) }
    }

    /// The vector-Jacobian product of the image: gradients of any loss L from `v_image` =
    /// ∂L/∂image, `[H, W, 3]`. The stages `blend_bwd` and `project_bwd`.
    ///
    /// This is [`Self::backward`] for a loss of the caller's own. It is linear in `v_image`. As
    /// there is no target, [`Statistics::PixelError`](crate::effects::Statistics::PixelError) is 0.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where pass and `v_image` differ in size, [`Error::Pixel`] where
    /// `v_image` is not finite.
    fn image_vjp(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        v_image: &Image,
    ) -> impl Future<Output = Result<Self::Gradients, Error>>;

    /// Downloads gradients as a scene of derivatives, by the parameters of the scene, whatever the
    /// parameterization.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn gradients(&self, splats: &Self::Splats, gradients: &Self::Gradients) -> impl Future<Output = Result<S, Error>>;

    /// The gradient by the camera of [`Self::backward`] or [`Self::image_vjp`], whose forward pass
    /// asked for it by [`RenderSettings::camera_gradient`].
    ///
    /// A backend that refuses that setting leaves this method as it is.
    ///
    /// # Errors
    /// [`Error::State`] where the forward pass did not ask for it, [`Error::Backend`] where the
    /// device is lost.
    fn camera_gradient(&self, _gradients: &Self::Gradients) -> impl Future<Output = Result<CameraGradient, Error>> {
        async { Err(CameraGradient::not_requested()) }
    }

    /// Downloads the scene.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn download(&self, splats: &Self::Splats) -> impl Future<Output = Result<S, Error>>;

    /// Number of Gaussians.
    fn len(&self, splats: &Self::Splats) -> usize;

    /// The image of splats, not clamped, and the numbers of Gaussians left out, without a backward
    /// pass.
    ///
    /// The result is the same as by [`Self::forward`], [`Self::image`] and [`Self::culled`], bit for
    /// bit. Backends may need less memory for it.
    ///
    /// # Errors
    /// Those of the three methods.
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

    /// Uploads and draws a scene.
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
/// A backend may compute later than it is called: [`Self::train_step`] sends a step, and
/// [`Self::losses`] reports its loss. All other methods behave as if each step had been done when
/// it was sent: they wait for the steps under way. So an error that a backend cannot foresee when a
/// step is sent, such as a lost device or exhausted memory, is reported by a later call with the
/// same splats. The steps that it prevented are not done and have no loss.
pub trait Optimizer<S: Scene>: Rasterizer<S> {
    /// Sends a training step, which may still be under way when this returns; [`Self::losses`]
    /// reports its loss.
    ///
    /// Waits where too many steps are under way. Backends may fuse stages; the result equals that
    /// of [`Rasterizer::forward`], [`Rasterizer::backward`] and [`Self::step`] up to rounding.
    ///
    /// # Errors
    /// Those of the three methods, after which this step is not done; also those of steps that were
    /// sent before.
    fn train_step(
        &self,
        splats: &mut Self::Splats,
        view: &S::View,
        target: &Self::Target,
        step: &TrainStep<'_>,
    ) -> impl Future<Output = Result<(), Error>>;

    /// Appends to `losses` the loss before each training step of these splats since the last call,
    /// in order and each once.
    ///
    /// Edits in between make no difference. A backend that computes at once returns all losses,
    /// whatever `wait` is. Splats keep four bytes a step until the losses are collected.
    ///
    /// # Errors
    /// [`Error::Backend`] where a step that was sent could not be done; losses that are known by
    /// then are returned by the next call.
    fn losses(
        &self,
        splats: &mut Self::Splats,
        wait: Wait,
        losses: &mut Vec<f32>,
    ) -> impl Future<Output = Result<(), Error>>;

    /// Appends to `gradients` the gradient by the camera of each training step of these splats since
    /// the last call that asked for it by [`RenderSettings::camera_gradient`], in order and each
    /// once. It is of the step's own loss, before the step.
    ///
    /// In all else this is like [`Self::losses`]; splats keep 40 bytes a step until the gradients
    /// are collected. A backend that refuses that setting leaves this method as it is.
    ///
    /// # Errors
    /// Those of [`Self::losses`].
    fn camera_gradients(
        &self,
        _splats: &mut Self::Splats,
        _wait: Wait,
        _gradients: &mut Vec<CameraGradient>,
    ) -> impl Future<Output = Result<(), Error>> {
        async { Ok(()) }
    }

    /// Moves the splats against the gradients and adds to their statistics: the stage `adam`.
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

    /// Applies a plan to parameters, moments and statistics.
    ///
    /// # Errors
    /// [`Error::Plan`] where the plan contradicts itself or the splats, which are then unchanged.
    fn edit(&self, splats: &mut Self::Splats, plan: &EditPlan<S::Gaussian>) -> impl Future<Output = Result<(), Error>>;

    /// Adds noise to the means as defined by [`MeanNoise`]; nothing else changes. Without opacities
    /// nothing moves.
    ///
    /// Noise is not an edit, and may be sent between steps that are still under way.
    ///
    /// # Errors
    /// Those of [`MeanNoise::validate`] and of the device.
    fn add_noise(&self, splats: &mut Self::Splats, noise: &MeanNoise) -> Result<(), Error>;

    /// Moves all colours towards the least-squares solution for the target, all else fixed, by
    /// `iterations` of preconditioned conjugate gradients. Only for
    /// [`Blend::Sum`](crate::effects::Blend::Sum), where the image is linear in the colours.
    ///
    /// # Errors
    /// [`Error::Unsupported`] under another blending or where the target has an alpha or a mask
    /// or is [`TargetImage::compact`], and those of [`Rasterizer::forward`].
    fn solve_colors(
        &self,
        splats: &mut Self::Splats,
        view: &S::View,
        target: &Self::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> impl Future<Output = Result<(), Error>>;

    /// Downloads the whole state, bit for bit, for a checkpoint.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn save(&self, splats: &Self::Splats) -> impl Future<Output = Result<SplatsState, Error>>;

    /// [`Self::save`] for writing to a file. A backend whose memory is the host's passes its numbers
    /// on instead of copying them.
    ///
    /// # Errors
    /// Those of [`Self::save`].
    fn saved<'s>(&self, splats: &'s Self::Splats) -> impl Future<Output = Result<SavedState<'s>, Error>> {
        async { Ok(self.save(splats).await?.into()) }
    }

    /// Uploads splats in exactly the saved state.
    ///
    /// # Errors
    /// [`Error::State`] where the state is not that of splats of this kind.
    fn restore(&self, state: &SplatsState) -> Result<Self::Splats, Error>;
}
