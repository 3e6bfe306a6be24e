//! A backend with one of the faults that hard cases bring out in engines, or none, around one without.

mod fallible;

use std::cell::RefCell;

use gs_core::{
    AdamRates, Backend, DensityStatistics, EditPlan, Error, Image, Loss, MeanNoise, Optimizer, Parameterization,
    Rasterizer, RenderSettings, SplatsState, TargetImage, TrainStep, Wait,
    edit::{AfterEdit, Change, Moments},
    effects::{Antialias, Order},
    settings::Extent,
    state::TensorData,
    statistics::Culled,
};
use pollster::FutureExt as _;

use self::fallible::Fallible;

/// What is wrong with the backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Nothing: what passes.
    Faultless,
    /// Gaussians of extreme shapes are dropped when they come in, so that nothing has to be done about them.
    DropsExtremes,
    /// The Gaussians left out are not counted.
    CountsNothing,
    /// What is not finite is left out, and the first pixel with it.
    SpreadsToAPixel,
    /// What is left out changes another pixel by an ulp.
    SpreadsByAnUlp,
    /// A colour that is not finite gets through.
    ShowsNan,
    /// Numbers that are not finite are made 0 on the way in.
    Sanitises,
    /// Targets are not looked at.
    TakesAnyTarget,
    /// Rates out of range are replaced.
    TakesAnyRates,
    /// Losses out of range are replaced.
    TakesAnyLoss,
    /// Settings are refused that nobody uses, but that are possible.
    RefusesTheUnusual,
    /// Gaussians are looked at as far as the cut, whatever number of standard deviations is asked for.
    IgnoresTheExtent,
    /// α is clamped elsewhere.
    ClampsElsewhere,
    /// The cut is two ulps lower.
    CutsTwoUlpsLower,
    /// α must be above the cut, not only at it; as α is not a wrapper's, opacities of exactly ½ are two ulps less.
    CutsWhatIsAtTheCut,
    /// The gradients of a Gaussian of which one is a thousandth or more are made 0.
    DropsLargeGradients,
    /// Losses are told as 0 from the hundredth step on.
    LosesItsLosses,
    /// A loss is not a number in the middle of a run.
    LosesItsLoss,
    /// Means creep, gradient or none.
    Creeps,
    /// Training tells losses, and that is all.
    NeverSteps,
    /// Gradients are those of other Gaussians.
    MixesGradients,
    /// What is nearer than the near plane is drawn.
    IgnoresTheNearPlane,
    /// Gaussians are blended in the scene's order.
    OrdersByIndex,
    /// One depth is all that a Gaussian has.
    OrdersByMean,
    /// The Jacobian is followed further beyond the field of view.
    FollowsTheJacobian,
    /// The principal point is taken to be in the middle.
    CentresThePrincipalPoint,
    /// Pixels are taken to be squares.
    SquaresPixels,
    /// Harmonics of the third degree are left out.
    DropsSh,
    /// Gaussians are dilated, whether that is wanted or not.
    Dilates,
    /// What is dilated stays as opaque as it was.
    ForgetsCompensation,
}

use Fault::*;

/// The backend `inner` with a fault.
pub(crate) struct Faulty<'r, R> {
    pub(crate) inner: &'r R,
    pub(crate) fault: Fault,
    /// Losses of steps that were not done.
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
        let is_possible = settings.validate().is_ok();
        let mut settings = *settings;
        let RenderSettings { accuracy, effects, .. } = &mut settings;
        match self.fault {
            ClampsElsewhere => accuracy.alpha_max = accuracy.alpha_max.min(0.99),
            CutsTwoUlpsLower => accuracy.alpha_cut = accuracy.alpha_cut.next_down().next_down(),
            IgnoresTheExtent if is_possible => accuracy.extent = Extent::AlphaCut,
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

    /// What is in place of a loss.
    fn heard(&self, loss: Loss) -> Loss {
        if self.is(TakesAnyLoss) && loss.validate().is_err() { Loss::L2 } else { loss }
    }
}

/// A frame, and the image that is shown in its place.
pub(crate) struct Frame<F> {
    drawn: F,
    instead: Option<Image>,
}

/// Whether a row of parameters has an axis a thousand times another.
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
    type ForwardPass = Frame<R::ForwardPass>;
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
        Ok(Frame { drawn, instead })
    }

    async fn image(&self, Frame { drawn, instead }: &Self::ForwardPass) -> Result<Image, Error> {
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

    fn culled(&self, frame: &Self::ForwardPass) -> Culled {
        if self.is(CountsNothing) { Culled::default() } else { self.inner.culled(&frame.drawn) }
    }

    async fn backward(
        &self,
        splats: &R::Splats,
        frame: Self::ForwardPass,
        target: &R::Target,
        loss: &Loss,
    ) -> Result<(f32, R::Gradients), Error> {
        self.inner.backward(splats, frame.drawn, target, &self.heard(*loss)).block_on()
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
            (S::altered_view(self.fault, view), self.altered(step.settings), self.heard(step.loss));
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
                let gaussian = S::crept(scene.gaussian(index));
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
