//! The file: header, layers, checksums. `docs/gsi.md` specifies it.

use gs_core::{Scene2d, check_size};

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
        let mut cost = Estimator::default();
        code_layer(&mut cost, &Quantizer::new(self.head, size), self.codes.len(), &self.sorted());
        cost.bits
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
        for layer in &self.layers {
            let quantizer = Quantizer::new(layer.head, (self.width, self.height));
            check_layer(&quantizer, layer.codes.len())?;
            let mut coder = Encoder::default();
            code_layer(&mut coder, &quantizer, layer.codes.len(), &layer.sorted());
            let mut content = coder.finish();
            let least = layer.codes.len().div_ceil(MOST_PER_BYTE);
            content.resize(content.len().max(least), 0);
            push_number(&mut bytes, layer.codes.len());
            push_number(&mut bytes, content.len());
            let LayerHead { step, cell, margin, mean_ratio, shape_ratio, turn_ratio } = layer.head;
            bytes.extend(step.to_le_bytes());
            bytes.extend([cell, margin, mean_ratio, shape_ratio, turn_ratio]);
            bytes.extend(content);
            bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
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
    let mut reader = Reader { bytes, place: MAGIC.len(), part: "the header" };
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
    for layer in 1..=usize::from(count) {
        let (gaussians, complete) = match reader.layer(layer, (width, height), extent) {
            Err(Error::Truncated { .. }) if extent == Extent::Prefix => break,
            gaussians => gaussians?,
        };
        gaussians.into_iter().for_each(|g| gs_core::Scene::push(&mut decoded.scene, g));
        if !complete {
            break;
        }
        decoded.layers.0 = layer;
    }
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

    /// The Gaussians of a layer, and whether it is complete.
    fn layer(
        &mut self,
        layer: usize,
        size: (u32, u32),
        extent: Extent,
    ) -> Result<(Vec<gs_core::Gaussian2d>, bool), Error> {
        let (count, length) = (self.number()?, self.number()?);
        let [low, high, cell, margin, mean_ratio, shape_ratio, turn_ratio] = self.array()?;
        let there = self.bytes.len() - self.place;
        let complete = extent == Extent::Whole || there >= length.saturating_add(CHECKSUM_BYTES);
        let content = self.take(if complete { length } else { length.min(there) })?;
        if complete {
            let checksum = crc32fast::hash(&self.bytes[..self.place]);
            if u32::from_le_bytes(self.array::<CHECKSUM_BYTES>()?) != checksum {
                return Err(Error::Checksum { layer });
            }
        }
        let step = i16::from_le_bytes([low, high]);
        let head = LayerHead { step, cell, margin, mean_ratio, shape_ratio, turn_ratio };
        let quantizer = Quantizer::new(head, size);
        check_layer(&quantizer, count)?;
        if count > length.saturating_mul(MOST_PER_BYTE) {
            let (what, allowed) = ("the number of Gaussians of a layer", "at most 8 for each of its bytes");
            return Err(Error::Value { what, value: count as i64, allowed });
        }
        let mut decoder = if complete { Decoder::new(content) } else { Decoder::of_truncated(content) };
        let codes = code_layer(&mut decoder, &quantizer, count, &[]);
        if complete && (decoder.is_invalid() || codes.len() != count) {
            let (what, allowed) = ("the number of Gaussians that can be decoded", "that of the layer's head");
            return Err(Error::Value { what, value: codes.len() as i64, allowed });
        }
        if !complete {
            self.place = self.bytes.len();
        }
        Ok((codes.iter().map(|code| quantizer.reconstruct(code)).collect(), complete))
    }
}

/// Checks the numbers of a layer's head.
fn check_layer(quantizer: &Quantizer, count: usize) -> Result<(), Error> {
    let LayerHead { cell, mean_ratio, shape_ratio, turn_ratio, .. } = *quantizer.head();
    let least = cell.min(mean_ratio).min(shape_ratio).min(turn_ratio);
    if least == 0 {
        return Err(Error::Value { what: "the cell size or a ratio of a layer", value: 0, allowed: "1 to 255" });
    }
    let cells = quantizer.grid().cells();
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
