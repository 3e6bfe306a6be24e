//! Cases of upload and download, of saving and restoring, and of noise.

use gs_core::{
    Binning, Error, Gaussian2d, MeanNoise, Optimizer, Parameterization, Scene, Scene2d, SplatsState, TrainStep,
    effects::{Blend, Statistics},
    logit,
};
use pollster::FutureExt as _;

use super::{LOSSES, losses_of, parameterizations};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind2d},
    subject::Subject,
};

/// Upload and download return the same scene: the same bits if the parameterization is that of
/// scenes, else the same covariances.
pub(crate) fn scenes_come_back<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for (blend, kind) in [(Blend::Sum, Kind2d::Typical), (Blend::Over, Kind2d::Opaque), (Blend::Over, Kind2d::Needles)]
    {
        let scene = Draw::new(kind, blend, 37, (40, 30), 1000).scene;
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        Failure::unless(rasterizer.len(&splats) == 37, || format!("{} of 37 Gaussians", rasterizer.len(&splats)))?;
        let back = rasterizer.download(&splats).block_on()?;
        Failure::unless(back == scene, || format!("{kind:?}: the downloaded scene differs"))?;

        let back = rasterizer.download(&rasterizer.upload(&scene, Parameterization::CovarianceFactor)?).block_on()?;
        Failure::unless(back.len() == 37, || format!("{} of 37 Gaussians in covariance factors", back.len()))?;
        for (i, (a, b)) in scene.iter().zip(back.iter()).enumerate() {
            let same = (a.mean, a.color, a.opacity_logit) == (b.mean, b.color, b.opacity_logit);
            Failure::unless(same && same_shape(&a, &b), || {
                format!("{kind:?}: Gaussian {i} was {a:?}, came back as {b:?}")
            })?;
        }
    }
    let empty = rasterizer.upload(&Scene2d::default(), Parameterization::ScaleRotation)?;
    Failure::unless(rasterizer.download(&empty).block_on()?.is_empty(), || {
        "an empty scene has Gaussians after download".to_owned()
    })
}

/// Whether two covariances are equal in the whitened coordinates of the first.
fn same_shape(a: &Gaussian2d, b: &Gaussian2d) -> bool {
    let factor = a.factor().as_dmat2();
    let whitened = factor.inverse() * b.factor().as_dmat2();
    (whitened * whitened.transpose()).abs_diff_eq(glam::DMat2::IDENTITY, 1e-4)
}

/// Saving and restoring keeps all bits of the state, and of later training steps.
pub(crate) fn restored_splats_continue_bit_for_bit<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for parameterization in parameterizations::<S, R>(rasterizer)? {
        for blend in [Blend::Sum, Blend::Over] {
            for loss in LOSSES {
                let mut draw = S::typical(blend, 25, (34, 20), 1103);
                draw.settings.effects.statistics = Statistics::MeanGradient;
                let target = rasterizer.upload_target(&draw.target()?)?;
                let rates = S::adam().at(0.0);
                let step = TrainStep { settings: &draw.settings, loss, rates: &rates, binning: Binning::Fresh };
                let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
                for _ in 0..3 {
                    rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
                }
                losses_of(rasterizer, &mut splats)?;
                let state = rasterizer.save(&splats).block_on()?;
                check_moments(&state)?;
                let mut twin = rasterizer.restore(&state)?;
                let place = || format!("{parameterization:?}, {blend:?}, {loss:?}");
                Failure::unless(rasterizer.save(&twin).block_on()? == state, || {
                    format!("{}: restored is another state", place())
                })?;
                for _ in 0..3 {
                    rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
                    rasterizer.train_step(&mut twin, &draw.view, &target, &step).block_on()?;
                }
                let (a, b) = (losses_of(rasterizer, &mut splats)?, losses_of(rasterizer, &mut twin)?);
                let same = a.len() == 3 && a.iter().map(|v| v.to_bits()).eq(b.iter().map(|v| v.to_bits()));
                Failure::unless(same, || format!("{}: losses {a:?} and {b:?}", place()))?;
                let (state, twin) = (rasterizer.save(&splats).block_on()?, rasterizer.save(&twin).block_on()?);
                let different = state.tensors.iter().find(|(name, tensor)| twin.tensors.get(*name) != Some(tensor));
                Failure::unless(different.is_none(), || {
                    let names = different.iter().map(|(name, _)| name.as_str()).collect::<String>();
                    format!("{}: three steps after restoring, `{names}` differs", place())
                })?;
            }
        }
    }
    Ok(())
}

/// Fails if a state has no moments: comparing two such states would be meaningless.
fn check_moments(state: &SplatsState) -> Result<(), Failure> {
    for name in ["moment1", "moment2"] {
        let any = state.matrix(name)?.1.iter().any(|&v| v != 0.0);
        Failure::unless(any, || format!("after three steps `{name}` is all zero"))?;
    }
    let steps = state.integers("steps")?;
    Failure::unless(steps.iter().all(|&s| s == 3), || format!("after three steps the counts are {steps:?}"))
}

/// `add_noise` moves the means by [`MeanNoise`], and leaves all other numbers and pending losses
/// unchanged. The result is the same with and without pending steps.
pub(crate) fn noise_moves_means_and_nothing_else<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    let noise = MeanNoise { scale: 0.05, seed: 11, step: 3, fixed: 0 };
    for parameterization in parameterizations::<S, R>(rasterizer)? {
        let mut draw = S::typical(Blend::Over, 9, (34, 20), 1151);
        draw.settings.effects.statistics = Statistics::MeanGradient;
        // Faint Gaussians move; a visible one does not.
        let logits = draw.scene.opacity_logits_mut();
        logits.iter_mut().enumerate().for_each(|(i, value)| *value = logit(0.004 + 0.002 * i as f32));
        logits[8] = logit(0.7);
        let target = rasterizer.upload_target(&draw.target()?)?;
        let rates = S::adam().at(0.0);
        let step = TrainStep { settings: &draw.settings, loss: LOSSES[0], rates: &rates, binning: Binning::Fresh };
        let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
        rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
        let (before, scene) = (rasterizer.save(&splats).block_on()?, rasterizer.download(&splats).block_on()?);
        rasterizer.add_noise(&mut splats, &noise)?;
        let mut found = rasterizer.save(&splats).block_on()?;
        let (_, means) = before.matrix("mean")?;
        let (_, moved) = found.matrix("mean")?;
        let shifts = scene.shifts(&noise);
        let most = shifts.iter().fold(0.0f32, |most, shift| most.max(shift.abs()));
        let at_most = |i: usize| 1e-4 * most + 4.0 * f32::EPSILON * means[i].abs();
        for (i, shift) in shifts.iter().enumerate() {
            Failure::unless((moved[i] - means[i] - shift).abs() <= at_most(i), || {
                format!("{parameterization:?}: number {i} of the means moves by {}, not {shift}", moved[i] - means[i])
            })?;
        }
        found.tensors.insert("mean".to_owned(), before.tensors["mean"].clone());
        Failure::unless(found == before, || format!("{parameterization:?}: noise changes more than means"))?;
        let reported = losses_of(rasterizer, &mut splats)?.len();
        Failure::unless(reported == 1, || format!("{parameterization:?}: {reported} losses of one step after noise"))?;

        let after = |waits: bool| -> Result<SplatsState, Failure> {
            let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
            for step_number in 0..3 {
                rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
                if waits {
                    losses_of(rasterizer, &mut splats)?;
                }
                rasterizer.add_noise(&mut splats, &MeanNoise { step: step_number, ..noise })?;
            }
            Ok(rasterizer.save(&splats).block_on()?)
        };
        Failure::unless(after(true)? == after(false)?, || {
            format!("{parameterization:?}: noise between steps depends on pending steps")
        })?;
        let refused = rasterizer.add_noise(&mut splats, &MeanNoise { scale: f32::NAN, ..noise });
        Failure::unless(matches!(refused, Err(Error::Setting { .. })), || "noise of scale NaN is accepted".to_owned())?;
    }
    Ok(())
}
