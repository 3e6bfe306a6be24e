//! The trait that a backend implements: rasterise, differentiate, optimise and edit the Gaussians of one kind of scene.
//!
//! Only [`Rasterizer::upload`], [`Rasterizer::download`], images and the state cross between host and backend; a training step
//! moves no data that grows with the number of Gaussians. A second backward pass of a forward pass is a type error, because
//! [`Rasterizer::backward`] takes the forward pass by value; a forward pass from before an edit is refused. Of a forward pass from before a step the gradients
//! are of no use: they are those of the pixels of then, taken back through the parameters of now.

use crate::{
    adam::{AdamRates, Parameterization},
    edit::EditPlan,
    error::Error,
    image::Image,
    loss::Loss,
    scene::Scene,
    settings::RenderSettings,
    state::SplatsState,
    statistics::{Culled, DensityStatistics},
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

/// What one call of [`Rasterizer::train_step`] needs besides splats, view and target.
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

/// Which losses [`Rasterizer::losses`] hands over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wait {
    /// Those that are known by now; waits for none.
    Arrived,
    /// Those of all steps that were sent; waits for the last of them.
    All,
}

/// A backend for scenes of kind `S`.
///
/// A backend may compute later than it is told to: [`Self::train_step`] sends a step, [`Self::losses`] says what came of it. All
/// else behaves as if every step had been done when it was sent: whatever looks at splats waits for the steps that are still under
/// way. What a backend cannot foresee when a step is sent, a lost device or memory that has run out, is therefore an error of some
/// later call with the same splats; the steps that it kept from being done are not done then, and have no loss.
pub trait Rasterizer<S: Scene> {
    /// Parameters, Adam moments and statistics, where this backend computes.
    type Splats;
    /// One forward pass and all that its backward pass needs.
    type ForwardPass;
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
    fn upload(&self, scene: &S, parameterization: Parameterization) -> Result<Self::Splats, Error>;

    /// Copies the parameters back.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn download(&self, splats: &Self::Splats) -> Result<S, Error>;

    /// Number of Gaussians, without crossing to the device.
    fn len(&self, splats: &Self::Splats) -> usize;

    /// Copies an image to the backend.
    ///
    /// # Errors
    /// [`Error::Backend`] where memory runs out.
    fn upload_target(&self, image: &Image) -> Result<Self::Target, Error>;

    /// The whole state, bit for bit, for a checkpoint.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn save(&self, splats: &Self::Splats) -> Result<SplatsState, Error>;

    /// splats in exactly the state that was saved.
    ///
    /// # Errors
    /// [`Error::State`] where the state is not one of splats of this kind.
    fn restore(&self, state: &SplatsState) -> Result<Self::Splats, Error>;

    /// Stages `project`, `bin`, `sort`, `blend`.
    ///
    /// # Errors
    /// [`Error::Setting`], [`Error::Size`] or [`Error::Unsupported`] where view or settings are not possible.
    fn forward(
        &self,
        splats: &Self::Splats,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<Self::ForwardPass, Error>;

    /// The pass's image, `[H, W, 3]`, not clamped.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn image(&self, pass: &Self::ForwardPass) -> Result<Image, Error>;

    /// How many Gaussians the forward pass left out, by cause.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn culled(&self, pass: &Self::ForwardPass) -> Result<Culled, Error>;

    /// The image of splats, not clamped, and how many Gaussians it leaves out, where no backward pass follows: what [`Self::forward`],
    /// [`Self::image`] and [`Self::culled`] find, to the bit. Backends may need less memory for it.
    ///
    /// # Errors
    /// Those of the three.
    fn draw(&self, splats: &Self::Splats, view: &S::View, settings: &RenderSettings) -> Result<(Image, Culled), Error> {
        let pass = self.forward(splats, view, settings)?;
        Ok((self.image(&pass)?, self.culled(&pass)?))
    }

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
    ) -> Result<(f32, Self::Gradients), Error>;

    /// The gradients with respect to the parameters as the scene has them, whatever the parameterization; a scene of derivatives.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn download_gradients(&self, splats: &Self::Splats, gradients: &Self::Gradients) -> Result<S, Error>;

    /// Stage `adam`: moves the splats against the gradients, and adds to its statistics.
    ///
    /// # Errors
    /// [`Error::State`] where gradients and splats differ in length.
    fn step(&self, splats: &mut Self::Splats, gradients: &Self::Gradients, rates: &AdamRates) -> Result<(), Error>;

    /// Sends one whole training step, which may still be under way when this returns; its loss comes with [`Self::losses`]. Backends
    /// may fuse its stages; the result is that of [`Self::forward`], [`Self::backward`] and [`Self::step`], to rounding.
    ///
    /// # Errors
    /// Those of the three, after which this step is not done; also those of steps that were sent before.
    fn train_step(
        &self,
        splats: &mut Self::Splats,
        view: &S::View,
        target: &Self::Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        let pass = self.forward(splats, view, step.settings)?;
        let (loss, gradients) = self.backward(splats, pass, target, &step.loss)?;
        self.step(splats, &gradients, step.rates)?;
        self.unread_losses(splats).push(loss);
        Ok(())
    }

    /// Adds to `losses` the loss before each of these splats' training steps since the last call, in their order and each once. Edits
    /// in between make no difference. A backend that computes at once has them all, whatever the `wait`.
    ///
    /// Ask now and then: splats keeps four bytes a step until somebody does.
    ///
    /// # Errors
    /// [`Error::Backend`] where a step that was sent could not be done; losses that are known by then are handed over by the next call.
    fn losses(&self, splats: &mut Self::Splats, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        // All are known: `train_step` does the whole step.
        let _ = wait;
        losses.append(self.unread_losses(splats));
        Ok(())
    }

    /// Where splats keeps the losses that are known and that [`Self::losses`] has not handed over yet, oldest first. For the backend's
    /// own use: a field of the splats that [`Self::train_step`] adds to.
    fn unread_losses<'c>(&self, splats: &'c mut Self::Splats) -> &'c mut Vec<f32>;

    /// Moves the colours of all Gaussians towards the least-squares solution for the target, all else fixed, by `iterations` of
    /// preconditioned conjugate gradients. [`Blend::Sum`](crate::effects::Blend::Sum) only, where the image is linear in them.
    ///
    /// # Errors
    /// [`Error::Unsupported`] under another blending, and those of [`Self::forward`].
    fn solve_colors(
        &self,
        splats: &mut Self::Splats,
        view: &S::View,
        target: &Self::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error>;

    /// Statistics since the last edit.
    ///
    /// # Errors
    /// [`Error::Backend`] where the device is lost.
    fn statistics(&self, splats: &Self::Splats) -> Result<DensityStatistics, Error>;

    /// Applies a plan to parameters, moments and statistics together.
    ///
    /// # Errors
    /// [`Error::Plan`] where the plan contradicts itself or the splats; the splats is then as before.
    fn edit(&self, splats: &mut Self::Splats, plan: &EditPlan<S::Gaussian>) -> Result<(), Error>;

    /// Adds `shifts`, `[N, 2]` px (3D scenes: `[N, 3]` world units), row-major, to the means; all else, moments included, stays as it
    /// is. For noise between steps, which is no edit: nothing is removed, added or started afresh.
    ///
    /// The default goes through [`Self::save`] and [`Self::restore`], and so moves the whole state.
    ///
    /// # Errors
    /// [`Error::Length`] where `shifts` are not of as many Gaussians as the splats has, and those of saving and restoring; the splats is then as
    /// before.
    fn shift_means(&self, splats: &mut Self::Splats, shifts: &[f32]) -> Result<(), Error> {
        let mut known = Vec::new();
        self.losses(splats, Wait::All, &mut known)?;
        let result = self.save(splats).and_then(|mut state| {
            state.shift("mean", shifts)?;
            self.restore(&state)
        });
        let result = result.map(|shifted| *splats = shifted);
        let unread = self.unread_losses(splats);
        known.append(unread);
        *unread = known;
        result
    }

    /// A picture of a scene, nothing else.
    ///
    /// # Errors
    /// Those of [`Self::upload`] and [`Self::draw`].
    fn render(&self, scene: &S, view: &S::View, settings: &RenderSettings) -> Result<Image, Error> {
        Ok(self.draw(&self.upload(scene, Parameterization::ScaleRotation)?, view, settings)?.0)
    }
}
