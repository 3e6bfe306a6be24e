//! The file: header, layers, checksums. `docs/gsi.md` specifies it.

use std::ops::Range;

use crc32fast::Hasher;
use gs_core::{Gaussian2d, Scene2d, check_size};
use rayon::prelude::*;

use crate::{
    coder::{Decoder, Encoder, Estimator},
    error::Error,
    layer::{Code, LayerHead, code_layer},
    quantizer::Quantizer,
};

/// The first bytes of a file.
pub const MAGIC: [u8; 4] = *b"GSIF";
const VERSION: u8 = 1;
/// Bytes before the first layer.
const HEADER_BYTES: usize = 14;
/// Least length of a layer's head in a file.
const CHECKSUM_BYTES: usize = 4;

/// Gaussians per byte of a layer, at most: a limit of the format, so that a short file cannot claim
/// many.
const MOST_PER_BYTE: usize = 8;
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
    /// sRGB colour to which the Gaussians are added.
    pub background: [u8; 3],
    /// Layers, the most important first.
    pub layers: Vec<Layer>,
}

/// A decoded file.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoded {
    /// Columns, px.
    pub width: u32,
    /// Rows, px.
    pub height: u32,
    /// sRGB colour to which the Gaussians are added, 0..=1.
    pub background: [f32; 3],
    /// The Gaussians of all layers, without opacities.
    pub scene: Scene2d,
    /// Layers that were decoded whole, and all that the file was made with.
    pub layers: (usize, usize),
}

/// How much of a file must be there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Extent {
    /// All; a truncated file is an error.
    #[default]
    Whole,
    /// The header. Of a layer that is not complete, the Gaussians are decoded whose bytes are there:
    /// those of its upper rows. No checksum protects them.
    Prefix,
}

impl Layer {
    /// Length of this layer's Gaussians in a file, bits.
    pub fn bits(&self, size: (u32, u32)) -> f64 {
        let (mut cost, codes) = (Estimator::default(), self.sorted());
        code_layer(&mut cost, &Quantizer::new(self.head, size), (rows_of(&codes), codes.len()), &codes);
        cost.bits
    }

    /// This layer as layers of about equal numbers of Gaussians, from the top of the picture to its
    /// bottom. They are decoded side by side.
    pub fn stripes(&self, count: usize) -> Vec<Self> {
        let codes = self.sorted();
        let (mut stripes, mut rest) = (Vec::with_capacity(count), &codes[..]);
        for left in (1..=count).rev() {
            let last = rest.get((rest.len() / left).saturating_sub(1)).map_or(0, |code| code.row);
            let end = if left == 1 { rest.len() } else { rest.partition_point(|code| code.row <= last) };
            let (stripe, later) = rest.split_at(end);
            rest = later;
            stripes.push(Self { head: self.head, codes: stripe.to_vec() });
        }
        stripes.retain(|stripe| !stripe.codes.is_empty());
        stripes
    }

    fn sorted(&self) -> Vec<Code> {
        let mut codes = self.codes.clone();
        codes.sort_unstable();
        codes
    }
}

impl Picture {
    /// The bytes of the file.
    ///
    /// # Errors
    /// [`gs_core::Error::Size`] for an impossible size, [`Error::Value`] for an impossible number of
    /// layers or cells.
    pub fn encode(&self) -> Result<Vec<u8>, Error> {
        check_size(self.width, self.height)?;
        let layers = u8::try_from(self.layers.len()).map_err(|_| layers_error(self.layers.len()))?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend([VERSION, 0]);
        bytes.extend([self.width, self.height].map(|side| (side as u16).to_le_bytes()).concat());
        bytes.extend(self.background);
        bytes.push(layers);
        let mut checksum = Hasher::new();
        let mut checked = 0;
        for layer in &self.layers {
            let quantizer = Quantizer::new(layer.head, (self.width, self.height));
            let codes = layer.sorted();
            let rows = rows_of(&codes);
            check_layer(&quantizer, &rows, codes.len())?;
            let mut coder = Encoder::default();
            code_layer(&mut coder, &quantizer, (rows.clone(), codes.len()), &codes);
            let mut content = coder.finish();
            let least = layer.codes.len().div_ceil(MOST_PER_BYTE);
            content.resize(content.len().max(least), 0);
            let numbers = [codes.len(), content.len(), rows.start as usize, rows.len()];
            numbers.into_iter().for_each(|number| push_number(&mut bytes, number));
            let LayerHead { step, cell, margin, mean_ratio, shape_ratio, turn_ratio } = layer.head;
            bytes.extend(step.to_le_bytes());
            bytes.extend([cell, margin, mean_ratio, shape_ratio, turn_ratio]);
            bytes.extend(content);
            checksum.update(&bytes[checked..]);
            checked = bytes.len();
            bytes.extend(checksum.clone().finalize().to_le_bytes());
        }
        Ok(bytes)
    }
}

/// Whether bytes begin as a `.gsi` file does.
pub fn is_gsi(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

/// Decodes a file.
///
/// # Errors
/// [`Error::Magic`] for other bytes, [`Error::Unsupported`] for another version, and the errors of
/// damaged files. With [`Extent::Prefix`] a file that ends within a layer is not an error.
pub fn decode(bytes: &[u8], extent: Extent) -> Result<Decoded, Error> {
    if !is_gsi(bytes) {
        return Err(Error::Magic);
    }
    let mut reader = Reader { bytes, place: MAGIC.len(), part: "the header", checksum: Hasher::new(), checked: 0 };
    let [version, flags] = reader.array()?;
    for (what, value, known) in [("version", version, VERSION), ("the feature of flag", flags, 0)] {
        if value != known {
            return Err(Error::Unsupported { what, value: value.into() });
        }
    }
    let [width, height] = [reader.array()?, reader.array()?].map(|side| u32::from(u16::from_le_bytes(side)));
    check_size(width, height)?;
    let background = reader.array::<3>()?.map(|level| f32::from(level) / 255.0);
    let [count] = reader.array()?;
    debug_assert_eq!(reader.place, HEADER_BYTES);
    let mut decoded = Decoded { width, height, background, scene: Scene2d::default(), layers: (0, count.into()) };
    reader.part = "a layer";
    let mut layers = Vec::with_capacity(count.into());
    for number in 1..=usize::from(count) {
        match reader.layer(number, (width, height), extent) {
            Err(Error::Truncated { .. }) if extent == Extent::Prefix => break,
            layer => layers.push(layer?),
        }
    }
    let gaussians: Vec<_> = layers.par_iter().map(StoredLayer::gaussians).collect::<Result<_, _>>()?;
    decoded.scene = gaussians.into_iter().flatten().collect();
    decoded.layers.0 = layers.iter().filter(|layer| layer.complete).count();
    match bytes.len() - reader.place {
        0 => Ok(decoded),
        _ if decoded.layers.0 < usize::from(count) => Ok(decoded),
        more => {
            Err(Error::Value { what: "the number of bytes after the last layer", value: more as i64, allowed: "0" })
        }
    }
}

/// Reads a file from its beginning.
struct Reader<'a> {
    bytes: &'a [u8],
    place: usize,
    /// What is being read.
    part: &'static str,
    /// Checksum of the first `checked` bytes.
    checksum: Hasher,
    checked: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Error> {
        let end = self.place.checked_add(count).filter(|&end| end <= self.bytes.len());
        let Some(end) = end else {
            return Err(Error::Truncated { bytes: self.bytes.len(), part: self.part });
        };
        let taken = &self.bytes[self.place..end];
        self.place = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    /// A number below 2²⁸ in groups of seven bits, the lowest first; the highest bit of a byte says
    /// that more follow.
    fn number(&mut self) -> Result<usize, Error> {
        let mut number = 0;
        for place in 0..4 {
            let [byte] = self.array()?;
            number |= usize::from(byte & 127) << (7 * place);
            if byte < 128 {
                return Ok(number);
            }
        }
        Err(Error::Value { what: "a length", value: number as i64, allowed: "less than 2^28" })
    }

    /// The layer of this number, counted from 1.
    fn layer(&mut self, number: usize, size: (u32, u32), extent: Extent) -> Result<StoredLayer<'a>, Error> {
        let (count, length, first, rows) = (self.number()?, self.number()?, self.number()?, self.number()?);
        let [low, high, cell, margin, mean_ratio, shape_ratio, turn_ratio] = self.array()?;
        let there = self.bytes.len() - self.place;
        let complete = extent == Extent::Whole || there >= length.saturating_add(CHECKSUM_BYTES);
        let content = self.take(if complete { length } else { length.min(there) })?;
        if complete {
            self.checksum.update(&self.bytes[self.checked..self.place]);
            self.checked = self.place;
            let checksum = self.checksum.clone().finalize();
            if u32::from_le_bytes(self.array::<CHECKSUM_BYTES>()?) != checksum {
                return Err(Error::Checksum { layer: number });
            }
        } else {
            self.place = self.bytes.len();
        }
        let step = i16::from_le_bytes([low, high]);
        let head = LayerHead { step, cell, margin, mean_ratio, shape_ratio, turn_ratio };
        let quantizer = Quantizer::new(head, size);
        let rows = first as u32..(first + rows) as u32;
        check_layer(&quantizer, &rows, count)?;
        if count > length.saturating_mul(MOST_PER_BYTE) {
            let (what, allowed) = ("the number of Gaussians of a layer", "at most 8 for each of its bytes");
            return Err(Error::Value { what, value: count as i64, allowed });
        }
        Ok(StoredLayer { quantizer, rows, count, content, complete })
    }
}

/// A layer that is not decoded yet.
struct StoredLayer<'a> {
    quantizer: Quantizer,
    /// Rows of cells with Gaussians.
    rows: Range<u32>,
    /// Number of Gaussians.
    count: usize,
    content: &'a [u8],
    /// Whether all of the content is there.
    complete: bool,
}

impl StoredLayer<'_> {
    fn gaussians(&self) -> Result<Vec<Gaussian2d>, Error> {
        let new = if self.complete { Decoder::new } else { Decoder::of_truncated };
        let mut decoder = new(self.content);
        let codes = code_layer(&mut decoder, &self.quantizer, (self.rows.clone(), self.count), &[]);
        if self.complete && (decoder.is_invalid() || codes.len() != self.count) {
            let (what, allowed) = ("the number of Gaussians that can be decoded", "that of the layer's head");
            return Err(Error::Value { what, value: codes.len() as i64, allowed });
        }
        Ok(codes.iter().map(|code| self.quantizer.reconstruct(code)).collect())
    }
}

/// The rows of cells from the first to the last with Gaussians.
fn rows_of(sorted: &[Code]) -> Range<u32> {
    sorted.first().zip(sorted.last()).map_or(0..0, |(first, last)| first.row..last.row + 1)
}

/// Checks the numbers of a layer's head.
fn check_layer(quantizer: &Quantizer, rows: &Range<u32>, count: usize) -> Result<(), Error> {
    let LayerHead { cell, mean_ratio, shape_ratio, turn_ratio, .. } = *quantizer.head();
    let least = cell.min(mean_ratio).min(shape_ratio).min(turn_ratio);
    if least == 0 {
        return Err(Error::Value { what: "the cell size or a ratio of a layer", value: 0, allowed: "1 to 255" });
    }
    let grid = quantizer.grid();
    if rows.end > grid.rows {
        let (what, allowed) = ("the last row of cells of a layer", "within its grid");
        return Err(Error::Value { what, value: rows.end.into(), allowed });
    }
    let cells = u64::from(grid.columns) * rows.len() as u64;
    if cells > CELLS_PER_GAUSSIAN * count as u64 + FREE_CELLS {
        let allowed = "at most 16 for each Gaussian, and 65,536";
        return Err(Error::Value { what: "the number of cells of a layer", value: cells as i64, allowed });
    }
    Ok(())
}

fn layers_error(count: usize) -> Error {
    Error::Value { what: "the number of layers", value: count as i64, allowed: "at most 255" }
}

fn push_number(bytes: &mut Vec<u8>, mut number: usize) {
    while number > 127 {
        bytes.push((number & 127) as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
}
