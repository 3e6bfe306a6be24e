//! A backend with one typical fault of engines, or none, around a correct backend.

mod fallible;

use std::cell::RefCell;

use gs_core::{
    AdamRates, Backend, Culled, DensityStatistics, EditPlan, Error, Image, Loss, MeanNoise, Optimizer,
    Parameterization, Rasterizer, RenderSettings, SplatsState, TargetImage, TensorData, TrainStep, Wait,
    edit::{AfterEdit, Change, Moments},
    effects::{Antialias, Order},
};
use pollster::FutureExt as _;

use self::fallible::Fallible;

/// The fault of the backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// No fault.
    Faultless,
    /// Extreme Gaussians are dropped on upload.
    DropsExtremes,
    /// Culled Gaussians are not counted.
    CountsNothing,
    /// A Gaussian that is not finite is culled, but changes the first pixel.
    SpreadsToAPixel,
    /// A culled Gaussian changes another pixel by an ulp.
    SpreadsByAnUlp,
    /// Colours that are not finite are drawn.
    ShowsNan,
    /// Numbers that are not finite are made 0 on the way in.
    Sanitises,
    /// Targets are not validated.
    TakesAnyTarget,
    /// Rates out of range are replaced.
    TakesAnyRates,
    /// Losses out of range are replaced.
    TakesAnyLoss,
    /// Unusual but valid settings are refused.
    RefusesTheUnusual,
    /// α is clamped at another value.
    ClampsElsewhere,
    /// The cut is two ulps lower.
    CutsTwoUlpsLower,
    /// α must be above the cut instead of at least the cut. A wrapper cannot change α, so it lowers
    /// opacities of exactly ½ by two ulps.
    CutsWhatIsAtTheCut,
    /// The gradients of a Gaussian are 0 if one of them is at least a thousandth.
    DropsLargeGradients,
    /// Losses are reported as 0 from the hundredth step on.
    LosesItsLosses,
    /// A loss in the middle of a run is NaN.
    LosesItsLoss,
    /// Means move even without gradients.
    Creeps,
    /// Training reports losses but does not move anything.
    NeverSteps,
    /// Gradients are assigned to other Gaussians.
    MixesGradients,
    /// Gaussians in front of the near plane are drawn.
    IgnoresTheNearPlane,
    /// Gaussians are blended in the scene's order.
    OrdersByIndex,
    /// The depth of a Gaussian does not depend on the pixel.
    OrdersByMean,
    /// The Jacobian's slopes are clamped too far outside the field of view.
    FollowsTheJacobian,
    /// The principal point is assumed to be in the middle.
    CentresThePrincipalPoint,
    /// Pixels are assumed to be square.
    SquaresPixels,
    /// SH of degree 3 are ignored.
    DropsSh,
    /// Gaussians are always dilated.
    Dilates,
    /// Compensation is ignored.
    ForgetsCompensation,
}

use Fault::*;

/// The backend `inner` with a fault.
pub(crate) struct Faulty<'r, R> {
    pub(crate) inner: &'r R,
    pub(crate) fault: Fault,
    /// Losses of steps that were not taken.
    losses: RefCell<Vec<f32>>,
}

impl<'r, R> Faulty<'r, R> {
    pub(crate) fn new(inner: &'r R, fault: Fault) -> Self {
        Self { inner, fault, losses: RefCell::default() }
    }

    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }

    fn altered(&self, settings: &RenderSettings) -> RenderSettings {
        let mut settings = *settings;
        let RenderSettings { accuracy, effects, .. } = &mut settings;
        match self.fault {
            ClampsElsewhere => accuracy.alpha_max = accuracy.alpha_max.min(0.99),
            CutsTwoUlpsLower => accuracy.alpha_cut = accuracy.alpha_cut.next_down().next_down(),
            OrdersByIndex => effects.order = Order::Index,
            OrdersByMean if effects.order == Order::PerPixel => effects.order = Order::Global,
            DropsSh => effects.sh_degree = effects.sh_degree.min(2),
            Dilates if effects.antialias == Antialias::None => effects.antialias = Antialias::Dilate,
            ForgetsCompensation if effects.antialias.compensates() => effects.antialias = Antialias::Dilate,
            _ => {}
        }
        settings
    }

    fn refuses(&self, settings: &RenderSettings) -> Result<(), Error> {
        let alpha_max = settings.accuracy.alpha_max;
        if self.is(RefusesTheUnusual) && alpha_max < 0.9 {
            return Err(Error::setting("alpha-max", alpha_max, "0.9 to 0.9999"));
        }
        Ok(())
    }

    /// The loss after a fault.
    fn altered_loss(&self, loss: Loss) -> Loss {
        if self.is(TakesAnyLoss) && loss.validate().is_err() { Loss::L2 } else { loss }
    }
}

/// A forward pass, and the image that replaces its own.
pub(crate) struct Pass<F> {
    drawn: F,
    instead: Option<Image>,
}

/// Whether a Gaussian has an axis a thousand times as long as another.
fn is_extreme(log_scales: &[f64]) -> bool {
    let (least, most) = log_scales.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    most - least > 6.9
}

impl<R: Backend> Backend for Faulty<'_, R> {
    fn describe(&self) -> String {
        format!("{} ({:?})", self.inner.describe(), self.fault)
    }
}

impl<S: Fallible, R: Optimizer<S>> Rasterizer<S> for Faulty<'_, R> {
    type Splats = R::Splats;
    type ForwardPass = Pass<R::ForwardPass>;
    type Gradients = R::Gradients;
    type Target = R::Target;

    fn upload(&self, scene: &S, parameterization: Parameterization) -> Result<R::Splats, Error> {
        if self.is(DropsExtremes) {
            let rows = scene.rows().gaussians;
            let scales = S::DIMENSIONS..2 * S::DIMENSIONS;
            let kept = (0..scene.len()).filter(|&i| !is_extreme(&rows[i][scales.clone()]));
            return self.inner.upload(&scene.picked(kept), parameterization);
        }
        if self.is(CutsWhatIsAtTheCut) {
            let mut scene = scene.clone();
            // 1 / (1 + e⁻ˣ) of this is 1 / (2 + 2⁻²²).
            scene.opacity_logits_mut().iter_mut().filter(|x| **x == 0.0).for_each(|x| *x = -2.0 * f32::EPSILON);
            return self.inner.upload(&scene, parameterization);
        }
        self.inner.upload(scene, parameterization)
    }

    async fn download(&self, splats: &R::Splats) -> Result<S, Error> {
        self.inner.download(splats).block_on()
    }

    fn len(&self, splats: &R::Splats) -> usize {
        self.inner.len(splats)
    }

    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<R::Target, Error> {
        let target = target.into();
        if self.is(TakesAnyTarget) {
            let mut image = target.image.clone();
            let broken = image.pixels_mut().as_flattened_mut().iter_mut().filter(|v| !v.is_finite());
            broken.for_each(|v| *v = 0.0);
            return self.inner.upload_target(TargetImage { image: &image, ..target });
        }
        self.inner.upload_target(target)
    }

    async fn forward(
        &self,
        splats: &R::Splats,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<Self::ForwardPass, Error> {
        self.refuses(settings)?;
        let (view, settings) = (S::altered_view(self.fault, view), self.altered(settings));
        let drawn = self.inner.forward(splats, &view, &settings).block_on()?;
        let mut instead = None;
        if self.is(FollowsTheJacobian)
            && let Some(wider) = S::widened(&view)
        {
            let image = self.inner.image(&self.inner.forward(splats, &wider, &settings).block_on()?).block_on()?;
            let (width, height) = self.inner.image(&drawn).block_on()?.size();
            instead = Some(Image::from_fn(width, height, |x, y| image.pixel(x, y))?);
        }
        Ok(Pass { drawn, instead })
    }

    async fn image(&self, Pass { drawn, instead }: &Self::ForwardPass) -> Result<Image, Error> {
        let mut image = instead.clone().map_or_else(|| self.inner.image(drawn).block_on(), Ok)?;
        let culled = self.inner.culled(drawn);
        let last = image.pixels().len() - 1;
        let pixels = image.pixels_mut();
        match self.fault {
            SpreadsToAPixel if culled.not_finite > 0 => pixels[0] = [0.0; 3],
            SpreadsByAnUlp if culled.total() > 0 => pixels[last][1] = pixels[last][1].next_up(),
            ShowsNan if culled.not_finite > 0 => pixels[last / 2][2] = f32::NAN,
            _ => {}
        }
        Ok(image)
    }

    fn culled(&self, pass: &Self::ForwardPass) -> Culled {
        if self.is(CountsNothing) { Culled::default() } else { self.inner.culled(&pass.drawn) }
    }

    async fn backward(
        &self,
        splats: &R::Splats,
        pass: Self::ForwardPass,
        target: &R::Target,
        loss: &Loss,
    ) -> Result<(f32, R::Gradients), Error> {
        self.inner.backward(splats, pass.drawn, target, &self.altered_loss(*loss)).block_on()
    }

    async fn image_vjp(
        &self,
        splats: &R::Splats,
        pass: Self::ForwardPass,
        v_image: &Image,
    ) -> Result<R::Gradients, Error> {
        self.inner.image_vjp(splats, pass.drawn, v_image).block_on()
    }

    async fn gradients(&self, splats: &R::Splats, gradients: &R::Gradients) -> Result<S, Error> {
        let gradients = self.inner.gradients(splats, gradients).block_on()?;
        let rows = gradients.rows_of_gradients();
        match self.fault {
            DropsLargeGradients => {
                let mut dropped = gradients.emptied();
                for (i, row) in rows.iter().enumerate() {
                    let is_large = row.iter().any(|v| v.abs() >= 1e-3);
                    dropped.push(if is_large { gradients.zero() } else { gradients.gaussian(i) });
                }
                Ok(dropped)
            }
            MixesGradients => Ok(gradients.picked((0..rows.len()).rev())),
            _ => Ok(gradients),
        }
    }
}

impl<S: Fallible, R: Optimizer<S>> Optimizer<S> for Faulty<'_, R> {
    async fn save(&self, splats: &R::Splats) -> Result<SplatsState, Error> {
        self.inner.save(splats).block_on()
    }

    fn restore(&self, state: &SplatsState) -> Result<R::Splats, Error> {
        let mut state = state.clone();
        if self.is(Sanitises) {
            for tensor in state.tensors.values_mut() {
                if let TensorData::F32(values) = &mut tensor.data {
                    values.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = 0.0);
                }
            }
        }
        self.inner.restore(&state)
    }

    async fn step(&self, splats: &mut R::Splats, gradients: &R::Gradients, rates: &AdamRates) -> Result<(), Error> {
        self.inner.step(splats, gradients, rates).block_on()
    }

    async fn train_step(
        &self,
        splats: &mut R::Splats,
        view: &S::View,
        target: &R::Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        self.refuses(step.settings)?;
        let usual = S::adam().at(0.0);
        let replaced = self.is(TakesAnyRates) && step.rates.validate().is_err();
        let rates = if replaced { &usual } else { step.rates };
        let (view, settings, loss) =
            (S::altered_view(self.fault, view), self.altered(step.settings), self.altered_loss(step.loss));
        if self.is(NeverSteps) {
            let pass = self.inner.forward(splats, &view, &settings).await?;
            let (loss, _) = self.inner.backward(splats, pass, target, &loss).await?;
            self.losses.borrow_mut().push(loss);
            return Ok(());
        }
        self.inner
            .train_step(splats, &view, target, &TrainStep { settings: &settings, loss, rates, ..*step })
            .block_on()?;
        if self.is(Creeps) {
            let scene = self.inner.download(splats).await?;
            let changed = (0..scene.len()).map(|index| {
                let gaussian = S::shifted(scene.gaussian(index));
                Change { index: index as u32, gaussian, moments: Moments::Inherit }
            });
            let plan = EditPlan { changed: changed.collect(), statistics: AfterEdit::Keep, ..EditPlan::default() };
            self.inner.edit(splats, &plan).await?;
        }
        Ok(())
    }

    async fn losses(&self, splats: &mut R::Splats, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        self.inner.losses(splats, wait, losses).block_on()?;
        losses.append(&mut self.losses.borrow_mut());
        match self.fault {
            LosesItsLosses => losses.truncate(100),
            LosesItsLoss if losses.len() > 100 => losses[100] = f32::NAN,
            _ => {}
        }
        Ok(())
    }

    async fn solve_colors(
        &self,
        splats: &mut R::Splats,
        view: &S::View,
        target: &R::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        self.inner.solve_colors(splats, view, target, settings, iterations).block_on()
    }

    async fn statistics(&self, splats: &R::Splats) -> Result<DensityStatistics, Error> {
        self.inner.statistics(splats).block_on()
    }

    fn add_noise(&self, splats: &mut R::Splats, noise: &MeanNoise) -> Result<(), Error> {
        self.inner.add_noise(splats, noise)
    }

    async fn edit(&self, splats: &mut R::Splats, plan: &EditPlan<S::Gaussian>) -> Result<(), Error> {
        self.inner.edit(splats, plan).block_on()
    }
}
