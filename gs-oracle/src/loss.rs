//! The losses and their derivatives with respect to the image, in `f64`.

use gs_core::{Image, Loss};

use super::{
    rounded::F32_ROUNDING,
    ssim::{Channel, Map},
};

/// A loss at an image: its value and v_C = ∂L/∂C.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LossAt {
    pub(crate) value: f64,
    /// `[H · W]`.
    pub(crate) v_color: Vec<[f64; 3]>,
    /// Uncertainty of `v_color` in `f32`, in roundings.
    pub(crate) v_rounding: Vec<[f64; 3]>,
}

/// Evaluates `loss` for an image of `width` columns with an uncertainty of `rounding`.
///
/// At the kink of |C − Y|, it uses a C that is `lean` roundings brighter.
pub(crate) fn evaluate(
    loss: &Loss,
    width: usize,
    image: &[[f64; 3]],
    rounding: &[[f64; 3]],
    target: &Image,
    lean: f64,
) -> LossAt {
    let count = image.len() as f64 * 3.0;
    let target: Vec<[f64; 3]> = target.pixels().iter().map(|p| p.map(f64::from)).collect();
    let difference = |p: usize, k: usize| image[p][k] - target[p][k];
    let each = |f: &dyn Fn(usize, usize) -> f64| -> Vec<[f64; 3]> {
        (0..image.len()).map(|p| [0, 1, 2].map(|k| f(p, k))).collect()
    };
    let mean = |f: &dyn Fn(usize, usize) -> f64| each(f).iter().flatten().sum::<f64>() / count;
    let sign = |v: f64| if v > 0.0 { 1.0 } else { -f64::from(u8::from(v < 0.0)) };
    let slope = |p: usize, k: usize| sign(difference(p, k) + lean * (rounding[p][k] + F32_ROUNDING));
    match *loss {
        Loss::L2 => LossAt {
            value: mean(&|p, k| difference(p, k).powi(2)),
            v_color: each(&|p, k| 2.0 * difference(p, k) / count),
            v_rounding: each(&|p, k| 2.0 * (rounding[p][k] + F32_ROUNDING * target[p][k].abs()) / count),
        },
        Loss::L1 => LossAt {
            value: mean(&|p, k| difference(p, k).abs()),
            v_color: each(&|p, k| slope(p, k) / count),
            v_rounding: vec![[0.0; 3]; image.len()],
        },
        Loss::L1Dssim { lambda } => {
            let lambda = f64::from(lambda);
            let planes = [0, 1, 2].map(|k| Planes {
                rendered: image.iter().map(|p| p[k]).collect(),
                target: target.iter().map(|p| p[k]).collect(),
                rounding: rounding.iter().map(|p| p[k]).collect(),
            });
            let solved: [(Map, Vec<(f64, f64)>); 3] = planes.each_ref().map(|planes| {
                let channel = planes.channel(width);
                let map = channel.map();
                let derivative = channel.derivative(&map);
                (map, derivative)
            });
            let ssim = mean(&|p, k| solved[k].0.ssim[p]);
            LossAt {
                value: (1.0 - lambda) * mean(&|p, k| difference(p, k).abs()) + lambda * (1.0 - ssim),
                v_color: each(&|p, k| ((1.0 - lambda) * slope(p, k) - lambda * solved[k].1[p].0) / count),
                v_rounding: each(&|p, k| lambda * solved[k].1[p].1 / count),
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
