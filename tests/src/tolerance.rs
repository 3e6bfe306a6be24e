//! All tolerances with the worst measured cases, and the comparators that use them.
//!
//! The oracle computes the uncertainty of each number by one rounding of `f32` in every operation
//! ([`Rendering::rounding`], [`Gradients::rounding`]). The tolerances are multiples of it: a
//! needle, whose σ is a small difference of large numbers, has a larger tolerance than a disc.
//! Numbers within rounding of a discontinuity may also differ by its height, but only a limited
//! share of them.

use gs_core::{CameraGradient, Image};
pub use gs_oracle::{NEAR_CUT, ROUNDINGS};

use crate::{
    failure::Failure,
    oracle::{Gradients, Parameters, Rendering, ViewGradients},
    subject::Subject,
};

/// Largest share of an image's values that may need the allowance for discontinuities, but at least
/// one pixel. Worst measured: one pixel.
pub const IMAGE_FLIP_SHARE: f64 = 1e-3;

/// Largest share of a scene's gradients that may need the allowance. One pixel moves the gradients
/// of all Gaussians there. Worst measured: 8 of 216, by one pixel with a weight within 2.3e-7,
/// relative, of the cut.
pub const GRADIENT_FLIP_SHARE: f64 = 0.1;

/// Largest norm of the tolerances as a share of the gradient's norm. Beyond it, a comparison is
/// meaningless.
pub const MEANINGFUL_SHARE: f64 = 0.1;

/// The same for the parts of a gradient by the camera, which are sums over all Gaussians that nearly
/// cancel in random scenes.
pub const MEANINGFUL_CAMERA_SHARE: f64 = 0.25;

/// Largest difference of a parameter from Adam in `f64`, as a share of the step size, per step;
/// in addition to one rounding of the parameter itself. gs-cpu is within 1e-5 at every SIMD level.
pub const ADAM_SHARE: f64 = 1e-4;

/// Largest difference of a 3D Gaussian from Adam in `f64` on covariance factors, in whitened
/// coordinates, as a share of the step size, per step; plus 1e-5. It is that of the downloaded
/// gradients, which are by another parameterization.
pub const FRAME_SHARE: f64 = 2e-3;

/// Largest relative difference of the losses, and of the parameters as a share of their movement,
/// between fused training steps and their three stages. gs-cpu is within 2e-5.
pub const FUSED_SHARE: f64 = 2e-4;

/// Largest slope by the colours after solving for those of a weighted target, relative to the slope
/// with the colours that are best without weights.
pub(crate) const WEIGHTED_SLOPE: f32 = 0.01;

/// How near to the least-squares residual `solve_colors` must come, relative to it and, where it is
/// nearly 0, absolutely (mean square, colours of 0 to 1). gs-cpu is within 1e-5 and 1e-9.
pub const LEAST_SQUARES: [f64; 2] = [1e-4, 1e-8];

/// Largest relative difference of a statistic from the sum of downloaded gradients; they may stem
/// from a fused step. gs-cpu is within 1e-5.
pub const STATISTICS_SHARE: f64 = 1e-4;

/// Largest relative difference of a collected statistic from the oracle's, in addition to a thousandth of
/// the largest of the scene. gs-cpu is within 5e-6 at every SIMD level.
pub const COLLECTED_SHARE: f64 = 1e-4;

/// How well two sets of numbers agree.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Agreement {
    /// The largest difference among numbers that are not near a discontinuity, in roundings.
    pub worst_roundings: f64,
    /// The largest difference among these numbers: of images and losses as it is, of a gradient as
    /// a share of the largest one by the same parameter.
    pub worst_share: f64,
    /// How many numbers needed the allowance for discontinuities.
    pub flips: usize,
    /// How many numbers were compared.
    pub compared: usize,
}

impl Agreement {
    /// The worse of two.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            worst_roundings: self.worst_roundings.max(other.worst_roundings),
            worst_share: self.worst_share.max(other.worst_share),
            flips: self.flips + other.flips,
            compared: self.compared + other.compared,
        }
    }
}

/// A number of a comparison.
struct Pair {
    expected: f64,
    found: f64,
    rounding: f64,
    flip: f64,
    /// The size to which a difference is relative.
    scale: f64,
}

/// Compares an image with the oracle's.
///
/// # Errors
/// [`Failure::Nothing`] if the oracle's image shows no Gaussian or the sizes differ;
/// [`Failure::Differs`] with the worst value; [`Failure::TooManyFlips`].
pub fn compare_images(expected: &Rendering, found: &Image) -> Result<Agreement, Failure> {
    if found.size() != (expected.width, expected.height) {
        let sizes = (found.size(), (expected.width, expected.height));
        return Err(Failure::Nothing(format!("images of sizes {:?} and {:?}", sizes.0, sizes.1)));
    }
    if !expected.drawn.contains(&true) {
        return Err(Failure::Nothing("the expected image shows no Gaussian".to_owned()));
    }
    let pairs = found.pixels().iter().enumerate().flat_map(|(p, pixel)| {
        [0, 1, 2].map(|k| Pair {
            expected: expected.pixels[p][k],
            found: f64::from(pixel[k]),
            rounding: expected.rounding[p][k],
            flip: expected.flip[p][k],
            scale: 1.0,
        })
    });
    let width = expected.width as usize;
    compare(pairs, "image values", IMAGE_FLIP_SHARE, |i| {
        format!("pixel ({}, {}), channel {}", i / 3 % width, i / 3 / width, i % 3)
    })
}

/// Compares a backend's gradients with the oracle's.
///
/// # Errors
/// [`Failure::Nothing`] if the oracle's gradients are all zero, of another number of Gaussians, or
/// too uncertain; [`Failure::Differs`] with the worst; [`Failure::TooManyFlips`].
pub fn compare_gradients<S: Subject>(expected: &Gradients, found: &S) -> Result<Agreement, Failure> {
    let found = found.rows_of_gradients();
    let lengths = |rows: &[Parameters]| rows.iter().map(Vec::len).collect::<Vec<_>>();
    if lengths(&found) != lengths(&expected.values) {
        let counts = (found.len(), expected.values.len());
        return Err(Failure::Nothing(format!(
            "gradients of {} and of {} Gaussians, or of other ones",
            counts.0, counts.1
        )));
    }
    let norm = |rows: &[Parameters]| rows.iter().flatten().map(|v| v * v).sum::<f64>().sqrt();
    let size = norm(&expected.values);
    if !(size > 0.0) {
        return Err(Failure::Nothing("the expected gradients are all zero".to_owned()));
    }
    let (rounding, flip) = (ROUNDINGS * norm(&expected.rounding), norm(&expected.flip));
    if !(rounding + flip <= MEANINGFUL_SHARE * size) {
        let text =
            format!("gradients of norm {size:e} with tolerances of {rounding:e} for rounding, {flip:e} for flips");
        return Err(Failure::Nothing(text));
    }
    let largest = |i: usize| expected.values.iter().map(|row| row[i].abs()).fold(f64::MIN_POSITIVE, f64::max);
    let width = found.first().map_or(0, Vec::len);
    let scales: Vec<f64> = (0..width).map(largest).collect();
    let pairs = (0..found.len() * width).map(|i| (i / width, i % width)).map(|(g, i)| Pair {
        expected: expected.values[g][i],
        found: found[g][i],
        rounding: expected.rounding[g][i],
        flip: expected.flip[g][i],
        scale: scales[i],
    });
    compare(pairs, "gradients", GRADIENT_FLIP_SHARE, |i| {
        format!("gradient of Gaussian {}, {}", i / width, S::parameter_name(i % width))
    })
}

/// Compares a backend's gradient by the camera with the oracle's.
///
/// # Errors
/// [`Failure::Nothing`] if the oracle's gradient by translation, rotation, focal length or principal
/// point is zero or too uncertain; [`Failure::Differs`] with the worst; [`Failure::TooManyFlips`].
pub fn compare_camera_gradients(expected: &ViewGradients, found: CameraGradient) -> Result<Agreement, Failure> {
    const PARTS: [(&str, usize); 4] =
        [("translation", 3), ("rotation", 3), ("focal length", 2), ("principal point", 2)];
    let found = found.to_array();
    let mut pairs = Vec::new();
    for (part, count) in PARTS {
        let places = pairs.len()..pairs.len() + count;
        let norm = |numbers: &[f64]| numbers[places.clone()].iter().map(|v| v * v).sum::<f64>().sqrt();
        let (size, flip) = (norm(&expected.values), norm(&expected.flip));
        let rounding = ROUNDINGS * norm(&expected.rounding);
        if !(size > 0.0 && rounding + flip <= MEANINGFUL_CAMERA_SHARE * size) {
            return Err(Failure::Nothing(format!(
                "a gradient by the {part} of norm {size:e} with tolerances of {rounding:e} for rounding, {flip:e} for \
                 flips"
            )));
        }
        pairs.extend(places.map(|i| Pair {
            expected: expected.values[i],
            found: f64::from(found[i]),
            rounding: expected.rounding[i],
            flip: expected.flip[i],
            scale: size,
        }));
    }
    let name = |i: usize| {
        let (part, first) = match i {
            0..3 => ("translation", 0),
            3..6 => ("rotation", 3),
            6..8 => ("focal length", 6),
            _ => ("principal point", 8),
        };
        format!("gradient by the {part} along axis {}", i - first)
    };
    compare(pairs.into_iter(), "gradients by the camera", GRADIENT_FLIP_SHARE, name)
}

/// Compares a backend's loss with the oracle's.
///
/// # Errors
/// [`Failure::Nothing`] if the oracle's loss is 0; [`Failure::Differs`].
pub fn compare_loss(expected: &Gradients, found: f32) -> Result<Agreement, Failure> {
    if !(expected.loss > 0.0) {
        return Err(Failure::Nothing(format!("a loss of {}", expected.loss)));
    }
    let pair = Pair {
        expected: expected.loss,
        found: f64::from(found),
        // A mean over all pixels, added up in `f32`.
        rounding: expected.loss_rounding + expected.loss * f64::from(f32::EPSILON),
        flip: expected.loss_flip,
        scale: 1.0,
    };
    compare([pair].into_iter(), "losses", IMAGE_FLIP_SHARE, |_| "loss".to_owned())
}

/// Smallest rounding: numbers that are subnormal in `f32` may be flushed to 0.
const FLUSHED: f64 = 1e-37;

fn compare(
    pairs: impl Iterator<Item = Pair>,
    what: &'static str,
    flip_share: f64,
    name: impl Fn(usize) -> String,
) -> Result<Agreement, Failure> {
    let mut agreement = Agreement::default();
    let mut worst: Option<(f64, Failure)> = None;
    let mut differing = 0;
    for (i, pair) in pairs.enumerate() {
        agreement.compared += 1;
        let off = (pair.found - pair.expected).abs();
        let rounding = pair.rounding + FLUSHED;
        if pair.flip <= rounding {
            agreement.worst_roundings = agreement.worst_roundings.max(off / rounding);
            agreement.worst_share = agreement.worst_share.max(off / pair.scale);
        }
        if off <= ROUNDINGS * rounding {
            continue;
        }
        let tolerance = ROUNDINGS * rounding + pair.flip;
        if off <= tolerance {
            agreement.flips += 1;
            continue;
        }
        differing += 1;
        let excess = if off.is_nan() { f64::INFINITY } else { off / tolerance };
        if worst.as_ref().is_none_or(|(worst, _)| excess > *worst) {
            let (expected, found) = (pair.expected, pair.found);
            worst = Some((excess, Failure::Differs { what: name(i), expected, found, tolerance, others: 0 }));
        }
    }
    if let Some((_, Failure::Differs { what, expected, found, tolerance, .. })) = worst {
        return Err(Failure::Differs { what, expected, found, tolerance, others: differing - 1 });
    }
    let allowed = ((agreement.compared as f64 * flip_share) as usize).max(3);
    if agreement.flips > allowed {
        let (found, count) = (agreement.flips, agreement.compared);
        return Err(Failure::TooManyFlips { what, found, count, allowed });
    }
    Ok(agreement)
}
