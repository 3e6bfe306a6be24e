//! A layer: a set of quantized Gaussians in a canonical order.
//!
//! Gaussians are ordered by their cells, row by row, so the order that the set had costs nothing. Only
//! the rows from the first to the last with Gaussians are coded. A cell's number of Gaussians is coded first, then each Gaussian: amplitude, area, aspect, angle,
//! and its place in the cell.

use std::ops::Range;

use crate::{
    coder::Coder,
    local::{Local, Seen, Surroundings},
    number::Model,
    quantizer::{AREA_RANGE, HALF, MAX_ASPECT, MAX_NORM2, Quantizer, class_of},
};

/// Numbers that hold for all Gaussians of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayerHead {
    /// Step of amplitudes: 2^(`step`/128) colour values · px; −4096 to 4096.
    pub step: i16,
    /// Side of a cell, px, at least 1.
    pub cell: u8,
    /// Cells around the canvas in which means may lie.
    pub margin: u8,
    /// Step of means relative to that of amplitudes, 1/32; at least 1.
    pub mean_ratio: u8,
    /// Step of areas and aspects relative to that of amplitudes, 1/32; at least 1.
    pub shape_ratio: u8,
    /// Step of angles relative to that of amplitudes, 1/32; at least 1.
    pub turn_ratio: u8,
}

/// A quantized Gaussian: the integers that a layer codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Code {
    /// Row of the cell.
    pub row: u32,
    /// Column of the cell.
    pub column: u32,
    /// log₂(s₁s₂) in steps.
    pub area: i32,
    /// log₂(s₁/s₂) in steps.
    pub aspect: i32,
    /// Colour times the L2 norm of the weight in steps: luminance, red − blue, green − magenta.
    pub amplitude: [i32; 3],
    /// Angle in steps.
    pub turn: u32,
    /// Place in the cell, from the left.
    pub x: u32,
    /// Place in the cell, from the top.
    pub y: u32,
}

/// Sectors of a half turn whose choice has counters: 2⁴.
const SECTOR_BITS: u32 = 4;

/// The models of a layer's numbers.
#[derive(Debug)]
struct Models {
    count: Model,
    luminance: Model,
    sign: Model,
    chroma: [Model; 2],
    area: Model,
    aspect: Model,
    sector: Model,
}

impl Models {
    fn new() -> Self {
        Self {
            count: Model::new([16, 24, 12]),
            luminance: Model::new([48, 16, 48]),
            sign: Model::new([3, 48, 24]),
            chroma: [Model::new([32, 16, 48]), Model::new([32, 32, 48])],
            area: Model::new([12, 48, 24]),
            aspect: Model::new([12, 16, 24]),
            sector: Model::new([20, 16 * 5, 16]),
        }
    }
}

/// Codes the `count` Gaussians of a layer, which lie in these rows of cells. An encoder has sorted
/// them; a decoder passes none, and gets them.
///
/// Returns as soon as a number is impossible or the bytes have ended, with the Gaussians so far; only
/// a decoder of damaged or truncated bytes does.
pub(crate) fn code_layer(
    coder: &mut impl Coder,
    quantizer: &Quantizer,
    (rows, count): (Range<u32>, usize),
    codes: &[Code],
) -> Vec<Code> {
    let grid = *quantizer.grid();
    let mut models = Models::new();
    let mut around = Surroundings::new(grid.columns);
    let mut all: Vec<Code> = Vec::new();
    let mut rest = codes;
    for row in rows {
        around.start_row();
        for column in 0..grid.columns {
            let here = rest.iter().take_while(|code| (code.row, code.column) == (row, column)).count();
            let border = grid.is_outside(column, row);
            let contexts = around.count_contexts(column, border);
            let number = models.count.unsigned(coder, contexts, here as u32) as usize;
            if number > count - all.len() || coder.has_ended() {
                return all;
            }
            around.start_cell();
            for index in 0..number {
                let local = around.local(column);
                let blank = Code { row, column, area: 0, aspect: 0, amplitude: [0; 3], turn: 0, x: 0, y: 0 };
                let code = rest.get(index).copied().unwrap_or(blank);
                let Some((code, seen)) = models.gaussian(coder, quantizer, &local, (index, number), code) else {
                    return all;
                };
                if coder.has_ended() {
                    return all;
                }
                around.push(seen);
                all.push(code);
            }
            rest = rest.get(number..).unwrap_or_default();
        }
    }
    all
}

impl Models {
    /// Codes one Gaussian, the `index`-th of `number` in its cell; `None` where it is impossible.
    fn gaussian(
        &mut self,
        coder: &mut impl Coder,
        quantizer: &Quantizer,
        local: &Local,
        (index, number): (usize, usize),
        code: Code,
    ) -> Option<(Code, Seen)> {
        let place = 4 * number.min(3) + index.min(3);
        let amplitude = self.amplitude(coder, local, place, code.amplitude);
        let norm2: i64 = amplitude.iter().map(|&q| i64::from(q) * i64::from(q)).sum();
        if !(1..=MAX_NORM2).contains(&norm2) {
            return None;
        }
        let class = class_of(amplitude) as usize;
        let steps = quantizer.steps(amplitude);
        let fineness = steps.log.ilog2() as usize;

        let expected = rounded_quotient(local.area, steps.log);
        let contexts = [fineness, class, local.spread];
        let off = self.area.signed(coder, contexts, code.area - expected);
        let area = expected + off;
        let contexts =
            [fineness, rounded_quotient(local.aspect, steps.log).clamp(0, 15) as usize, area_class(area * steps.log)];
        let aspect = self.aspect.unsigned(coder, contexts, code.aspect as u32) as i32;
        let (area_value, aspect_value) = (area.checked_mul(steps.log)?, aspect.checked_mul(steps.log)?);
        if !(AREA_RANGE.0..=AREA_RANGE.1).contains(&area_value) || aspect_value > MAX_ASPECT {
            return None;
        }

        let directions = quantizer.directions(&steps, aspect_value);
        let turn = self.turn(coder, local, directions, code.turn);
        let mut code = Code { area, aspect, amplitude, turn, ..code };
        let (columns, rows) = quantizer.places_of(&code, &steps, directions);
        code.x = coder.uniform(columns, code.x);
        code.y = coder.uniform(rows, code.y);
        let seen = Seen::new(amplitude, class, (area_value, aspect_value), (turn, directions));
        Some((code, seen))
    }

    fn amplitude(&mut self, coder: &mut impl Coder, local: &Local, place: usize, value: [i32; 3]) -> [i32; 3] {
        let near = local.nearest;
        let size =
            self.luminance.unsigned(coder, [local.class, place, near.map_or(47, |n| n.class)], value[0].unsigned_abs());
        let bright = size_class(size as i32);
        let mut luminance = size as i32;
        if size > 0 {
            let sign = near.map_or(0, |n| if n.amplitude[0] < 0 { 1 } else { 2 });
            let negative = self.sign.flag(coder, [sign, bright, area_class(local.area)], value[0] < 0);
            luminance = if negative { -luminance } else { luminance };
        }
        let of_luminance = 2 * bright + usize::from(luminance < 0);
        let relation = |q: i32, n: Seen| 2 * size_class(q) + usize::from((q < 0) != (n.amplitude[0] < 0));
        let nearest = |k: usize| near.map_or(47, |n| relation(n.amplitude[k], n));
        let first = self.chroma[0].signed(coder, [of_luminance, size_class(local.chroma[0]), nearest(1)], value[1]);
        let of_first = 2 * size_class(first) + usize::from(first < 0);
        let second = self.chroma[1].signed(coder, [of_luminance, of_first, nearest(2)], value[2]);
        [luminance, first, second]
    }

    /// Codes the angle: its sector relative to that of the neighbours, then the rest.
    fn turn(&mut self, coder: &mut impl Coder, local: &Local, directions: u32, turn: u32) -> u32 {
        let bits = directions.ilog2().min(SECTOR_BITS);
        let sectors = 1 << bits;
        let expected = local.sector >> (SECTOR_BITS - bits);
        let sector = (u64::from(turn.min(directions - 1)) * u64::from(sectors) / u64::from(directions)) as u32;
        let contexts = [
            (bits as usize) * 4 + local.alignment,
            expected as usize * 5 + bits as usize,
            (directions.ilog2() as usize).min(15),
        ];
        let relative = self.sector.tree(coder, contexts, bits, (sector + sectors - expected) % sectors);
        let sector = (relative + expected) % sectors;
        let first = (u64::from(sector) * u64::from(directions)).div_ceil(sectors.into()) as u32;
        let end = (u64::from(sector + 1) * u64::from(directions)).div_ceil(sectors.into()) as u32;
        first + coder.uniform((end - first).max(1), turn.saturating_sub(first))
    }
}

/// Class of a size: 0, 1, 2, 3, then by octaves; at most 15.
pub(crate) fn size_class(value: i32) -> usize {
    let size = value.unsigned_abs();
    if size < 4 { size as usize } else { (size.ilog2() as usize + 2).min(15) }
}

/// Class of an area by octaves of scale; below 24.
fn area_class(area: i32) -> usize {
    (area.div_euclid(HALF) + 4).clamp(0, 23) as usize
}

fn rounded_quotient(value: i32, step: i32) -> i32 {
    (2 * value + step).div_euclid(2 * step)
}
