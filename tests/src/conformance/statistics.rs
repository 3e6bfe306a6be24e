//! Cases: the statistics that need sums of their own, against the oracle. A backend may refuse them, but then as
//! [`Error::Unsupported`], in every pass, and with nothing done.

use glam::Vec2;
use gs_core::{
    Adam, Binning, Canvas, Chart, Error, Loss, PlanarScene, Rasterizer, TrainStep,
    adam::Group,
    effects::{Blend, Statistics},
};

use crate::{
    failure::Failure,
    oracle::{Oracle, OracleScene, StepStatistics},
    scenes::{Draw, Kind},
    tolerance::COLLECTED_SHARE,
};

/// [`Statistics::AbsoluteGradient`] sums magnitudes pixel by pixel, for both blends, for losses whose steps are fused or not, and through a
/// canvas of another scale.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn absolute_gradients_match<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    check(rasterizer, Statistics::AbsoluteGradient, |step| &step.absolute_gradient)
}

/// [`Statistics::PixelError`] sums what each pixel shows of a Gaussian times the pixel's error.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn pixel_errors_match<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    check(rasterizer, Statistics::PixelError, |step| &step.pixel_error)
}

fn check<R: Rasterizer<PlanarScene>>(
    rasterizer: &R,
    statistics: Statistics,
    of_step: impl Fn(&StepStatistics) -> &Vec<f64>,
) -> Result<(), Failure> {
    let still = Group::constant(1e-4);
    let adam = Adam { mean: still, scale: still, rotation: still, opacity: still, color: still, ..Adam::default() };
    let rates = adam.at(0.0);
    let own = Canvas::new(37, 70);
    let zoomed = Canvas::new(44, 20).showing(Vec2::new(4.0, 2.0), Vec2::new(22.0, 20.0));
    for (blend, view, loss, kind) in [
        (Blend::Sum, own, Loss::L2, Kind::Typical),
        (Blend::Sum, own, Loss::PAPER, Kind::Typical),
        (Blend::Sum, zoomed, Loss::L2, Kind::Overlapping),
        (Blend::Over, own, Loss::L2, Kind::Overlapping),
        (Blend::Over, own, Loss::PAPER, Kind::Typical),
        (Blend::Over, zoomed, Loss::L1, Kind::Overlapping),
    ] {
        let plane = if view == own { (37, 70) } else { (30, 24) };
        let mut draw = Draw::new(kind, blend, 12, plane, 1650).on([0.3, 0.5, 0.2]).through(view);
        draw.settings.effects.statistics = statistics;
        let place = format!("{statistics:?}, {blend:?}, {loss:?}, {}x{} px", view.width, view.height);
        let image = draw.target()?;
        let target = rasterizer.upload_target(&image)?;
        let mut cloud = rasterizer.upload(&draw.scene, Chart::ScaleRotation)?;
        let step = TrainStep { settings: &draw.settings, loss, rates: &rates, binning: Binning::Fresh };

        let before = rasterizer.save(&cloud)?;
        let frame = match rasterizer.forward(&cloud, &view, &draw.settings) {
            Err(Error::Unsupported { .. }) => {
                let refused = rasterizer.train_step(&mut cloud, &view, &target, &step);
                let right = matches!(refused, Err(Error::Unsupported { .. })) && rasterizer.save(&cloud)? == before;
                return Failure::unless(right, || format!("{place}: refused in a forward pass, but not in a step"));
            }
            other => other?,
        };
        // One step in stages and one whole.
        let oracle = Oracle::new(view, draw.settings)?;
        let mut expected = [0.0; 12];
        let mut drawn = [0u32; 12];
        let (_, gradients) = rasterizer.backward(&cloud, frame, &target, &loss)?;
        for whole in [false, true] {
            let scene = OracleScene::from(&rasterizer.download(&cloud)?);
            let collected = oracle.statistics(&scene, &image, &loss)?;
            for (g, value) in of_step(&collected).iter().enumerate() {
                expected[g] += value;
                drawn[g] += u32::from(collected.pixel_error[g] > 0.0);
            }
            if whole {
                rasterizer.train_step(&mut cloud, &view, &target, &step)?;
            } else {
                rasterizer.step(&mut cloud, &gradients, &rates)?;
            }
        }
        let found = rasterizer.statistics(&cloud)?;
        let largest = expected.iter().fold(0.0f64, |m, v| m.max(*v));
        if !(largest > 0.0) || drawn.iter().filter(|&&n| n == 2).count() < 8 {
            return Err(Failure::Nothing(format!("{place}: hardly a Gaussian is drawn: {drawn:?}")));
        }
        for (g, (a, &b)) in expected.iter().zip(&found.gradient_sum).enumerate() {
            let tolerance = COLLECTED_SHARE * (a + 1e-3 * largest);
            if !((a - f64::from(b)).abs() <= tolerance) {
                let what = format!("{place}: statistic of Gaussian {g}");
                return Err(Failure::Differs { what, expected: *a, found: f64::from(b), tolerance, others: 0 });
            }
        }
    }
    Ok(())
}
