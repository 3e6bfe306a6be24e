//! Stages `blend` and `blend_bwd` under `Sum`: C = Σ w c. One task per tile.
//!
//! A vector is a row of 16 pixels. Where the level's registers are narrower, it is a part of a row,
//! and parts that the Gaussian does not touch are skipped.
//!
//! Down a column, w = exp(e₀ − ½ c u²) with u = dy − slope·dx grows by a factor that itself shrinks
//! by the constant factor exp(−c): two fused multiply-adds a row instead of an exponential. The
//! recurrence starts again every `restart_rows` rows.
//!
//! Legend: K = the sums for a statistic (`collect`); t = w·v_w; S, Sx, Su, Sxx, Sxu, Suu = Σ over
//! the entry's pixels of t times 1, dx, u, dx², dx·u, u².

use fearless_simd::{Simd, prelude::*};

use crate::{
    bin::Entry,
    collect::Collect,
    lanes::{
        Floats, LANES, Whole, each_part, exp, exp_less, fma, iota, load, load3, masked, splat, splat3, store, sums,
    },
    layout::{Row, ScalarRow},
    splat::Splat,
};

/// Numbers per entry that [`backward`] writes: v_colour 3, Sx, Su, Sxx, Sxu, Suu. Those of K
/// follow.
pub(crate) const STRIDE: usize = 8;

/// Numbers per entry that [`backward_colors`] writes: v_colour 3, and a 0.
pub(crate) const COLOR_STRIDE: usize = 4;

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
    /// w of the current row, and the factor to the next row's w, minus `base`.
    pub(crate) w: V,
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
        Self { dx, across, c: splat_.c, ratio, base, minus_fall, mask, w: zero, growth: zero }
    }

    /// Starts the recurrence at the row in which u is `u`.
    #[inline(always)]
    pub(crate) fn start<S: Simd>(&mut self, simd: S, u: V)
    where
        V: Floats<S>,
    {
        let cu = u * self.c;
        self.w = exp(simd, fma(cu * u, splat(simd, -0.5), self.across));
        // `exp_less` is wrong beyond ±87, which never brings a weight above the cut. c(|u| + ½) >
        // 87 means that w is 0 here or that c > 30. If w is 0, it stays 0 or NaN up to the next
        // start, and the true weight is below the cut. If c > 30, the next start is after at most
        // two rows, and the weight of the second row is negative.
        self.growth = exp_less(simd, -(cu + 0.5 * self.c), self.base);
    }

    /// Goes to the next row: w ← w (base + growth), growth ← (base + growth) ratio − base.
    #[inline(always)]
    pub(crate) fn advance<S: Simd>(&mut self)
    where
        V: Floats<S>,
    {
        self.w = fma(self.w, self.growth, masked(self.w, self.mask));
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

/// Fills `rows` with background − target, from which [`forward`] computes the residual.
#[inline(always)]
pub(crate) fn start<S: Simd>(simd: S, background: [f32; 3], target: &[Row], rows: &mut [Row]) {
    let background: [S::f32s; 3] = splat3(simd, background);
    for (Row(pixels), Row(target)) in rows.iter_mut().zip(target) {
        for k in 0..3 {
            for lane in (0..LANES).step_by(S::f32s::LEN) {
                store(background[k] - load::<S, S::f32s>(simd, &target[k], lane), &mut pixels[k], lane);
            }
        }
    }
}

/// Adds the entries' Gaussians to `rows`; the first of `rows` is image row `first_row`.
///
/// A run is the rows between two starts of the recurrence. Each run's start is computed before the
/// rows of the previous run, across entries: the exponentials then do not wait for a mispredicted
/// end of a run.
#[inline(always)]
pub(crate) fn forward<S: Simd>(
    simd: S,
    entries: &[Entry],
    projected: &[Splat],
    first_column: usize,
    first_row: usize,
    rows: &mut [Row],
) {
    let zero = splat::<S, Whole<S>>(simd, 0.0);
    let Some(first) = entries.first() else { return };
    let mut run = Run::<Whole<S>>::new(simd, first, projected, first_column, usize::from(first.rows[0]));
    for (index, entry) in entries.iter().enumerate() {
        let s = &projected[entry.splat as usize];
        let (color, cut): ([Whole<S>; 3], Whole<S>) = (splat3(simd, s.color), splat(simd, s.cut));
        let following = entries.get(index + 1).unwrap_or(entry);
        let end = usize::from(entry.rows[1]);
        loop {
            let stop = (run.row + s.restart_rows as usize).min(end);
            let (of, at) = if stop < end { (entry, stop) } else { (following, usize::from(following.rows[0])) };
            let next = Run::new(simd, of, projected, first_column, at);
            let mut weights = run.weights;
            for Row(pixels) in &mut rows[run.row - first_row..stop - first_row] {
                let w = weights.w.simd_ge(cut).select(weights.w, zero);
                for k in 0..3 {
                    store(fma(w, color[k], load(simd, &pixels[k], 0)), &mut pixels[k], 0);
                }
                weights.advance::<S>();
            }
            run = next;
            if stop == end {
                break;
            }
        }
    }
}

/// A start of the recurrence, computed ahead of its rows.
#[derive(Clone, Copy)]
struct Run<V> {
    row: usize,
    weights: Weights<V>,
}

impl<V> Run<V> {
    #[inline(always)]
    fn new<S: Simd>(simd: S, entry: &Entry, projected: &[Splat], first_column: usize, row: usize) -> Self
    where
        V: Floats<S>,
    {
        let s = &projected[entry.splat as usize];
        let mut weights = Weights::<V>::new(simd, s, first_column, 0);
        weights.start(simd, u_in_row(simd, s, weights.dx, row));
        Self { row, weights }
    }
}

/// Computes the entries' gradients from v_C = `rows` into `slots`.
///
/// A slot has [`STRIDE`] numbers, and those of K. `errors` are the pixels' errors if K needs them.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
pub(crate) fn backward<S: Simd, K: Collect>(
    simd: S,
    entries: &[Entry],
    projected: &[Splat],
    first_column: usize,
    first_row: usize,
    lanes_inside: usize,
    rows: &[Row],
    errors: &[ScalarRow],
    slots: &mut [f32],
) {
    for (entry, slot) in entries.iter().zip(slots.chunks_exact_mut(STRIDE + K::NUMBERS)) {
        let s = &projected[entry.splat as usize];
        let [row, end] = entry.rows.map(|row| usize::from(row) - first_row);
        slot.fill(0.0);
        let errors = if K::ERROR { &errors[row..end] } else { &[] };
        each_part!(S, K; backward_part(simd, s, [first_column, lanes_inside], usize::from(entry.rows[0]), &rows[row..end], errors, slot));
    }
}

/// [`backward`] of one entry, in the lanes of one vector.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
fn backward_part<S: Simd, V: Floats<S>, K: Collect>(
    simd: S,
    s: &Splat,
    [first_column, lanes_inside]: [usize; 2],
    mut row: usize,
    rows: &[Row],
    mut errors: &[ScalarRow],
    slot: &mut [f32],
    lane: usize,
) {
    if passes_by::<S, V>(s, first_column, lane) {
        return;
    }
    let (zero, cut): (V, V) = (splat(simd, 0.0), splat(simd, s.cut));
    let color = splat3(simd, s.color);
    let mut weights = Weights::<V>::new(simd, s, first_column, lane);
    let (mut v_color, mut s_u, mut s_uu) = ([zero; 3], zero, zero);
    let across = weights.dx * s.inverse_xx;
    let mut collected = [zero; 2];
    let inside = iota::<S, V>(simd, lane).simd_lt(splat::<S, V>(simd, lanes_inside as f32));
    for rows in rows.chunks(s.restart_rows as usize) {
        let mut u = u_in_row(simd, s, weights.dx, row);
        weights.start(simd, u);
        row += rows.len();
        for Row(v) in rows {
            let counts = weights.w.simd_ge(cut);
            let w = counts.select(weights.w, zero);
            let v = load3(simd, v, lane);
            for k in 0..3 {
                v_color[k] = fma(w, v[k], v_color[k]);
            }
            let v_w = fma(v[2], color[2], fma(v[1], color[1], v[0] * color[0]));
            let tu = w * v_w * u;
            s_u += tu;
            s_uu = fma(tu, u, s_uu);
            if K::ABSOLUTE {
                add_absolute(&mut collected, w * v_w, across, u, s);
            }
            if K::ERROR {
                errors = add_error(simd, &mut collected, w, errors, lane);
            }
            if K::COUNT {
                collected[0] += (counts & inside).select(splat::<S, V>(simd, 1.0), zero);
            }
            u += 1.0;
            weights.advance::<S>();
        }
    }
    let (slot, extra) = slot.split_at_mut(STRIDE);
    add_collected::<S, V, K>(extra, collected);
    let t = fma(v_color[2], color[2], fma(v_color[1], color[1], v_color[0] * color[0]));
    let tx = t * weights.dx;
    add(slot, &sums([v_color[0], v_color[1], v_color[2], tx, s_u, tx * weights.dx, s_u * weights.dx, s_uu]));
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

/// Computes the gradients by the colours alone, as [`backward`] does: [`COLOR_STRIDE`] numbers per
/// entry.
#[inline(always)]
pub(crate) fn backward_colors<S: Simd>(
    simd: S,
    entries: &[Entry],
    projected: &[Splat],
    first_column: usize,
    first_row: usize,
    rows: &[Row],
    slots: &mut [f32],
) {
    for (entry, slot) in entries.iter().zip(slots.as_chunks_mut::<COLOR_STRIDE>().0) {
        let s = &projected[entry.splat as usize];
        let [row, end] = entry.rows.map(|row| usize::from(row) - first_row);
        *slot = [0.0; COLOR_STRIDE];
        each_part!(S; colors_part(simd, s, first_column, usize::from(entry.rows[0]), &rows[row..end], slot));
    }
}

/// [`backward_colors`] of one entry, in the lanes of one vector.
#[inline(always)]
fn colors_part<S: Simd, V: Floats<S>>(
    simd: S,
    s: &Splat,
    first_column: usize,
    mut row: usize,
    rows: &[Row],
    slot: &mut [f32; COLOR_STRIDE],
    lane: usize,
) {
    if passes_by::<S, V>(s, first_column, lane) {
        return;
    }
    let (zero, cut): (V, V) = (splat(simd, 0.0), splat(simd, s.cut));
    let mut weights = Weights::<V>::new(simd, s, first_column, lane);
    let mut v_color = [zero; 3];
    for rows in rows.chunks(s.restart_rows as usize) {
        weights.start(simd, u_in_row(simd, s, weights.dx, row));
        row += rows.len();
        for Row(v) in rows {
            let w = weights.w.simd_ge(cut).select(weights.w, zero);
            for k in 0..3 {
                v_color[k] = fma(w, load(simd, &v[k], lane), v_color[k]);
            }
            weights.advance::<S>();
        }
    }
    add(&mut slot[..3], &sums([v_color[0], v_color[1], v_color[2], zero, zero, zero, zero, zero]));
}
