//! Stages `blend` and `blend_bwd` under `Sum`: C = Σ w c. One task per tile, one vector per row of 16 pixels.
//!
//! Down a column, w = exp(e₀ − ½ c u²) with u = dy − slope·dx grows by a factor that itself shrinks by the constant factor
//! exp(−c): two multiplications a row instead of an exponential. The recurrence starts afresh every `restart_rows` rows.
//!
//! Legend: t = w·v_w; S = Σ over the entry's pixels of t times 1, dx, u, dx², dx·u, u².

use fearless_simd::{Simd, prelude::*};

use crate::{
    bin::Entry,
    lanes::{Lanes, exp, iota, load3, splat, splat3, sums},
    layout::Row,
    project::Splat,
};

/// Numbers per entry that [`backward`] yields: v_colour 3, Sx, Su, Sxx, Sxu, Suu.
pub(crate) const STRIDE: usize = 8;

/// Numbers per entry that [`backward_colors`] yields: v_colour 3, and one that is 0.
pub(crate) const COLOR_STRIDE: usize = 4;

/// The weights of an entry, row by row.
pub(crate) struct Weights<S: Simd> {
    /// dx of the lanes.
    pub(crate) dx: Lanes<S>,
    /// −½ dx²/Σxx.
    across: Lanes<S>,
    c: f32,
    ratio: Lanes<S>,
    /// w of the current row, and what it is multiplied by for the next.
    pub(crate) w: Lanes<S>,
    growth: Lanes<S>,
}

impl<S: Simd> Weights<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, splat_: &Splat, first_column: usize) -> Self {
        let dx = iota(simd) + (first_column as f32 + 0.5 - splat_.mean[0]);
        let zero = splat(simd, 0.0);
        let across = dx * dx * (-0.5 * splat_.inverse_xx);
        Self { dx, across, c: splat_.c, ratio: splat(simd, splat_.ratio), w: zero, growth: zero }
    }

    /// Starts at the row in which u is `u`.
    #[inline(always)]
    pub(crate) fn start(&mut self, simd: S, u: Lanes<S>) {
        let cu = u * self.c;
        self.w = exp(simd, (cu * u).mul_add(splat(simd, -0.5), self.across));
        // Lanes that the clamp touches do not come above the cut before the next start.
        let growth = (cu + 0.5 * self.c).max(splat(simd, -80.0));
        self.growth = exp(simd, -growth);
    }

    /// Goes to the next row.
    #[inline(always)]
    pub(crate) fn advance(&mut self) {
        self.w *= self.growth;
        self.growth *= self.ratio;
    }
}

/// u in row `row`.
#[inline(always)]
pub(crate) fn u_in_row<S: Simd>(simd: S, splat_: &Splat, dx: Lanes<S>, row: usize) -> Lanes<S> {
    let dy = row as f32 + 0.5 - splat_.mean[1];
    dx.mul_add(splat(simd, -splat_.slope), splat(simd, dy))
}

/// Adds the entries' Gaussians to `rows`, whose first is image row `first_row`.
#[inline(always)]
pub(crate) fn forward<S: Simd>(
    simd: S,
    entries: &[Entry],
    splats: &[Splat],
    first_column: usize,
    first_row: usize,
    rows: &mut [Row],
) {
    let zero = splat(simd, 0.0);
    for entry in entries {
        let s = &splats[entry.place as usize];
        let mut weights = Weights::new(simd, s, first_column);
        let cut = splat(simd, s.cut);
        let color = splat3(simd, s.color);
        let [mut row, end] = entry.rows.map(usize::from);
        while row < end {
            let stop = end.min(row + s.restart_rows as usize);
            weights.start(simd, u_in_row(simd, s, weights.dx, row));
            for Row(pixels) in &mut rows[row - first_row..stop - first_row] {
                let w = weights.w.simd_ge(cut).select(weights.w, zero);
                for k in 0..3 {
                    let sum = w.mul_add(color[k], Lanes::load_array_ref(simd, &pixels[k]));
                    sum.store_array(&mut pixels[k]);
                }
                weights.advance();
            }
            row = stop;
        }
    }
}

/// What the entries' Gaussians receive from v_C = `rows`: [`STRIDE`] numbers per entry, into `slots`.
#[inline(always)]
pub(crate) fn backward<S: Simd>(
    simd: S,
    entries: &[Entry],
    splats: &[Splat],
    first_column: usize,
    first_row: usize,
    rows: &[Row],
    slots: &mut [f32],
) {
    let zero = splat(simd, 0.0);
    for (entry, slot) in entries.iter().zip(slots.as_chunks_mut::<STRIDE>().0) {
        let s = &splats[entry.place as usize];
        let mut weights = Weights::new(simd, s, first_column);
        let cut = splat(simd, s.cut);
        let color = splat3(simd, s.color);
        let (mut v_color, mut s_u, mut s_uu) = ([zero; 3], zero, zero);
        let [mut row, end] = entry.rows.map(usize::from);
        while row < end {
            let stop = end.min(row + s.restart_rows as usize);
            let mut u = u_in_row(simd, s, weights.dx, row);
            weights.start(simd, u);
            for Row(v) in &rows[row - first_row..stop - first_row] {
                let w = weights.w.simd_ge(cut).select(weights.w, zero);
                let v = load3(simd, v);
                for k in 0..3 {
                    v_color[k] = w.mul_add(v[k], v_color[k]);
                }
                let v_w = v[2].mul_add(color[2], v[1].mul_add(color[1], v[0] * color[0]));
                let tu = w * v_w * u;
                s_u += tu;
                s_uu = tu.mul_add(u, s_uu);
                u += 1.0;
                weights.advance();
            }
            row = stop;
        }
        let t = v_color[2].mul_add(color[2], v_color[1].mul_add(color[1], v_color[0] * color[0]));
        let tx = t * weights.dx;
        *slot = sums([v_color[0], v_color[1], v_color[2], tx, s_u, tx * weights.dx, s_u * weights.dx, s_uu]);
    }
}

/// As [`backward`], for the colours alone: [`COLOR_STRIDE`] numbers per entry.
#[inline(always)]
pub(crate) fn backward_colors<S: Simd>(
    simd: S,
    entries: &[Entry],
    splats: &[Splat],
    first_column: usize,
    first_row: usize,
    rows: &[Row],
    slots: &mut [f32],
) {
    let zero = splat(simd, 0.0);
    for (entry, slot) in entries.iter().zip(slots.as_chunks_mut::<COLOR_STRIDE>().0) {
        let s = &splats[entry.place as usize];
        let mut weights = Weights::new(simd, s, first_column);
        let cut = splat(simd, s.cut);
        let mut v_color = [zero; 3];
        let [mut row, end] = entry.rows.map(usize::from);
        while row < end {
            let stop = end.min(row + s.restart_rows as usize);
            weights.start(simd, u_in_row(simd, s, weights.dx, row));
            for Row(v) in &rows[row - first_row..stop - first_row] {
                let w = weights.w.simd_ge(cut).select(weights.w, zero);
                for k in 0..3 {
                    v_color[k] = w.mul_add(Lanes::load_array_ref(simd, &v[k]), v_color[k]);
                }
                weights.advance();
            }
            row = stop;
        }
        let [r, g, b, ..] = sums([v_color[0], v_color[1], v_color[2], zero, zero, zero, zero, zero]);
        *slot = [r, g, b, 0.0];
    }
}
