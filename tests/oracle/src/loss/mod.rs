//! The losses and their derivatives with respect to the image, in `f64`.

mod ssim;

use gs_core::{Image, Loss};

use self::ssim::Channel;
use super::rounded::F32_ROUNDING;

/// The derivatives of a loss by the image, v_C = ∂L/∂C.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LossSlopes {
    /// `[H · W]`.
    pub(crate) v_color: Vec<[f64; 3]>,
    /// Uncertainty of `v_color` in `f32`, in roundings.
    pub(crate) v_rounding: Vec<[f64; 3]>,
}

/// The value of `loss` for an image of `width` columns.
pub(crate) fn value(loss: &Loss, width: usize, image: &[[f64; 3]], target: &Image) -> f64 {
    let count = image.len() as f64 * 3.0;
    let pairs = || image.as_flattened().iter().zip(target.pixels().as_flattened());
    let differences = || pairs().map(|(rendered, &target)| rendered - f64::from(target));
    match *loss {
        Loss::L2 => differences().map(|d| d * d).sum::<f64>() / count,
        Loss::L1 => differences().map(f64::abs).sum::<f64>() / count,
        Loss::L1Dssim { lambda } => {
            let lambda = f64::from(lambda);
            let rounding = vec![[0.0; 3]; image.len()];
            let ssim: f64 = Planes::of(image, &rounding, target).iter().map(|p| p.channel(width).sum_of_ssim()).sum();
            (1.0 - lambda) * value(&Loss::L1, width, image, target) + lambda * (1.0 - ssim / count)
        }
    }
}

/// The derivatives of `loss` by an image of `width` columns with an uncertainty of `rounding`.
///
/// At the kink of |C − Y|, it uses a C that is `lean` roundings brighter.
pub(crate) fn slopes(
    loss: &Loss,
    width: usize,
    image: &[[f64; 3]],
    rounding: &[[f64; 3]],
    target: &Image,
    lean: f64,
) -> LossSlopes {
    let count = image.len() as f64 * 3.0;
    let wanted = target.pixels();
    let difference = |p: usize, k: usize| image[p][k] - f64::from(wanted[p][k]);
    let each = |f: &dyn Fn(usize, usize) -> f64| -> Vec<[f64; 3]> {
        (0..image.len()).map(|p| [0, 1, 2].map(|k| f(p, k))).collect()
    };
    let sign = |v: f64| if v > 0.0 { 1.0 } else { -f64::from(u8::from(v < 0.0)) };
    let slope = |p: usize, k: usize| sign(difference(p, k) + lean * (rounding[p][k] + F32_ROUNDING));
    match *loss {
        Loss::L2 => LossSlopes {
            v_color: each(&|p, k| 2.0 * difference(p, k) / count),
            v_rounding: each(&|p, k| 2.0 * (rounding[p][k] + F32_ROUNDING * f64::from(wanted[p][k]).abs()) / count),
        },
        Loss::L1 => LossSlopes { v_color: each(&|p, k| slope(p, k) / count), v_rounding: vec![[0.0; 3]; image.len()] },
        Loss::L1Dssim { lambda } => {
            let lambda = f64::from(lambda);
            let solved = Planes::of(image, rounding, target).map(|planes| planes.channel(width).derivative());
            LossSlopes {
                v_color: each(&|p, k| ((1.0 - lambda) * slope(p, k) - lambda * solved[k][p].0) / count),
                v_rounding: each(&|p, k| lambda * solved[k][p].1 / count),
            }
        }
    }
}

struct Planes {
    rendered: Vec<f64>,
    target: Vec<f64>,
    rounding: Vec<f64>,
}

impl Planes {
    /// The three channels.
    fn of(image: &[[f64; 3]], rounding: &[[f64; 3]], target: &Image) -> [Self; 3] {
        [0, 1, 2].map(|k| Self {
            rendered: image.iter().map(|p| p[k]).collect(),
            target: target.pixels().iter().map(|p| f64::from(p[k])).collect(),
            rounding: rounding.iter().map(|p| p[k]).collect(),
        })
    }

    fn channel(&self, width: usize) -> Channel<'_> {
        Channel {
            width,
            height: self.rendered.len() / width,
            rendered: &self.rendered,
            target: &self.target,
            rounding: &self.rounding,
        }
    }
}
