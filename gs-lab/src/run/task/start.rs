//! The gradients of a fit's start: what its image pulls at before the first step.
//!
//! The pull of an image is the difference between the positional gradients with it and with an image
//! of the background only. The gradients that remain on such an image are due to a Gaussian's own
//! colour, which differs from the background below it.

use glam::Vec2;
use gs_backend::FutureExt as _;
use gs_core::{Canvas, Image, Loss, Optimizer, Scene2d, effects::Statistics};
use gs_train::{Error, FitSettings, Trainer};

use crate::study::Column;

/// The columns of `Measure::Start`.
pub(super) fn measure<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    image: &Image,
    settings: &FitSettings,
) -> Result<Vec<(Column, f64)>, Error> {
    let scene = Trainer::new(rasterizer, image, settings.clone()).block_on()?.scene().block_on()?;
    let background = Image::filled(image.width(), image.height(), settings.render.background_color())?;
    let device = Vec2::new(image.width() as f32, image.height() as f32) * 0.5;
    let gradients = |target: &Image, loss: &Loss| gradients(rasterizer, &scene, target, settings, loss);
    let norm = |v: Vec2| f64::from((v * device).length());
    // Gradients are means over all pixels, so both images give the same sums.
    let pulls = |loss: &Loss| {
        let pairs = gradients(image, loss)?.into_iter().zip(gradients(&background, loss)?);
        Ok::<_, Error>(pairs.map(|(with, without)| norm(with - without)).collect::<Vec<_>>())
    };
    let largest = |norms: &[f64]| norms.iter().copied().fold(0.0, f64::max);
    let (by_l1, in_all) = (pulls(&Loss::L1)?, gradients(image, &Loss::L1)?.into_iter().map(norm).collect::<Vec<_>>());
    let pulled = by_l1.iter().filter(|&&pull| pull != 0.0).count();
    Ok(vec![
        (Column::StartPulled, pulled as f64 / by_l1.len() as f64),
        (Column::StartPull, largest(&by_l1)),
        (Column::StartPullOfLoss, largest(&pulls(&settings.loss)?)),
        (Column::StartGradient, largest(&in_all)),
    ])
}

/// ∂L/∂μ of every Gaussian, px⁻¹.
fn gradients<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    scene: &Scene2d,
    target: &Image,
    settings: &FitSettings,
    loss: &Loss,
) -> Result<Vec<Vec2>, Error> {
    let mut render = settings.render;
    render.effects.statistics = Statistics::None;
    let splats = rasterizer.upload(scene, settings.parameterization)?;
    let canvas = Canvas::new(target.width(), target.height());
    let frame = rasterizer.forward(&splats, &canvas, &render).block_on()?;
    let target = rasterizer.upload_target(target)?;
    let (_, gradients) = rasterizer.backward(&splats, frame, &target, loss).block_on()?;
    Ok(rasterizer.gradients(&splats, &gradients).block_on()?.means)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_cpu::{CpuRasterizer, CpuSettings};
    use gs_train::{Init, init::Periphery};

    #[test]
    fn an_image_pulls_only_at_gaussians_that_reach_it() {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let dot =
            Image::from_fn(
                64,
                64,
                |x, y| if (28..36).contains(&x) && (28..36).contains(&y) { [0.0; 3] } else { [1.0; 3] },
            );
        let dot = dot.unwrap();
        let measured = |scale_px: f32| {
            let init = Init::Periphery(Periphery::default().with(|s| s.scale_px = scale_px));
            measure(&cpu, &dot, &FitSettings::paper().with(|s| s.init = init)).unwrap()
        };
        let [small, large] = [1.0, 15.0].map(measured);
        assert_eq!((small[0].1, small[1].1, small[2].1), (0.0, 0.0, 0.0), "{small:?}");
        assert!(small[3].1 > 1e-4, "coloured Gaussians differ from the white below them: {small:?}");
        assert!(large[0].1 > 0.5 && large[1].1 > 0.0 && large[2].1 > 0.0, "{large:?}");
    }
}
