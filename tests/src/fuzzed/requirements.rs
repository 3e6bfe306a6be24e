//! Requirements that a backend must meet for every drawn scene.

use gs_core::{
    Error, Image, Optimizer, RenderSettings, Scene2d, Scene3d, TrainStep, Wait,
    constants::MIN_QUATERNION_NORM2,
    effects::{Blend, Order},
};
use pollster::FutureExt as _;

use super::draw::Fuzzed;
use crate::{bits::bits, failure::Failure, subject::Subject};

/// Number of training steps of each drawn scene.
const STEPS: usize = 3;

/// Largest moderate number, and the inverse of the smallest. Results of moderate numbers must be
/// finite.
const MODERATE: f32 = 1e4;

/// Largest magnitude of the logarithm of a moderate scale.
const MODERATE_LOG: f32 = 12.0;

/// Relative rounding by which a mixture may exceed its bounds.
const ROUNDING: f64 = 1e-3;

/// Upper bound of |Y| of the SH up to degree 3.
const HIGHEST_HARMONIC: f64 = 1.1;

/// A kind of scene whose pixels have known bounds.
pub trait Bounded: Subject {
    /// The largest magnitude of each Gaussian's colour in any direction.
    fn largest_colors(&self) -> Vec<f64>;

    /// Whether all parameters except opacities are moderate.
    fn is_moderate(&self) -> bool;

    /// Whether all numbers of a view are moderate.
    fn view_is_moderate(view: &Self::View) -> bool;

    /// Columns and rows.
    fn size(view: &Self::View) -> (u32, u32);
}

fn all_moderate(values: impl IntoIterator<Item = f32>) -> bool {
    values.into_iter().all(|value| value.abs() <= MODERATE)
}

impl Bounded for Scene2d {
    fn largest_colors(&self) -> Vec<f64> {
        self.colors.iter().map(|color| f64::from(color.abs().max_element())).collect()
    }

    fn is_moderate(&self) -> bool {
        let scales = self.log_scales.iter().all(|log| log.abs().max_element() <= MODERATE_LOG);
        let means = self.means.iter().flat_map(|mean| mean.to_array());
        let colors = self.colors.iter().flat_map(|color| color.to_array());
        scales && all_moderate(means.chain(colors).chain(self.rotations.iter().copied()))
    }

    fn view_is_moderate(view: &Self::View) -> bool {
        let (scale, origin) = (view.scale(), view.origin);
        all_moderate([scale.x, scale.y, 1.0 / scale.x, 1.0 / scale.y, origin.x, origin.y])
    }

    fn size(view: &Self::View) -> (u32, u32) {
        (view.width, view.height)
    }
}

impl Bounded for Scene3d {
    fn largest_colors(&self) -> Vec<f64> {
        let largest = |sh: &[glam::Vec3]| {
            let sum: f64 = sh.iter().map(|value| f64::from(value.abs().max_element())).sum();
            0.5 + HIGHEST_HARMONIC * sum
        };
        self.sh.chunks(self.sh_len()).map(largest).collect()
    }

    fn is_moderate(&self) -> bool {
        let scales = self.log_scales.iter().all(|log| log.abs().max_element() <= MODERATE_LOG);
        let vectors = self.means.iter().chain(&self.sh).flat_map(|v| v.to_array());
        // A zero quaternion has no covariance factor. It becomes NaN, which draws nothing, is
        // counted and pruned.
        let turned = self.rotations.iter().all(|q| q.iter().map(|v| v * v).sum::<f32>() >= MIN_QUATERNION_NORM2);
        turned && scales && all_moderate(vectors.chain(self.rotations.iter().flatten().copied()))
    }

    fn view_is_moderate(view: &Self::View) -> bool {
        let (focal, translation) = (view.focal, view.translation);
        let lens = [focal.x, focal.y, 1.0 / focal.x, 1.0 / focal.y, view.center.x, view.center.y, 1.0 / view.near];
        all_moderate(lens.into_iter().chain(translation.to_array()))
    }

    fn size(view: &Self::View) -> (u32, u32) {
        (view.width, view.height)
    }
}

/// Checks a backend with a drawn scene: it accepts valid input and refuses invalid input, renders,
/// differentiates, trains for a few steps, saves and restores.
///
/// # Errors
/// [`Failure::Broken`] for a wrong outcome; [`Failure::Backend`] for an unexpected error.
pub fn check_backend<S: Bounded, R: Optimizer<S>>(rasterizer: &R, drawn: &Fuzzed<S>) -> Result<(), Failure> {
    let Fuzzed { scene, view, settings, target, loss, parameterization, rates, binning } = drawn;
    let is_scene = scene.validate().is_ok();
    let mut splats = match rasterizer.upload(scene, *parameterization) {
        Err(Error::Unsupported { .. }) => return Ok(()),
        uploaded => match accepted("the scene", is_scene, uploaded)? {
            Some(splats) => splats,
            None => return Ok(()),
        },
    };
    let possible = S::check_view(view).is_ok() && settings.validate().is_ok();
    let pass = match rasterizer.forward(&splats, view, settings).block_on() {
        Err(Error::Unsupported { .. }) => return Ok(()),
        pass => match accepted("the view and the settings", possible, pass)? {
            Some(pass) => pass,
            None => return Ok(()),
        },
    };
    let image = rasterizer.image(&pass).block_on()?;
    image_is_sound(scene, S::size(view), settings, &image)?;
    let again = rasterizer.image(&rasterizer.forward(&splats, view, settings).block_on()?).block_on()?;
    Failure::unless(same_bits(&image, &again), || {
        "the same forward pass has different bits the second time".to_owned()
    })?;
    let culled = rasterizer.culled(&pass);
    Failure::unless(culled.total() <= scene.len() as u64, || format!("{culled:?} of {} Gaussians", scene.len()))?;

    let target_on = rasterizer.upload_target(target)?;
    let answer = rasterizer.backward(&splats, pass, &target_on, loss);
    let Some((value, gradients)) = accepted("the loss", loss.validate().is_ok(), answer.block_on())? else {
        return Ok(());
    };
    let derivatives = rasterizer.gradients(&splats, &gradients).block_on()?;
    Failure::unless(derivatives.len() == scene.len(), || format!("{} derivatives", derivatives.len()))?;
    let moderate = scene.is_moderate() && S::view_is_moderate(view) && all_moderate(settings.background_color());
    if moderate {
        Failure::unless(value.is_finite() && value >= 0.0, || format!("the loss is {value}"))?;
        Failure::unless(derivatives.validate().is_ok(), || format!("derivatives: {:?}", derivatives.validate()))?;
    }
    let step = TrainStep { settings, loss: *loss, rates, binning: *binning };
    for _ in 0..STEPS {
        rasterizer.train_step(&mut splats, view, &target_on, &step).block_on()?;
    }
    let mut losses = Vec::new();
    rasterizer.losses(&mut splats, Wait::All, &mut losses).block_on()?;
    Failure::unless(losses.len() == STEPS, || format!("{} losses of {STEPS} steps", losses.len()))?;
    let trained = rasterizer.download(&splats).block_on()?;
    Failure::unless(trained.len() == scene.len(), || "training changed the number of Gaussians".to_owned())?;
    if moderate {
        Failure::unless(trained.validate().is_ok(), || format!("after {STEPS} steps: {:?}", trained.validate()))?;
    }
    let state = rasterizer.save(&splats).block_on()?;
    let restored = rasterizer.save(&rasterizer.restore(&state)?).block_on()?;
    Failure::unless(state.parameterization == restored.parameterization && bits(&state) == bits(&restored), || {
        "a restored state is another".to_owned()
    })
}

/// The result of a call that must succeed or be refused; `None` if it was refused as it must be.
fn accepted<T>(what: &str, possible: bool, answer: Result<T, Error>) -> Result<Option<T>, Failure> {
    match (possible, answer) {
        (true, answer) => Ok(Some(answer?)),
        (false, Err(_)) => Ok(None),
        (false, Ok(_)) => Err(Failure::Broken(format!("{what} should have been refused"))),
    }
}

/// Checks the bounds of an image: under [`Blend::Over`] every pixel is a mixture of colours and
/// background, under [`Blend::Sum`] a sum of parts of the colours.
///
/// # Errors
/// [`Failure::Broken`] for the first pixel that is NaN or out of bounds.
pub fn image_is_sound<S: Bounded>(
    scene: &S,
    size: (u32, u32),
    settings: &RenderSettings,
    image: &Image,
) -> Result<(), Failure> {
    Failure::unless(image.size() == size, || format!("the image is of {:?} px, not {size:?}", image.size()))?;
    let background =
        settings.background_color().into_iter().fold(0.0, |largest: f64, v| largest.max(f64::from(v.abs())));
    let colors = scene.largest_colors();
    let bound = match settings.effects.blend {
        Blend::Sum => background + colors.iter().sum::<f64>(),
        Blend::Over => colors.into_iter().fold(background, f64::max),
    };
    // No bound exists for sums of numbers that are nearly infinite.
    if bound >= f64::from(f32::MAX) / 64.0 {
        return Ok(());
    }
    let bound = bound * (1.0 + ROUNDING);
    let outside = image.pixels().as_flattened().iter().position(|value| !(f64::from(value.abs()) <= bound));
    match outside {
        None => Ok(()),
        Some(at) => {
            let (value, order) = (image.pixels().as_flattened()[at], settings.effects.order);
            let kind = if order == Order::PerPixel { " by depth at each pixel" } else { "" };
            Err(Failure::Broken(format!("value {at} of the image{kind} is {value}, beyond ±{bound}")))
        }
    }
}

fn same_bits(a: &Image, b: &Image) -> bool {
    let bits = |image: &Image| image.pixels().as_flattened().iter().map(|v| v.to_bits()).collect::<Vec<u32>>();
    bits(a) == bits(b)
}
