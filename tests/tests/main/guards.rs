//! Guards of the arithmetic (`docs/guards.md`) that the corpus does not cover, because only some
//! backends have them.

use glam::{Vec2, Vec3};
use gs_conformance::Failure;
use gs_core::{
    Adam, Binning, Blend, Canvas, Error, Gaussian2d, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene,
    Scene2d, SplatsState, TensorData, TrainStep, adam::Group, constants::MAX_XI, effects::Antialias, metrics,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_density::{Policy, Ranking, WhenFlat};
use gs_train::{FitSettings, InitialCount, Recovery, Rounds, Trainer, fit};
use pollster::FutureExt as _;

/// Runs each of these checks as a test on gs-cpu.
macro_rules! checks {
    ($($(#[$what:meta])* $test:ident: $check:expr;)*) => {
        $($(#[$what])*
        #[test]
        fn $test() {
            // One thread: with images of this size, threads would wait for each other.
            let rasterizer = CpuRasterizer::new(CpuSettings::default().with(|s| {s.threads = Some(1); s.level = None;})).unwrap();
            ($check)(&rasterizer).unwrap_or_else(|failure: Failure| panic!("{failure}"));
        })*
    };
}

checks! {
    /// 1 − SSIM of constant images that are nearly equal, however bright, is within 0 to 2.
    ssim_of_nearly_equal_constants_is_possible: ssim_of_constants;
    /// Gradients are finite through factors that have an area by dilation alone.
    gradients_through_singular_factors_are_finite: singular_factors;
    /// Gradients are finite through factors that have no extent at all along an axis.
    /// Squares of derivatives stay finite.
    second_moments_stay_finite: second_moments;
    /// A step in a covariance factor moves no further than the Gaussian's extent.
    steps_go_no_further_than_a_gaussian_reaches: steps_within_reach;
    /// Moments that no gradient renews do not decay to denormals.
    moments_vanish_before_they_are_denormal: moments_vanish;
    /// An ε of 0 is refused.
    an_epsilon_of_zero_is_refused: epsilon_of_zero;
    /// Gaussians that are not finite are not in the final scene of a fit.
    a_fits_scene_has_no_nonfinite_gaussians: fits_end_finite;
    /// A fit whose Gaussians leave the image ends with no higher loss than at its start.
    fits_end_no_worse_than_they_began: fits_end_no_worse;
    /// A fit whose loss overflows ends with an error.
    an_infinite_loss_ends_a_fit: infinite_losses;
}

#[test]
fn an_infinite_score_is_no_reason_to_grow() {
    let ranking = Ranking::new([(0, f32::INFINITY), (1, 0.5), (2, f32::NAN)], WhenFlat::Nothing);
    assert_eq!(ranking.at_least(0.0), [1]);
}

const SIZE: (u32, u32) = (24, 19);

fn plain(mean: Vec2, log_scale: f32) -> Scene2d {
    let gaussian = Gaussian2d {
        mean,
        log_scale: Vec2::splat(log_scale),
        rotation: 0.4,
        opacity_logit: f32::INFINITY,
        color: Vec3::new(0.7, 0.4, 0.9),
    };
    [gaussian].into_iter().collect()
}

fn target() -> Result<Image, Error> {
    Image::filled(SIZE.0, SIZE.1, [0.5, 0.1, 0.3])
}

/// The numbers of a tensor.
fn floats<'s>(state: &'s mut SplatsState, name: &str) -> Result<&'s mut Vec<f32>, Failure> {
    match state.tensors.get_mut(name).map(|tensor| &mut tensor.data) {
        Some(TensorData::F32(values)) => Ok(values),
        _ => Err(Failure::Broken(format!("a state without {name}"))),
    }
}

fn ssim_of_constants<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let splats = rasterizer.upload(&plain(Vec2::splat(1e4), 1.0), Parameterization::ScaleRotation)?;
    for k in 0..24 {
        let value = 30.0 * 1.7f32.powi(k);
        let settings = RenderSettings::blended(Blend::Sum).on([value; 3]);
        let target = rasterizer.upload_target(&Image::filled(SIZE.0, SIZE.1, [value * 1.001; 3])?)?;
        let factor = rasterizer.forward(&splats, &Canvas::new(SIZE.0, SIZE.1), &settings).block_on()?;
        let (loss, _) = rasterizer.backward(&splats, factor, &target, &Loss::L1Dssim { lambda: 1.0 }).block_on()?;
        let possible = (-1e-3..=2.001).contains(&loss);
        Failure::unless(possible, || format!("1 − SSIM of two images of about {value} everywhere is {loss}"))?;
    }
    Ok(())
}

fn singular_factors<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let mut settings = RenderSettings::blended(Blend::Sum);
    settings.effects.antialias = Antialias::Dilate;
    // The square of e⁻⁶⁰ is 0 in f32.
    let splats = rasterizer.upload(&plain(Vec2::new(8.3, 8.6), -60.0), Parameterization::ScaleRotation)?;
    let factor = rasterizer.forward(&splats, &Canvas::new(SIZE.0, SIZE.1), &settings).block_on()?;
    let target = rasterizer.upload_target(&target()?)?;
    let (_, gradients) = rasterizer.backward(&splats, factor, &target, &Loss::L2).block_on()?;
    let gradients = rasterizer.gradients(&splats, &gradients).block_on()?;
    Ok(gradients.validate()?)
}

fn second_moments<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let mut scene = plain(Vec2::new(8.3, 8.6), 1.0);
    scene.colors[0] = Vec3::splat(1e10);
    let mut splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
    let (settings, rates) = (RenderSettings::blended(Blend::Sum), Adam::default().at(0.0));
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    // Derivatives by the mean are of the size of 10¹⁰ · 10¹⁷.
    let target = rasterizer.upload_target(&Image::filled(SIZE.0, SIZE.1, [1e17; 3])?)?;
    rasterizer.train_step(&mut splats, &Canvas::new(SIZE.0, SIZE.1), &target, &step).block_on()?;
    let after = rasterizer.save(&splats).block_on()?;
    let (_, moments) = after.matrix("moment2")?;
    Failure::unless(moments.iter().all(|moment| moment.is_finite()), || format!("second moments {moments:?}"))
}

fn steps_within_reach<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let before = plain(Vec2::new(8.3, 8.6), 1.0);
    let mut splats = rasterizer.upload(&before, Parameterization::CovarianceFactor)?;
    let adam = Adam::default().with(|s| s.mean = Group::constant(20.0));
    let (settings, rates) = (RenderSettings::blended(Blend::Sum), adam.at(0.0));
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let target = rasterizer.upload_target(&target()?)?;
    rasterizer.train_step(&mut splats, &Canvas::new(SIZE.0, SIZE.1), &target, &step).block_on()?;
    let moved = (rasterizer.download(&splats).block_on()?.means[0] - before.means[0]).length();
    // Both axes are e¹ px. Without the guard, a step is 20 times that.
    let reach = MAX_XI * std::f32::consts::SQRT_2 * 1f32.exp();
    Failure::unless(moved > 0.0 && moved <= 1.001 * reach, || format!("a step of {moved} px, by a reach of {reach} px"))
}

fn moments_vanish<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let settings = RenderSettings::blended(Blend::Sum);
    let mut state = rasterizer
        .save(&rasterizer.upload(&plain(Vec2::splat(1e4), 1.0), Parameterization::ScaleRotation)?)
        .block_on()?;
    // A step reduces these by a tenth, to below the smallest that is kept.
    floats(&mut state, "moment1")?.fill(1.05e-30);
    let mut splats = rasterizer.restore(&state)?;
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let target = rasterizer.upload_target(&target()?)?;
    rasterizer.train_step(&mut splats, &Canvas::new(SIZE.0, SIZE.1), &target, &step).block_on()?;
    let after = rasterizer.save(&splats).block_on()?;
    let (columns, moments) = after.matrix("moment1")?;
    // The last moment is that of the opacity, which this scene does not have.
    let kept = moments[..columns - 1].iter().find(|moment| **moment != 0.0);
    Failure::unless(kept.is_none(), || format!("a moment of {:e} is kept", kept.copied().unwrap_or_default()))
}

fn epsilon_of_zero<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let mut splats = rasterizer.upload(&plain(Vec2::splat(1e4), 1.0), Parameterization::ScaleRotation)?;
    let (settings, rates) = (RenderSettings::blended(Blend::Sum), Adam::default().with(|s| s.epsilon = 0.0).at(0.0));
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let target = rasterizer.upload_target(&target()?)?;
    match rasterizer.train_step(&mut splats, &Canvas::new(SIZE.0, SIZE.1), &target, &step).block_on() {
        Err(Error::Setting { .. }) => Ok(()),
        Err(other) => Err(other.into()),
        Ok(()) => Err(Failure::Broken("accepted, where it must be refused".to_owned())),
    }
}

/// A short fit under `Sum`, with rounds of densification.
fn small_fit() -> FitSettings {
    let initial = InitialCount::Fixed(20);
    let mut settings = FitSettings::for_image(40, SIZE, 25).with(|s| {
        s.initial = initial;
        s.rounds = Rounds::until(10, 20);
    });
    settings.render.effects.blend = Blend::Sum;
    settings
}

fn small_fit_without_rounds() -> FitSettings {
    small_fit().with(|s| {
        s.rounds = Rounds::NEVER;
        s.policy = Policy::None;
        s.parameterization = Parameterization::ScaleRotation;
    })
}

fn fits_end_finite<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    // Gaussians that are not finite are removed at the end with every policy.
    let mut settings = small_fit_without_rounds().with(|s| s.recovery = Recovery::Never);
    // Each step is as large as `f32` allows: after two, means are infinite.
    settings.adam.mean.learning_rate = 2e38;
    let fitted = fit(rasterizer, &target()?, settings, &mut ())
        .block_on()
        .map_err(|error| Failure::Broken(error.to_string()))?;
    Ok(fitted.scene.validate()?)
}

fn fits_end_no_worse<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let mut settings = small_fit_without_rounds().with(|s| s.iterations = 150);
    // Each step is longer than the image, and no gradient leads back.
    settings.adam.mean.learning_rate = 1e3;
    let target = target()?;
    let render = settings.render;
    let (first, last) = Trainer::new(rasterizer, &target, settings)
        .block_on()
        .and_then(|mut trainer| {
            let first = trainer.scene().block_on()?;
            trainer.run(&mut ()).block_on()?;
            Ok((first, trainer.scene().block_on()?))
        })
        .map_err(|error| Failure::Broken(error.to_string()))?;
    let error = |scene: &Scene2d| {
        let image = rasterizer.render(scene, &Canvas::new(SIZE.0, SIZE.1), &render).block_on()?;
        metrics::mean_absolute_error(&image, &target)
    };
    let (first, last) = (error(&first)?, error(&last)?);
    Failure::unless(last <= first, || format!("the mean error was {first} and is {last}"))
}

fn infinite_losses<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let target = Image::filled(SIZE.0, SIZE.1, [1e30; 3])?;
    let fitted = fit(rasterizer, &target, small_fit(), &mut ()).block_on();
    Failure::unless(fitted.is_err(), || "a fit ended well whose loss was infinite".to_owned())
}
