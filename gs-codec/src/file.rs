//! The file: header, layers, checksums. `docs/gsi.md` specifies it; `decode.rs` reads it.

use std::{iter, ops::Range};

use crc32fast::Hasher;
use gs_core::check_size;

use crate::{
    coder::{Encoder, Estimator},
    error::Error,
    grid::Grid,
    layer::{Code, LayerHead, code_layer},
    profile,
    quantizer::Quantizer,
};

/// The first bytes of a file.
pub const MAGIC: [u8; 4] = *b"GSIF";
pub(crate) const VERSION: u8 = 1;

/// Flags of the header.
pub(crate) const ALPHA: u8 = 1;
pub(crate) const PROFILE: u8 = 2;

/// Gaussians per byte of a layer, at most: a limit of the format, so that a short file cannot claim
/// many.
pub(crate) const MOST_PER_BYTE: usize = 8;
/// Cells of a layer, at most: this many per Gaussian, and [`FREE_CELLS`].
const CELLS_PER_GAUSSIAN: u64 = 16;
const FREE_CELLS: u64 = 65_536;

/// A layer with its Gaussians.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layer {
    /// Numbers that hold for all of them.
    pub head: LayerHead,
    /// The Gaussians in any order; the file stores them in that of [`Code`].
    pub codes: Vec<Code>,
}

/// What a file holds: the picture is the sum of all Gaussians over the background.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns, px.
    pub width: u32,
    /// Rows, px.
    pub height: u32,
    /// Colour to which the Gaussians are added.
    pub background: [u8; 3],
    /// Layers, the most important first; 1 to 255.
    pub layers: Vec<Layer>,
    /// Alpha, by which the colours are premultiplied; `None` for an opaque picture.
    pub alpha: Option<Alpha>,
    /// ICC profile of the colours, at most 65,535 bytes; empty for sRGB.
    pub profile: Vec<u8>,
}

/// The alpha of a picture: another sum of Gaussians, whose red is the alpha.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Alpha {
    /// Alpha to which the Gaussians are added.
    pub background: u8,
    /// Layers of grey Gaussians, the most important first; 1 to 255.
    pub layers: Vec<Layer>,
}

/// The checksum of a file's bytes so far.
#[derive(Debug, Default)]
pub(crate) struct Checksum {
    hasher: Hasher,
    /// Number of bytes that are in it.
    seen: usize,
}

impl Checksum {
    /// The checksum of `bytes`, which begin with those of the last call.
    pub(crate) fn of(&mut self, bytes: &[u8]) -> u32 {
        self.hasher.update(&bytes[self.seen..]);
        self.seen = bytes.len();
        self.hasher.clone().finalize()
    }
}

/// One of the two sums of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    Alpha,
    Colors,
}

/// The order of layers in a file: of each part the first, then of each the second, and so on. Alpha is
/// before the colours, so that a truncated file has the shape of what it shows.
pub(crate) fn order(alpha: usize, colors: usize) -> impl Iterator<Item = Part> {
    let part = |part, there| iter::repeat_n(part, usize::from(there));
    (0..alpha.max(colors)).flat_map(move |k| part(Part::Alpha, k < alpha).chain(part(Part::Colors, k < colors)))
}

impl Layer {
    /// Length of this layer's Gaussians in a file, bits.
    pub fn bits(&self, size: (u32, u32)) -> f64 {
        let (mut cost, codes) = (Estimator::default(), self.sorted());
        code_layer(&mut cost, &Quantizer::new(self.head, size), (rows_of(&codes), codes.len()), &codes);
        cost.bits
    }

    /// This layer as at most `count` layers of about equal numbers of Gaussians, from the top of the
    /// picture to its bottom. They are decoded side by side.
    pub fn stripes(&self, count: usize) -> Vec<Self> {
        let codes = self.sorted();
        let (mut stripes, mut rest) = (Vec::with_capacity(count), &codes[..]);
        for left in (1..=count.max(1)).rev() {
            let last = rest.get((rest.len() / left).saturating_sub(1)).map_or(0, |code| code.row);
            let (stripe, later) = rest.split_at(rest.partition_point(|code| code.row <= last));
            rest = later;
            stripes.push(Self { head: self.head, codes: stripe.to_vec() });
        }
        // Rows are not cut, so the last stripes may be empty.
        let filled = stripes.iter().take_while(|stripe| !stripe.codes.is_empty()).count();
        stripes.truncate(filled.max(1));
        stripes
    }

    fn sorted(&self) -> Vec<Code> {
        let mut codes = self.codes.clone();
        codes.sort_unstable();
        codes
    }

    /// Adds the layer to the bytes of a file, of which `checksum` has seen those of the layers before.
    fn push(&self, bytes: &mut Vec<u8>, checksum: &mut Checksum, size: (u32, u32)) -> Result<(), Error> {
        let quantizer = Quantizer::new(self.head, size);
        let codes = self.sorted();
        let rows = rows_of(&codes);
        check_layer(&quantizer, &rows, codes.len())?;
        let mut coder = Encoder::default();
        code_layer(&mut coder, &quantizer, (rows.clone(), codes.len()), &codes);
        let mut content = coder.finish();
        let least = codes.len().div_ceil(MOST_PER_BYTE);
        content.resize(content.len().max(least), 0);
        let numbers = [codes.len(), content.len(), rows.start as usize, rows.len()];
        numbers.into_iter().for_each(|number| push_number(bytes, number));
        let LayerHead { step, cell, margin, mean_ratio, shape_ratio, turn_ratio } = self.head;
        bytes.extend(step.to_le_bytes());
        bytes.extend([cell, margin, mean_ratio, shape_ratio, turn_ratio]);
        bytes.extend(content);
        bytes.extend(checksum.of(bytes).to_le_bytes());
        Ok(())
    }
}

impl Picture {
    /// The bytes of the file.
    ///
    /// # Errors
    /// [`gs_core::Error::Size`] for an impossible size, [`Error::Value`] for an impossible number of
    /// layers or cells, or a profile that is too long.
    pub fn encode(&self) -> Result<Vec<u8>, Error> {
        let size = (self.width, self.height);
        check_size(self.width, self.height)?;
        let alpha = self.alpha.as_ref();
        let flags = if alpha.is_some() { ALPHA } else { 0 } | if self.profile.is_empty() { 0 } else { PROFILE };
        let mut bytes = MAGIC.to_vec();
        bytes.extend([VERSION, flags]);
        bytes.extend([self.width, self.height].map(|side| (side as u16).to_le_bytes()).concat());
        bytes.extend(self.background);
        bytes.push(layer_count(self.layers.len())?);
        if let Some(Alpha { background, layers }) = alpha {
            bytes.extend([*background, layer_count(layers.len())?]);
        }
        if !self.profile.is_empty() {
            bytes.extend(profile::pack(&self.profile)?);
        }
        let of_alpha = alpha.map_or(&[][..], |alpha| &alpha.layers);
        let (mut of_alpha, mut colors) = (of_alpha.iter(), self.layers.iter());
        let mut checksum = Checksum::default();
        for part in order(of_alpha.len(), colors.len()) {
            let next = if part == Part::Alpha { of_alpha.next() } else { colors.next() };
            next.map_or(Ok(()), |layer| layer.push(&mut bytes, &mut checksum, size))?;
        }
        Ok(bytes)
    }
}

/// The rows of cells from the first to the last with Gaussians.
fn rows_of(sorted: &[Code]) -> Range<u32> {
    sorted.first().zip(sorted.last()).map_or(0..0, |(first, last)| first.row..last.row + 1)
}

/// Checks the numbers of a layer's head.
pub(crate) fn check_layer(quantizer: &Quantizer, rows: &Range<u32>, count: usize) -> Result<(), Error> {
    let LayerHead { step, cell, mean_ratio, shape_ratio, turn_ratio, .. } = *quantizer.head();
    let most = i64::from(LayerHead::MOST_STEP);
    Error::within("the step of a layer", step.into(), -most..=most, "-4096 to 4096")?;
    let least = cell.min(mean_ratio).min(shape_ratio).min(turn_ratio);
    Error::within("the cell size or a ratio of a layer", least.into(), 1..=255, "1 to 255")?;
    let grid = quantizer.grid();
    let last = 0..=grid.rows.into();
    Error::within("the last row of cells of a layer", rows.end.into(), last, "within its grid")?;
    let cells = i64::from(grid.columns) * rows.len() as i64;
    let (most, allowed) = (most_cells(count) as i64, "at most 16 for each Gaussian, and 65,536");
    Error::within("the number of cells of a layer", cells, 0..=most, allowed)
}

fn most_cells(gaussians: usize) -> u64 {
    CELLS_PER_GAUSSIAN * gaussians as u64 + FREE_CELLS
}

impl LayerHead {
    /// Largest magnitude of [`Self::step`]: 32 octaves. All colours are then finite.
    pub const MOST_STEP: i16 = 4096;

    /// The largest margin of a layer of this many Gaussians with cells of this side, px, on a canvas of
    /// this size, px.
    pub fn most_margin(cell: u8, size: (u32, u32), gaussians: usize) -> u8 {
        let head = Self { step: 0, cell, margin: 0, mean_ratio: 1, shape_ratio: 1, turn_ratio: 1 };
        let fits = |margin: &u8| Grid::new(&Self { margin: *margin, ..head }, size).cells() <= most_cells(gaussians);
        (0..=u8::MAX).rev().find(fits).unwrap_or(0)
    }
}

pub(crate) fn layer_count(count: usize) -> Result<u8, Error> {
    Error::within("the number of layers", count as i64, 1..=255, "1 to 255").map(|()| count as u8)
}

fn push_number(bytes: &mut Vec<u8>, mut number: usize) {
    while number > 127 {
        bytes.push((number & 127) as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
}
