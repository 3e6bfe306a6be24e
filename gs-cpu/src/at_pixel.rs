//! What one Gaussian does at a vector of pixels: its weight, its share of their colours, and the
//! gradient by its α. The kernels of stages `blend` and `blend_bwd` call it.
//!
//! A vector is a row of 16 pixels. Where the level's registers are narrower, it is a part of a row,
//! and parts that the Gaussian does not touch are skipped.
//!
//! Down a column, w = exp(e₀ − ½ c u²) with u = dy − slope·dx grows by a factor that itself shrinks
//! by the constant factor exp(−c): two fused multiply-adds a row instead of an exponential. The
//! recurrence starts again every `restart_rows` rows.
//!
//! Legend: K = the sums for a statistic (`collect`); t = w·v_w, under `Over` α·v_α; S, Sx, Su, Sxx,
//! Sxu, Suu = Σ over the entry's pixels of t times 1, dx, u, dx², dx·u, u².

use fearless_simd::{Simd, prelude::*};
use gs_core::Accuracy;

use crate::{
    collect::Collect,
    lanes::{Floats, LANES, exp_less, fma, iota, load, masked, splat, store},
    layout::ScalarRow,
    splat::{SAFE_EXPONENT, Splat},
};

/// The factor of the recurrence's weights. Without it, most lanes far from the Gaussian would come to
/// denormal numbers, on which operations are many times slower. A power of two changes no digit.
const SCALE: f32 = f32::from_bits((127 + 120) << 23);

/// The weights of an entry, row by row, in the lanes from `lane` on.
#[derive(Clone, Copy)]
pub(crate) struct Weights<V> {
    /// dx of the lanes.
    pub(crate) dx: V,
    /// −½ dx²/Σxx.
    across: V,
    c: f32,
    ratio: V,
    /// Number subtracted from the stored ratio: 1 for wide Gaussians, else 0.
    ///
    /// `minus_fall` and `mask` are −(1 − exp(−c)) and all ones for wide Gaussians, else 0.
    base: f32,
    minus_fall: V,
    mask: V,
    /// [`SCALE`] times w of the current row, and the factor to the next row's w, minus `base`.
    scaled: V,
    growth: V,
}

impl<V> Weights<V> {
    #[inline(always)]
    pub(crate) fn new<S: Simd>(simd: S, splat_: &Splat, first_column: usize, lane: usize) -> Self
    where
        V: Floats<S>,
    {
        let dx = iota::<S, V>(simd, lane) + (first_column as f32 + 0.5 - splat_.mean[0]);
        let zero: V = splat(simd, 0.0);
        let across = dx * dx * (-0.5 * splat_.inverse_xx);
        let (base, mask) = if splat_.fall > 0.0 { (1.0, f32::from_bits(u32::MAX)) } else { (0.0, 0.0) };
        let (ratio, minus_fall, mask) = (splat(simd, splat_.ratio), splat(simd, -splat_.fall), splat(simd, mask));
        Self { dx, across, c: splat_.c, ratio, base, minus_fall, mask, scaled: zero, growth: zero }
    }

    /// Starts the recurrence at the row in which u is `u`.
    #[inline(always)]
    pub(crate) fn start<S: Simd>(&mut self, simd: S, u: V)
    where
        V: Floats<S>,
    {
        let cu = u * self.c;
        let exponent = fma(cu * u, splat(simd, -0.5), self.across);
        // A lane that begins lower stays below the cut up to the next start. In the others, c(|u| + ½)
        // is above 87, where `exp_less` is wrong, only if c > 30. Then the next start is after at most
        // two rows, and the weight of the second row is negative.
        let may_show = exponent.simd_ge(splat::<S, V>(simd, -SAFE_EXPONENT));
        self.scaled = may_show.select(exp_less(simd, exponent, 0.0) * SCALE, splat(simd, 0.0));
        self.growth = may_show.select(exp_less(simd, -(cu + 0.5 * self.c), self.base), splat(simd, 0.0));
    }

    /// The weights of the current row, with 0 for those below the splat's cut, and which are not below it.
    #[inline(always)]
    pub(crate) fn above<S: Simd>(&self, simd: S, s: &Splat) -> (V, V::Mask)
    where
        V: Floats<S>,
    {
        let above = self.scaled.simd_ge(splat::<S, V>(simd, s.cut * SCALE));
        (above.select(self.scaled, splat(simd, 0.0)) * (1.0 / SCALE), above)
    }

    /// Goes to the next row: w ← w (base + growth), growth ← (base + growth) ratio − base.
    #[inline(always)]
    pub(crate) fn advance<S: Simd>(&mut self)
    where
        V: Floats<S>,
    {
        self.scaled = fma(self.scaled, self.growth, masked(self.scaled, self.mask));
        self.growth = fma(self.growth, self.ratio, self.minus_fall);
    }
}

/// u in row `row`.
#[inline(always)]
pub(crate) fn u_in_row<S: Simd, V: Floats<S>>(simd: S, splat_: &Splat, dx: V, row: usize) -> V {
    let dy = row as f32 + 0.5 - splat_.mean[1];
    fma(dx, splat(simd, -splat_.slope), splat(simd, dy))
}

/// Whether all lanes of the vector at `lane` are outside the columns that a Gaussian touches.
///
/// False where a vector is a whole row: such an entry would not be listed.
#[inline(always)]
pub(crate) fn passes_by<S: Simd, V: Floats<S>>(splat_: &Splat, first_column: usize, lane: usize) -> bool {
    if V::LEN == LANES {
        return false;
    }
    let middle = (first_column + lane) as f32 + 0.5 * V::LEN as f32;
    (middle - splat_.mean[0]).abs() > splat_.half_x + 0.5 * V::LEN as f32
}

/// A Gaussian and its limits under `Over`.
#[derive(Clone, Copy)]
pub(crate) struct Over<V> {
    zero: V,
    one: V,
    opacity: V,
    /// The cut and the largest α, times [`SCALE`].
    cut: V,
    alpha_max: V,
    minimum: V,
}

/// A Gaussian blended under `Over` into the pixels of a vector.
#[derive(Clone, Copy)]
pub(crate) struct Blended<V, M> {
    /// What the Gaussian's colour is multiplied by; 0 at pixels that it does not change.
    pub(crate) share: V,
    /// The pixels that the Gaussian changes.
    pub(crate) counted: M,
    /// Transmittance before it.
    before: V,
    alpha: V,
    /// The α without its limit, times [`SCALE`].
    uncut: V,
}

impl<V> Over<V> {
    #[inline(always)]
    pub(crate) fn new<S: Simd>(simd: S, s: &Splat, accuracy: &Accuracy) -> Self
    where
        V: Floats<S>,
    {
        let all = |value| splat(simd, value);
        let (cut, alpha_max) = (all(s.cut * SCALE), all(accuracy.alpha_max * SCALE));
        let minimum = all(accuracy.transmittance_min);
        Self { zero: all(0.0), one: all(1.0), opacity: all(s.opacity), cut, alpha_max, minimum }
    }

    /// Blends the Gaussian with these weights behind the earlier ones, and updates the transmittances
    /// of the lanes from `lane` on. Those of full pixels become negative.
    #[inline(always)]
    pub(crate) fn blended<S: Simd>(
        &self,
        simd: S,
        weights: &Weights<V>,
        transmittance: &mut [f32; LANES],
        lane: usize,
    ) -> Blended<V, V::Mask>
    where
        V: Floats<S>,
    {
        let uncut = weights.scaled * self.opacity;
        let touches = uncut.simd_ge(self.cut);
        // With an α of 0, the transmittance stays. A select between the new and the loaded value would become
        // a masked store, and the next load of the row would wait until that has reached the cache.
        let alpha = touches.select(uncut.min(self.alpha_max), self.zero) * (1.0 / SCALE);
        let before: V = load(simd, transmittance, lane);
        let share = before * alpha;
        let behind = before - share;
        let counts = behind.simd_ge(self.minimum);
        store(counts.select(behind, -before.abs()), transmittance, lane);
        Blended { share: counts.select(share, self.zero), counted: touches & counts, before, alpha, uncut }
    }

    /// t = α·v_α, from v_C·colour and v_C·(the colour behind the Gaussian). The gradient of a clamped
    /// α is zero.
    #[inline(always)]
    pub(crate) fn through_alpha<S: Simd>(&self, b: &Blended<V, V::Mask>, v_dot_c: V, rest: V) -> V
    where
        V: Floats<S>,
    {
        let v_alpha = b.before * v_dot_c - rest / (self.one - b.alpha);
        let free = b.counted & b.uncut.simd_le(self.alpha_max);
        free.select(v_alpha * b.alpha, self.zero)
    }
}

/// Adds the magnitudes of t Σ′⁻¹ d, one pixel's share of the positional gradient, to `collected`.
/// `across` is dx/Σxx.
///
/// σ = ½ (dx²/Σxx + c u²) with u = dy − slope·dx, so that ∂σ/∂(dx, dy) = (dx/Σxx − slope·c·u, c·u).
#[inline(always)]
pub(crate) fn add_absolute<S: Simd, V: Floats<S>>(collected: &mut [V; 2], t: V, across: V, u: V, s: &Splat) {
    let (size, down) = (t.abs(), u * s.c);
    collected[0] = fma(size, (across - down * s.slope).abs(), collected[0]);
    collected[1] = fma(size, down.abs(), collected[1]);
}

/// Adds `share` times the pixels' errors to `collected`, and returns the remaining rows of errors.
#[inline(always)]
pub(crate) fn add_error<'e, S: Simd, V: Floats<S>>(
    simd: S,
    collected: &mut [V; 2],
    share: V,
    errors: &'e [ScalarRow],
    lane: usize,
) -> &'e [ScalarRow] {
    let Some((ScalarRow(error), rest)) = errors.split_first() else { return errors };
    collected[0] = fma(share, load(simd, error, lane), collected[0]);
    rest
}

/// Adds the statistic's sums over the lanes of one vector to the slot.
#[inline(always)]
pub(crate) fn add_collected<S: Simd, V: Floats<S>, K: Collect>(extra: &mut [f32], collected: [V; 2]) {
    for (total, value) in extra.iter_mut().zip(&collected[..K::NUMBERS]) {
        *total += value.reduce_sum();
    }
}

/// Adds the sums over the lanes of one vector to the slot.
#[inline(always)]
pub(crate) fn add(slot: &mut [f32], part: &[f32; 8]) {
    for (total, value) in slot.iter_mut().zip(part) {
        *total += value;
    }
}
