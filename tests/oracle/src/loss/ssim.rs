//! The SSIM map with zero-padded borders and its derivative, in `f64`, one window at a time (Wang
//! et al. 2004, as 3DGS uses it).

use gs_core::constants::{SSIM_C1, SSIM_C2, SSIM_SIGMA, SSIM_WINDOW};

use crate::rounded::F32_ROUNDING;

/// Roundings of one convolution.
const OPERATIONS: f64 = 4.0;

const RADIUS: isize = (SSIM_WINDOW / 2) as isize;

/// One channel of two images, row-major.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Channel<'a> {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// The image that the derivative is with respect to.
    pub(crate) rendered: &'a [f64],
    /// The other image.
    pub(crate) target: &'a [f64],
    /// Uncertainty of `rendered`.
    pub(crate) rounding: &'a [f64],
}

/// The weighted means of x, y, x², y² and xy under one window.
struct Moments([f64; 5]);

impl Moments {
    /// The factors of SSIM = (2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2)).
    fn factors(&self) -> [f64; 4] {
        let Self([ex, ey, exx, eyy, exy]) = *self;
        let (c1, c2) = (f64::from(SSIM_C1), f64::from(SSIM_C2));
        let (a1, a2) = (2.0 * ex * ey + c1, 2.0 * (exy - ex * ey) + c2);
        [a1, a2, ex * ex + ey * ey + c1, exx - ex * ex + eyy - ey * ey + c2]
    }

    fn ssim(&self) -> f64 {
        let [a1, a2, b1, b2] = self.factors();
        a1 * a2 / (b1 * b2)
    }
}

/// The derivative of SSIM under one window by a pixel x of weight w:
/// ∂SSIM/∂x = w (luminance + own (x − μx) + other (y − μy)).
#[derive(Debug, Clone, Copy)]
struct Slopes {
    means: [f64; 2],
    luminance: f64,
    own: f64,
    other: f64,
    /// Relative rounding of the three. Variances are differences of moments, which cancel where the
    /// image is flat.
    rounding: f64,
}

/// The window: exp(−r²/2σ²), 11×11, of sum 1.
fn window() -> Vec<(isize, isize, f64)> {
    let variance = f64::from(SSIM_SIGMA).powi(2);
    let mut taps = Vec::new();
    for dy in -RADIUS..=RADIUS {
        for dx in -RADIUS..=RADIUS {
            taps.push((dx, dy, (-((dx * dx + dy * dy) as f64) / (2.0 * variance)).exp()));
        }
    }
    let sum: f64 = taps.iter().map(|tap| tap.2).sum();
    taps.iter_mut().for_each(|tap| tap.2 /= sum);
    taps
}

impl Channel<'_> {
    /// The pixels of the image under the window centred at `index`.
    fn under<'w>(
        &self,
        window: &'w [(isize, isize, f64)],
        index: usize,
    ) -> impl Iterator<Item = (usize, f64)> + use<'w> {
        let (width, height) = (self.width as isize, self.height as isize);
        let (x, y) = ((index % self.width) as isize, (index / self.width) as isize);
        window.iter().filter_map(move |&(dx, dy, w)| {
            let inside = (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy));
            inside.then(|| (((y + dy) * width + x + dx) as usize, w))
        })
    }

    fn moments(&self, window: &[(isize, isize, f64)], index: usize) -> Moments {
        let mut sums = [0.0; 5];
        for (i, w) in self.under(window, index) {
            let (x, y) = (self.rendered[i], self.target[i]);
            [x, y, x * x, y * y, x * y].iter().zip(&mut sums).for_each(|(moment, sum)| *sum += w * moment);
        }
        Moments(sums)
    }

    /// Σ SSIM over the pixels.
    pub(crate) fn sum_of_ssim(&self) -> f64 {
        let window = window();
        (0..self.rendered.len()).map(|index| self.moments(&window, index).ssim()).sum()
    }

    /// The terms of the derivative, of the window at each pixel.
    fn slopes(&self, window: &[(isize, isize, f64)]) -> Vec<Slopes> {
        let slopes_at = |index: usize| {
            let moments = self.moments(window, index);
            let Moments([ex, ey, exx, eyy, _]) = moments;
            // Where x is off by δ, μx is by E[δ], σx² by 2 E[(x − μx) δ] and σxy by E[(y − μy) δ].
            let (mut mean_rounding, mut variance_rounding) = (0.0, 0.0);
            for (i, w) in self.under(window, index) {
                mean_rounding += w * self.rounding[i];
                let spread = (self.rendered[i] - ex).abs() + (self.target[i] - ey).abs();
                variance_rounding += 2.0 * w * self.rounding[i] * spread;
            }
            let ([a1, a2, b1, b2], s) = (moments.factors(), moments.ssim());
            Slopes {
                means: [ex, ey],
                luminance: 2.0 * ey * a2 / (b1 * b2) - 2.0 * ex * s / b1,
                own: -2.0 * s / b2,
                other: 2.0 * a1 / (b1 * b2),
                rounding: OPERATIONS * F32_ROUNDING * (1.0 + (exx + eyy) / b2)
                    + variance_rounding / b2
                    + 2.0 * mean_rounding * (ex.abs() + ey.abs()) / b1,
            }
        };
        (0..self.rendered.len()).map(slopes_at).collect()
    }

    /// ∂(Σ SSIM)/∂(rendered) at every pixel, and its uncertainty.
    pub(crate) fn derivative(&self) -> Vec<(f64, f64)> {
        let window = window();
        let slopes = self.slopes(&window);
        (0..self.rendered.len())
            .map(|p| {
                let (x, y) = (self.rendered[p], self.target[p]);
                let (mut value, mut rounding) = (0.0, 0.0);
                // The window is symmetric, so the windows that contain p are centred in p's window.
                for (q, w) in self.under(&window, p) {
                    let Slopes { means: [mx, my], luminance, own, other, rounding: relative } = slopes[q];
                    let terms = [luminance, own * (x - mx), other * (y - my)];
                    value += w * terms.iter().sum::<f64>();
                    // Uncentred moments have the rounding of their sums before the means are
                    // subtracted.
                    let raw = own.abs() * (x.abs() + mx.abs()) + other.abs() * (y.abs() + my.abs());
                    rounding += w
                        * (relative * terms.iter().map(|v| v.abs()).sum::<f64>()
                            + OPERATIONS * F32_ROUNDING * raw
                            + own.abs() * self.rounding[p]);
                }
                (value, rounding)
            })
            .collect()
    }
}
