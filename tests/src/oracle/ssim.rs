//! The SSIM map with zero-padded borders and its derivative, in `f64`, one window at a time (Wang et al. 2004, as 3DGS uses it).

use gs_core::constants::{SSIM_C1, SSIM_C2, SSIM_SIGMA, SSIM_WINDOW};

use super::project::F32_ROUNDING;

const RADIUS: isize = (SSIM_WINDOW / 2) as isize;

/// One channel of two images, row-major.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Channel<'a> {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// The image that the derivative is with respect to.
    pub(crate) rendered: &'a [f64],
    /// The other.
    pub(crate) target: &'a [f64],
    /// What rounding may change `rendered` by.
    pub(crate) rounding: &'a [f64],
}

/// SSIM at every pixel of a channel, and what its derivative is made of.
#[derive(Debug, Clone)]
pub(crate) struct Map {
    pub(crate) ssim: Vec<f64>,
    /// ∂SSIM/∂(E[x], E[x²], E[xy]) at every pixel.
    by_moment: Vec<[f64; 3]>,
    /// What rounding may change those by.
    by_moment_rounding: Vec<[f64; 3]>,
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
    /// The pixels under the window centred at `index`; beyond the border there is nothing to add.
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

    /// SSIM = (2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2)) at every pixel.
    pub(crate) fn map(&self) -> Map {
        let window = window();
        let (c1, c2) = (f64::from(SSIM_C1), f64::from(SSIM_C2));
        let count = self.rendered.len();
        let mut map = Map {
            ssim: Vec::with_capacity(count),
            by_moment: Vec::with_capacity(count),
            by_moment_rounding: Vec::with_capacity(count),
        };
        for index in 0..count {
            let [mut ex, mut ey, mut exx, mut eyy, mut exy] = [0.0; 5];
            let (mut ex_rounding, mut exx_rounding) = (0.0, 0.0);
            for (i, w) in self.under(&window, index) {
                let (x, y) = (self.rendered[i], self.target[i]);
                ex += w * x;
                ey += w * y;
                exx += w * x * x;
                eyy += w * y * y;
                exy += w * x * y;
                ex_rounding += w * self.rounding[i];
                exx_rounding += w * self.rounding[i] * (x.abs() + y.abs());
            }
            let (a1, a2) = (2.0 * ex * ey + c1, 2.0 * (exy - ex * ey) + c2);
            let (b1, b2) = (ex * ex + ey * ey + c1, exx - ex * ex + eyy - ey * ey + c2);
            let s = a1 * a2 / (b1 * b2);
            // σxy = E[xy] − μx μy and σx² = E[x²] − μx² depend on μx, too.
            let by_mean =
                [2.0 * ey * a2 / (b1 * b2), -2.0 * ey * a1 / (b1 * b2), -s * 2.0 * ex / b1, s * 2.0 * ex / b2];
            let terms = [by_mean.iter().sum(), -s / b2, 2.0 * a1 / (b1 * b2)];
            map.ssim.push(s);
            map.by_moment.push(terms);
            // Variances come of a difference of moments, which rounding is large against where the image is flat.
            let relative = 8.0 * F32_ROUNDING * (1.0 + (exx + eyy) / b2)
                + 2.0 * exx_rounding / b2
                + 2.0 * ex_rounding * (ex.abs() + ey.abs()) / b1;
            let sizes = [by_mean.iter().map(|v| v.abs()).sum::<f64>(), (s.abs() + 1e-3) / b2, terms[2].abs()];
            map.by_moment_rounding.push(sizes.map(|size| relative * size));
        }
        map
    }

    /// ∂(Σ SSIM)/∂(rendered) at every pixel, and what rounding may change it by.
    pub(crate) fn derivative(&self, map: &Map) -> Vec<(f64, f64)> {
        let window = window();
        (0..self.rendered.len())
            .map(|p| {
                let (x, y) = (self.rendered[p], self.target[p]);
                let (mut value, mut rounding) = (0.0, 0.0);
                // The window is even, so those that see p are those that p's window sees.
                for (q, w) in self.under(&window, p) {
                    let ([m, mm, my], [rm, rmm, rmy]) = (map.by_moment[q], map.by_moment_rounding[q]);
                    value += w * (m + 2.0 * x * mm + y * my);
                    rounding += w * (rm + 2.0 * x.abs() * rmm + y.abs() * rmy + 2.0 * self.rounding[p] * mm.abs());
                }
                (value, rounding)
            })
            .collect()
    }
}
