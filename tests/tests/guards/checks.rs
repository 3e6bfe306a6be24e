//! What needs a guard and is no case of the corpus: where only some backends offer it, or where it is none of a backend's.

use glam::{Vec2, Vec3};
use gs_conformance::Failure;
use gs_core::{
    Adam, Binning, Blend, Canvas, Chart, Error, Image, Loss, PlanarGaussian, PlanarScene, Rasterizer, RenderSettings,
    Scene, TrainStep, effects::Antialias, state::TensorData,
};
use gs_density::{Ranking, WhenFlat};
use gs_train::{FitSettings, InitialCount, Rounds, fit};

/// A check, which any backend of planar scenes can be put through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Check {
    /// 1 − SSIM of equal constant images, however bright, is within 0 to 2.
    SsimOfConstants,
    /// Gradients are finite through frames that have an area by dilation alone.
    SingularFrames,
    /// Moments that no gradient renews do not decay to denormals.
    MomentsVanish,
    /// An ε of 0 is refused.
    EpsilonOfZero,
    /// What stops being finite in a fit is not in the scene that comes of it.
    FitsEndFinite,
    /// An infinite score is no reason to grow.
    InfiniteScores,
    /// A fit whose loss overflows ends with an error.
    InfiniteLosses,
}

impl Check {
    /// All of them.
    pub(crate) const ALL: [Self; 7] = [
        Self::SsimOfConstants,
        Self::SingularFrames,
        Self::MomentsVanish,
        Self::EpsilonOfZero,
        Self::FitsEndFinite,
        Self::InfiniteScores,
        Self::InfiniteLosses,
    ];

    /// Its name in the table of guards.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::SsimOfConstants => "SSIM of constants",
            Self::SingularFrames => "singular frames",
            Self::MomentsVanish => "moments vanish",
            Self::EpsilonOfZero => "epsilon of 0",
            Self::FitsEndFinite => "fits end finite",
            Self::InfiniteScores => "infinite scores",
            Self::InfiniteLosses => "infinite losses",
        }
    }

    pub(crate) fn run<R: Rasterizer<PlanarScene>>(self, rasterizer: &R) -> Result<(), Failure> {
        match self {
            Self::SsimOfConstants => ssim_of_constants(rasterizer),
            Self::SingularFrames => singular_frames(rasterizer),
            Self::MomentsVanish => moments_vanish(rasterizer),
            Self::EpsilonOfZero => epsilon_of_zero(rasterizer),
            Self::FitsEndFinite => fits_end_finite(rasterizer),
            Self::InfiniteScores => {
                let ranking = Ranking::new([(0, f32::INFINITY), (1, 0.5), (2, f32::NAN)], WhenFlat::Nothing);
                Failure::unless(ranking.all() == [1], || format!("{:?} are to grow", ranking.all()))
            }
            Self::InfiniteLosses => infinite_losses(rasterizer),
        }
    }
}

const SIZE: (u32, u32) = (24, 19);

fn plain(mean: Vec2, log_scale: f32) -> PlanarScene {
    let gaussian = PlanarGaussian {
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

fn ssim_of_constants<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let cloud = rasterizer.upload(&plain(Vec2::splat(1e4), 1.0), Chart::ScaleRotation)?;
    for k in 0..24 {
        let value = 30.0 * 1.7f32.powi(k);
        let settings = RenderSettings::blended(Blend::Sum).on([value; 3]);
        let target = rasterizer.upload_target(&Image::filled(SIZE.0, SIZE.1, [value; 3])?)?;
        let frame = rasterizer.forward(&cloud, &Canvas::new(SIZE.0, SIZE.1), &settings)?;
        let (loss, _) = rasterizer.backward(&cloud, frame, &target, &Loss::L1Dssim { lambda: 1.0 })?;
        let possible = (-1e-3..=2.001).contains(&loss);
        Failure::unless(possible, || format!("1 − SSIM of two images that are {value} everywhere is {loss}"))?;
    }
    Ok(())
}

fn singular_frames<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let mut settings = RenderSettings::blended(Blend::Sum);
    settings.effects.antialias = Antialias::Dilate;
    // The square of e⁻⁶⁰ is 0 in f32.
    let cloud = rasterizer.upload(&plain(Vec2::new(8.3, 8.6), -60.0), Chart::ScaleRotation)?;
    let frame = rasterizer.forward(&cloud, &Canvas::new(SIZE.0, SIZE.1), &settings)?;
    let target = rasterizer.upload_target(&target()?)?;
    let (_, gradients) = rasterizer.backward(&cloud, frame, &target, &Loss::L2)?;
    let gradients = rasterizer.download_gradients(&cloud, &gradients)?;
    Ok(gradients.validate()?)
}

fn moments_vanish<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let settings = RenderSettings::blended(Blend::Sum);
    let mut state = rasterizer.save(&rasterizer.upload(&plain(Vec2::splat(1e4), 1.0), Chart::ScaleRotation)?)?;
    let Some(TensorData::F32(moments)) = state.tensors.get_mut("moment1").map(|tensor| &mut tensor.data) else {
        return Err(Failure::Broken("a state without moments".to_owned()));
    };
    // A step takes a tenth off, and with it, these are below the least that is kept.
    moments.fill(1.05e-30);
    let mut cloud = rasterizer.restore(&state)?;
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let target = rasterizer.upload_target(&target()?)?;
    rasterizer.train_step(&mut cloud, &Canvas::new(SIZE.0, SIZE.1), &target, &step)?;
    let after = rasterizer.save(&cloud)?;
    let (columns, moments) = after.matrix("moment1")?;
    // The last is that of an opacity, which this scene has not.
    let kept = moments[..columns - 1].iter().find(|moment| **moment != 0.0);
    Failure::unless(kept.is_none(), || format!("a moment of {:e} is kept", kept.copied().unwrap_or_default()))
}

fn epsilon_of_zero<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let mut cloud = rasterizer.upload(&plain(Vec2::splat(1e4), 1.0), Chart::ScaleRotation)?;
    let (settings, rates) = (RenderSettings::blended(Blend::Sum), Adam { epsilon: 0.0, ..Adam::default() }.at(0.0));
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let target = rasterizer.upload_target(&target()?)?;
    match rasterizer.train_step(&mut cloud, &Canvas::new(SIZE.0, SIZE.1), &target, &step) {
        Err(Error::Setting { .. }) => Ok(()),
        Err(other) => Err(other.into()),
        Ok(()) => Err(Failure::Broken("accepted, where it must be refused".to_owned())),
    }
}

/// A short fit under `Sum`, with rounds of densification.
fn small_fit() -> FitSettings {
    let initial = InitialCount::Fixed(20);
    let mut settings = FitSettings { initial, rounds: Rounds::until(10, 20), ..FitSettings::for_image(40, SIZE, 25) };
    settings.render.effects.blend = Blend::Sum;
    settings
}

fn fits_end_finite<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let mut settings = small_fit();
    // Each step is as long as numbers go: after two, means are infinite.
    settings.adam.mean.learning_rate = 2e38;
    let fitted = fit(rasterizer, &target()?, settings, &mut ()).map_err(|error| Failure::Broken(error.to_string()))?;
    Ok(fitted.scene.validate()?)
}

fn infinite_losses<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let target = Image::filled(SIZE.0, SIZE.1, [1e30; 3])?;
    let fitted = fit(rasterizer, &target, small_fit(), &mut ());
    Failure::unless(fitted.is_err(), || "a fit ended well whose loss was infinite".to_owned())
}
