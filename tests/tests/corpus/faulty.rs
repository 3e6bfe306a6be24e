//! A backend with one of the faults that hard cases bring out in engines, or none, around one without.

use gs_conformance::subject::Subject;
use gs_core::{
    AdamRates, Chart, CloudState, DensityStatistics, EditPlan, Error, Image, Loss, Rasterizer, RenderSettings,
    TrainStep, Wait, state::TensorData, statistics::Culled,
};

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
    /// α is clamped elsewhere.
    ClampsElsewhere,
    /// The cut is an ulp higher.
    CutsAnUlpHigher,
    /// Gradients above 1000 are made 0.
    DropsLargeGradients,
    /// Losses are told as 0 from the hundredth step on.
    LosesItsLosses,
    /// A loss is not a number in the middle of a run.
    LosesItsLoss,
    /// Means creep, gradient or none.
    Creeps,
    /// Gradients are those of other Gaussians.
    MixesGradients,
}

use Fault::*;

/// The backend `inner` with a fault.
pub(crate) struct Faulty<'r, R> {
    pub(crate) inner: &'r R,
    pub(crate) fault: Fault,
}

impl<R> Faulty<'_, R> {
    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }

    fn altered(&self, settings: &RenderSettings) -> RenderSettings {
        let mut settings = *settings;
        let accuracy = &mut settings.accuracy;
        match self.fault {
            ClampsElsewhere => accuracy.alpha_max = accuracy.alpha_max.min(0.99),
            CutsAnUlpHigher if accuracy.alpha_cut < 0.5 => accuracy.alpha_cut = accuracy.alpha_cut.next_up(),
            // There is nothing above ½.
            CutsAnUlpHigher => accuracy.alpha_cut = 0.499,
            _ => {}
        }
        settings
    }
}

/// Whether a row of parameters has an axis a thousand times another.
fn is_extreme(log_scales: &[f64]) -> bool {
    let (least, most) = log_scales.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    most - least > 6.9
}

impl<S: Subject, R: Rasterizer<S>> Rasterizer<S> for Faulty<'_, R> {
    type Cloud = R::Cloud;
    type Frame = R::Frame;
    type Gradients = R::Gradients;
    type Target = R::Target;

    fn describe(&self) -> String {
        format!("{} ({:?})", self.inner.describe(), self.fault)
    }

    fn upload(&self, scene: &S, chart: Chart) -> Result<R::Cloud, Error> {
        if self.is(DropsExtremes) {
            let rows = scene.rows().gaussians;
            let scales = S::DIMENSIONS..2 * S::DIMENSIONS;
            let kept = (0..scene.len()).filter(|&i| !is_extreme(&rows[i][scales.clone()]));
            return self.inner.upload(&scene.picked(kept), chart);
        }
        self.inner.upload(scene, chart)
    }

    fn download(&self, cloud: &R::Cloud) -> Result<S, Error> {
        self.inner.download(cloud)
    }

    fn len(&self, cloud: &R::Cloud) -> usize {
        self.inner.len(cloud)
    }

    fn upload_target(&self, image: &Image) -> Result<R::Target, Error> {
        if self.is(TakesAnyTarget) {
            let mut image = image.clone();
            let broken = image.pixels_mut().as_flattened_mut().iter_mut().filter(|v| !v.is_finite());
            broken.for_each(|v| *v = 0.0);
            return self.inner.upload_target(&image);
        }
        self.inner.upload_target(image)
    }

    fn save(&self, cloud: &R::Cloud) -> Result<CloudState, Error> {
        self.inner.save(cloud)
    }

    fn restore(&self, state: &CloudState) -> Result<R::Cloud, Error> {
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

    fn forward(&self, cloud: &R::Cloud, view: &S::View, settings: &RenderSettings) -> Result<R::Frame, Error> {
        self.inner.forward(cloud, view, &self.altered(settings))
    }

    fn image(&self, frame: &R::Frame) -> Result<Image, Error> {
        let mut image = self.inner.image(frame)?;
        let culled = self.inner.culled(frame)?;
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

    fn culled(&self, frame: &R::Frame) -> Result<Culled, Error> {
        if self.is(CountsNothing) { Ok(Culled::default()) } else { self.inner.culled(frame) }
    }

    fn backward(
        &self,
        cloud: &R::Cloud,
        frame: R::Frame,
        target: &R::Target,
        loss: &Loss,
    ) -> Result<(f32, R::Gradients), Error> {
        self.inner.backward(cloud, frame, target, loss)
    }

    fn download_gradients(&self, cloud: &R::Cloud, gradients: &R::Gradients) -> Result<S, Error> {
        let gradients = self.inner.download_gradients(cloud, gradients)?;
        let rows = gradients.rows_of_gradients();
        match self.fault {
            DropsLargeGradients => {
                let small = |row: &Vec<f64>| row.iter().all(|v| v.abs() < 1e-3);
                Ok(gradients.picked((0..rows.len()).map(|i| if small(&rows[i]) { i } else { 0 })))
            }
            MixesGradients => Ok(gradients.picked((0..rows.len()).rev())),
            _ => Ok(gradients),
        }
    }

    fn step(&self, cloud: &mut R::Cloud, gradients: &R::Gradients, rates: &AdamRates) -> Result<(), Error> {
        self.inner.step(cloud, gradients, rates)
    }

    fn train_step(
        &self,
        cloud: &mut R::Cloud,
        view: &S::View,
        target: &R::Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        let usual = S::adam().at(0.0);
        let replaced = self.is(TakesAnyRates) && step.rates.validate().is_err();
        let rates = if replaced { &usual } else { step.rates };
        let settings = self.altered(step.settings);
        self.inner.train_step(cloud, view, target, &TrainStep { settings: &settings, rates, ..*step })?;
        if self.is(Creeps) {
            self.inner.shift_means(cloud, &vec![1e-3; S::DIMENSIONS * self.inner.len(cloud)])?;
        }
        Ok(())
    }

    fn losses(&self, cloud: &mut R::Cloud, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        self.inner.losses(cloud, wait, losses)?;
        match self.fault {
            LosesItsLosses => losses.truncate(100),
            LosesItsLoss if losses.len() > 100 => losses[100] = f32::NAN,
            _ => {}
        }
        Ok(())
    }

    fn unread_losses<'c>(&self, cloud: &'c mut R::Cloud) -> &'c mut Vec<f32> {
        self.inner.unread_losses(cloud)
    }

    fn solve_colors(
        &self,
        cloud: &mut R::Cloud,
        view: &S::View,
        target: &R::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        self.inner.solve_colors(cloud, view, target, settings, iterations)
    }

    fn statistics(&self, cloud: &R::Cloud) -> Result<DensityStatistics, Error> {
        self.inner.statistics(cloud)
    }

    fn edit(&self, cloud: &mut R::Cloud, plan: &EditPlan<S::Gaussian>) -> Result<(), Error> {
        self.inner.edit(cloud, plan)
    }
}
