//! Reading a file. `docs/gsi.md` specifies it; `file.rs` writes it.

use std::ops::Range;

use gs_core::{Gaussian2d, Scene as _, Scene2d, check_size};
use rayon::prelude::*;

use crate::{
    coder::Decoder,
    error::Error,
    file::{ALPHA, Checksum, MAGIC, MOST_PER_BYTE, PROFILE, Part, VERSION, check_layer, layer_count, order},
    layer::{LayerHead, code_layer},
    profile,
    quantizer::Quantizer,
};

/// Length of a layer's checksum.
const CHECKSUM_BYTES: usize = 4;

/// A decoded file.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoded {
    /// Columns, px.
    pub width: u32,
    /// Rows, px.
    pub height: u32,
    /// Colour to which the Gaussians are added, 0..=1.
    pub background: [f32; 3],
    /// The Gaussians of all layers, without opacities.
    pub scene: Scene2d,
    /// Alpha, by which the colours are premultiplied; `None` for an opaque picture.
    pub alpha: Option<DecodedAlpha>,
    /// ICC profile of the colours, as it is in the file; empty for sRGB.
    pub profile: Vec<u8>,
    /// Layers that were decoded whole, and all that the file was made with; those of alpha count, too.
    pub layers: (usize, usize),
}

/// The alpha of a decoded file: another sum of Gaussians, whose red is the alpha.
#[derive(Debug, Clone, PartialEq)]
pub struct DecodedAlpha {
    /// Alpha to which the Gaussians are added, 0..=1.
    pub background: f32,
    /// The Gaussians of all layers, without opacities.
    pub scene: Scene2d,
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
    let mut reader = Reader { bytes, place: MAGIC.len(), part: "the header", checksum: Checksum::default() };
    let (mut decoded, parts) = reader.header()?;
    reader.part = "a layer";
    let mut layers = Vec::with_capacity(parts.len());
    for number in 1..=parts.len() {
        match reader.layer(number, (decoded.width, decoded.height), extent) {
            Err(Error::Truncated { .. }) if extent == Extent::Prefix => break,
            layer => layers.push(layer?),
        }
    }
    let gaussians: Vec<_> = layers.par_iter().map(StoredLayer::gaussians).collect::<Result<_, _>>()?;
    for (gaussians, part) in gaussians.into_iter().zip(parts) {
        let scene = match &mut decoded.alpha {
            Some(alpha) if part == Part::Alpha => &mut alpha.scene,
            _ => &mut decoded.scene,
        };
        gaussians.into_iter().for_each(|gaussian| scene.push(gaussian));
    }
    decoded.layers.0 = layers.iter().filter(|layer| layer.complete).count();
    if decoded.layers.0 == decoded.layers.1 {
        let more = (bytes.len() - reader.place) as i64;
        Error::within("the number of bytes after the last layer", more, 0..=0, "0")?;
    }
    Ok(decoded)
}

/// Reads a file from its beginning.
struct Reader<'a> {
    bytes: &'a [u8],
    place: usize,
    /// What is being read.
    part: &'static str,
    checksum: Checksum,
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

    /// What the header says, without Gaussians, and the part of each layer that follows.
    fn header(&mut self) -> Result<(Decoded, Vec<Part>), Error> {
        let [version, flags] = self.array()?;
        let unknown = flags & !(ALPHA | PROFILE);
        for (what, value, known) in [("version", version, VERSION), ("the feature of flag", unknown, 0)] {
            if value != known {
                return Err(Error::Unsupported { what, value: value.into() });
            }
        }
        let [width, height] = [self.array()?, self.array()?].map(|side| u32::from(u16::from_le_bytes(side)));
        check_size(width, height)?;
        let level = |byte: u8| f32::from(byte) / 255.0;
        let background = self.array::<3>()?.map(level);
        let colors = self.layer_count()?;
        let (mut alpha, mut of_alpha) = (None, 0);
        if flags & ALPHA != 0 {
            let [background] = self.array()?;
            alpha = Some(DecodedAlpha { background: level(background), scene: Scene2d::default() });
            of_alpha = self.layer_count()?;
        }
        let profile = if flags & PROFILE != 0 { self.profile()? } else { Vec::new() };
        let (scene, layers) = (Scene2d::default(), (0, colors + of_alpha));
        let decoded = Decoded { width, height, background, scene, alpha, profile, layers };
        Ok((decoded, order(of_alpha, colors).collect()))
    }

    fn layer_count(&mut self) -> Result<usize, Error> {
        let [count] = self.array()?;
        layer_count(count.into()).map(usize::from)
    }

    fn profile(&mut self) -> Result<Vec<u8>, Error> {
        let length = u16::from_le_bytes(self.array()?);
        profile::unpack(self.take(length.into())?)
    }

    /// The layer of this number, counted from 1.
    fn layer(&mut self, number: usize, size: (u32, u32), extent: Extent) -> Result<StoredLayer<'a>, Error> {
        let (count, length, first, rows) = (self.number()?, self.number()?, self.number()?, self.number()?);
        let [low, high, cell, margin, mean_ratio, shape_ratio, turn_ratio] = self.array()?;
        let there = self.bytes.len() - self.place;
        let complete = extent == Extent::Whole || there >= length.saturating_add(CHECKSUM_BYTES);
        let content = self.take(if complete { length } else { length.min(there) })?;
        if complete {
            let checksum = self.checksum.of(&self.bytes[..self.place]);
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
        let most = length.saturating_mul(MOST_PER_BYTE) as i64;
        let allowed = "at most 8 for each of its bytes";
        Error::within("the number of Gaussians of a layer", count as i64, 0..=most, allowed)?;
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
