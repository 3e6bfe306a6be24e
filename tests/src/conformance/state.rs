//! Cases: what goes to the backend comes back, scenes and whole states.

use gs_core::{
    Binning, Error, Gaussian2d, Parameterization, Rasterizer, Scene, Scene2d, SplatsState, TrainStep,
    effects::{Blend, Statistics},
};

use super::{LOSSES, losses_of, parameterizations};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind},
    subject::Subject,
};

/// A scene that is uploaded and downloaded is the same: bit for bit where the parameterization has its parameters, in covariance where not.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn scenes_come_back<R: Rasterizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for (blend, kind) in [(Blend::Sum, Kind::Typical), (Blend::Over, Kind::Opaque), (Blend::Over, Kind::Needles)] {
        let scene = Draw::new(kind, blend, 37, (40, 30), 1000).scene;
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        Failure::unless(rasterizer.len(&splats) == 37, || format!("{} of 37 Gaussians", rasterizer.len(&splats)))?;
        let back = rasterizer.download(&splats)?;
        Failure::unless(back == scene, || format!("{kind:?}: the scene that comes back is another"))?;

        let back = rasterizer.download(&rasterizer.upload(&scene, Parameterization::CovarianceFactor)?)?;
        Failure::unless(back.len() == 37, || format!("{} of 37 Gaussians in covariance factors", back.len()))?;
        for (i, (a, b)) in scene.iter().zip(back.iter()).enumerate() {
            let same = (a.mean, a.color, a.opacity_logit) == (b.mean, b.color, b.opacity_logit);
            Failure::unless(same && same_shape(&a, &b), || {
                format!("{kind:?}: Gaussian {i} was {a:?}, came back as {b:?}")
            })?;
        }
    }
    let empty = rasterizer.upload(&Scene2d::default(), Parameterization::ScaleRotation)?;
    Failure::unless(rasterizer.download(&empty)?.is_empty(), || "an empty scene comes back with Gaussians".to_owned())
}

/// Whether two covariances are the same, seen from the frame of the first.
fn same_shape(a: &Gaussian2d, b: &Gaussian2d) -> bool {
    let frame = a.factor().as_dmat2();
    let whitened = frame.inverse() * b.factor().as_dmat2();
    (whitened * whitened.transpose()).abs_diff_eq(glam::DMat2::IDENTITY, 1e-4)
}

/// A saved state, restored, is the same state, and trains on bit for bit as if it had never been saved.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn restored_splats_continue_bit_for_bit<S: Subject, R: Rasterizer<S>>(rasterizer: &R) -> Result<(), Failure> {
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
                    rasterizer.train_step(&mut splats, &draw.view, &target, &step)?;
                }
                losses_of(rasterizer, &mut splats)?;
                let state = rasterizer.save(&splats)?;
                check_moments(&state)?;
                let mut twin = rasterizer.restore(&state)?;
                let place = || format!("{parameterization:?}, {blend:?}, {loss:?}");
                Failure::unless(rasterizer.save(&twin)? == state, || {
                    format!("{}: restored is another state", place())
                })?;
                for _ in 0..3 {
                    rasterizer.train_step(&mut splats, &draw.view, &target, &step)?;
                    rasterizer.train_step(&mut twin, &draw.view, &target, &step)?;
                }
                let (a, b) = (losses_of(rasterizer, &mut splats)?, losses_of(rasterizer, &mut twin)?);
                let same = a.len() == 3 && a.iter().map(|v| v.to_bits()).eq(b.iter().map(|v| v.to_bits()));
                Failure::unless(same, || format!("{}: losses {a:?} and {b:?}", place()))?;
                let (state, twin) = (rasterizer.save(&splats)?, rasterizer.save(&twin)?);
                let different = state.tensors.iter().find(|(name, tensor)| twin.tensors.get(*name) != Some(tensor));
                Failure::unless(different.is_none(), || {
                    let names = different.iter().map(|(name, _)| name.as_str()).collect::<String>();
                    format!("{}: three steps after it was restored, the splats' `{names}` is another", place())
                })?;
            }
        }
    }
    Ok(())
}

/// A state that says that nothing has been learned would make the comparison of two of them meaningless.
fn check_moments(state: &SplatsState) -> Result<(), Failure> {
    for name in ["moment1", "moment2"] {
        let any = state.matrix(name)?.1.iter().any(|&v| v != 0.0);
        Failure::unless(any, || format!("after three steps `{name}` is all zero"))?;
    }
    let steps = state.integers("steps")?;
    Failure::unless(steps.iter().all(|&s| s == 3), || format!("after three steps the counts are {steps:?}"))
}

/// `shift_means` adds to the means and leaves all else of the state bit for bit, losses that nobody has asked for included; shifts of another
/// number of Gaussians are refused.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn shifts_move_means_and_nothing_else<S: Subject, R: Rasterizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for parameterization in parameterizations::<S, R>(rasterizer)? {
        let mut draw = S::typical(Blend::Over, 9, (34, 20), 1151);
        draw.settings.effects.statistics = Statistics::MeanGradient;
        let target = rasterizer.upload_target(&draw.target()?)?;
        let rates = S::adam().at(0.0);
        let step = TrainStep { settings: &draw.settings, loss: LOSSES[0], rates: &rates, binning: Binning::Fresh };
        let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
        rasterizer.train_step(&mut splats, &draw.view, &target, &step)?;
        let before = rasterizer.save(&splats)?;
        let shifts: Vec<f32> = (0..9 * S::DIMENSIONS).map(|i| 0.01 * i as f32 - 0.1).collect();
        rasterizer.shift_means(&mut splats, &shifts)?;
        let mut expected = before.clone();
        expected.shift("mean", &shifts)?;
        let found = rasterizer.save(&splats)?;
        Failure::unless(found == expected && found != before, || {
            format!("{parameterization:?}: more or less than means moved")
        })?;
        let told = losses_of(rasterizer, &mut splats)?.len();
        Failure::unless(told == 1, || format!("{parameterization:?}: {told} losses of one step after a shift"))?;

        // What is seen after a shift is the shifted scene.
        let scene = rasterizer.download(&splats)?;
        let fresh = rasterizer.upload(&scene, parameterization)?;
        let image =
            |splats| rasterizer.forward(splats, &draw.view, &draw.settings).and_then(|frame| rasterizer.image(&frame));
        let same = (image(&splats)?.pixels().as_flattened().iter())
            .zip(image(&fresh)?.pixels().as_flattened())
            .all(|(a, b)| (a - b).abs() < 1e-4);
        Failure::unless(same, || format!("{parameterization:?}: a shifted splats does not look like its scene"))?;
        let refused =
            matches!(rasterizer.shift_means(&mut splats, &shifts[S::DIMENSIONS..]), Err(Error::Length { .. }));
        Failure::unless(refused && rasterizer.save(&splats)? == expected, || {
            format!("{parameterization:?}: shifts of 8 Gaussians are accepted for 9")
        })?;
    }
    Ok(())
}
