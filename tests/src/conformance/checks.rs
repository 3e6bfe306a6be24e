//! What cases are made of: comparisons of a drawing with the oracle, and what a backend refuses.

use gs_core::{Binning, Blend, Error, Image, Loss, Optimizer, Parameterization, SplatsState, TrainStep, Wait};
use pollster::FutureExt as _;

use crate::{
    failure::Failure,
    oracle::{Gradients, Oracle},
    scenes::Draw,
    subject::Subject,
    tolerance::{Agreement, compare_gradients, compare_images, compare_loss},
};

/// The tested losses.
pub(crate) const LOSSES: [Loss; 3] = [Loss::L2, Loss::L1, Loss::PAPER];

/// The outcome of a case that did not fail.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CaseOutcome {
    /// The backend passes.
    Passed,
    /// The backend refuses the optional features of this case.
    Skipped(String),
}

/// The outcome of cases that cannot be skipped.
impl From<()> for CaseOutcome {
    fn from((): ()) -> Self {
        Self::Passed
    }
}

/// Renders a drawing and compares the image with the oracle's.
///
/// # Errors
/// [`Failure`] if they differ, or if the backend or the comparison fails.
pub fn check_image<S: Subject, R: Optimizer<S>>(rasterizer: &R, draw: &Draw<S>) -> Result<Agreement, Failure> {
    let expected = Oracle::new(draw.view, draw.settings)?.render(&draw.scene.rows());
    let found = rasterizer.render(&draw.scene, &draw.view, &draw.settings).block_on()?;
    compare_images(&expected, &found).map_err(|failure| failure.at(place(draw)))
}

/// Differentiates a drawing and compares loss and gradients with the oracle's, at the parameters of
/// the backend's splats.
///
/// # Errors
/// [`Failure`] if they differ, or if the backend or the comparison fails.
pub fn check_gradients<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    draw: &Draw<S>,
    loss: &Loss,
    parameterization: Parameterization,
) -> Result<Agreement, Failure> {
    let target = draw.target()?;
    let backward = Backward::of(rasterizer, draw, &target, loss, parameterization)?;
    let expected = backward.expected(draw, &target, loss)?;
    let in_place = |failure: Failure| failure.at(format!("{}, {loss:?}, {parameterization:?}", place(draw)));
    let agreement = compare_loss(&expected, backward.loss).map_err(in_place)?;
    Ok(agreement.and(compare_gradients(&expected, &backward.gradients).map_err(in_place)?))
}

/// Whether the backend refuses a drawing's effects as [`Error::Unsupported`].
///
/// A training step must refuse them, too, and change nothing.
pub(super) fn is_refused<S: Subject, R: Optimizer<S>>(rasterizer: &R, draw: &Draw<S>) -> Result<bool, Failure> {
    let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    match rasterizer.forward(&splats, &draw.view, &draw.settings).block_on() {
        Err(Error::Unsupported { .. }) => {}
        other => return Ok(other.map(|_| false)?),
    }
    let before = rasterizer.save(&splats).block_on()?;
    let target = rasterizer.upload_target(&draw.target()?)?;
    let rates = S::adam().at(0.0);
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let refused = rasterizer.train_step(&mut splats, &draw.view, &target, &step);
    let right =
        matches!(refused.block_on(), Err(Error::Unsupported { .. })) && rasterizer.save(&splats).block_on()? == before;
    Failure::unless(right, || format!("{}: refused in a forward pass, but not in a step", place(draw)))?;
    Ok(true)
}

/// The parameterizations that the backend offers: the first, and all that it does not refuse as
/// [`Error::Unsupported`]. It must also refuse to restore states in the others.
pub(crate) fn parameterizations<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<Vec<Parameterization>, Failure> {
    let empty = S::typical(Blend::Over, 1, (8, 8), 1).scene.emptied();
    let mut offered = Vec::new();
    for &parameterization in S::PARAMETERIZATIONS {
        match rasterizer.upload(&empty, parameterization) {
            Err(Error::Unsupported { .. }) if parameterization != S::PARAMETERIZATIONS[0] => {
                let state = SplatsState {
                    parameterization,
                    ..rasterizer.save(&rasterizer.upload(&empty, S::PARAMETERIZATIONS[0])?).block_on()?
                };
                let refused = matches!(rasterizer.restore(&state), Err(Error::Unsupported { .. }));
                Failure::unless(refused, || {
                    format!("{parameterization:?} is refused for a scene, but not for a saved state")
                })?;
            }
            splats => {
                splats?;
                offered.push(parameterization);
            }
        }
    }
    Ok(offered)
}

/// A backward pass of fresh splats.
struct Backward<S> {
    /// The parameters that the backend returns.
    scene: S,
    loss: f32,
    gradients: S,
}

impl<S: Subject> Backward<S> {
    fn of<R: Optimizer<S>>(
        rasterizer: &R,
        draw: &Draw<S>,
        target: &Image,
        loss: &Loss,
        parameterization: Parameterization,
    ) -> Result<Self, Failure> {
        let splats = rasterizer.upload(&draw.scene, parameterization)?;
        let uploaded = rasterizer.upload_target(target)?;
        let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
        let (loss, gradients) = rasterizer.backward(&splats, pass, &uploaded, loss).block_on()?;
        let gradients = rasterizer.gradients(&splats, &gradients).block_on()?;
        Ok(Self { scene: rasterizer.download(&splats).block_on()?, loss, gradients })
    }

    fn expected(&self, draw: &Draw<S>, target: &Image, loss: &Loss) -> Result<Gradients, Failure> {
        Ok(Oracle::new(draw.view, draw.settings)?.gradients(&self.scene.rows(), target, loss)?)
    }
}

/// All losses that were not taken yet.
pub(super) fn losses_of<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    splats: &mut R::Splats,
) -> Result<Vec<f32>, Failure> {
    let mut losses = Vec::new();
    rasterizer.losses(splats, Wait::All, &mut losses).block_on()?;
    Ok(losses)
}

/// The place in a case, for messages.
pub(super) fn place<S: Subject>(draw: &Draw<S>) -> String {
    format!("{} {:?} through {:?}, {:?}", draw.scene.len(), draw.kind, draw.view, draw.settings.effects)
}
