//! The properties of a chunk: the numbers of all its Gaussians.
//!
//! | encoding | what |
//! |---|---|
//! | `f32`, `f16`, `u32`, `u16` | little-endian |
//! | `f32_lebytes`, `f16_lebytes` | first the lowest byte of each number, then the next of each, and so on |
//! | `r8` | bytes; 0 to 255 stand for `min` to `max` |
//! | `s8` | signed bytes; 127 stands for `max` |
//! | `r8_delta`, `s8_delta` | as above, but each byte is the difference from the Gaussian before |
//! | `ln_f16` | logarithms of scales |
//! | `ln_0r8` | bytes; 0 is a scale of 0, 1 to 255 stand for logarithms from `min` to `max` |
//! | `oct88r8` | a unit quaternion's axis as a point on an octahedron (two bytes), and its angle: 0 to 255 stand for 0 to π. The three bytes of a Gaussian are together. |
//!
//! Quaternions are (x, y, z), with w at least 0, in `f32` and `f16`. With the compression `gz`, bytes are a stream of
//! Deflate without a head.

use std::{f32::consts::FRAC_PI_2, io::Read};

use flate2::read::DeflateDecoder;
use glam::Vec3;
use serde::Deserialize;

use crate::{
    error::Error,
    scene3d::{
        source::Source,
        values::{of_half, with_largest},
    },
};

pub(super) const PLACES: &[&str] = &["f32", "f16", "f32_lebytes", "f16_lebytes"];
pub(super) const OPACITIES: &[&str] = &["f32", "f16", "r8"];
pub(super) const COLORS: &[&str] = &["f32", "f16", "r8", "r8_delta"];
pub(super) const SCALES: &[&str] = &["f32", "ln_f16", "ln_0r8"];
pub(super) const ROTATIONS: &[&str] = &["f32", "f16", "oct88r8"];
pub(super) const SH: &[&str] = &["f32", "f16", "r8", "r8_delta", "s8", "s8_delta"];

/// Where and how a property is stored.
#[derive(Debug, Deserialize)]
pub(super) struct Property {
    /// From the end of the chunk's head.
    offset: u64,
    bytes: u64,
    property: String,
    encoding: String,
    compression: Option<String>,
    min: Option<f32>,
    max: Option<f32>,
}

/// A part of a file with its properties.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chunk<'a> {
    pub(super) source: &'a Source<'a>,
    /// Where the first property is, bytes.
    pub(super) start: usize,
    pub(super) properties: &'a [Property],
}

/// Numbers: the first of all Gaussians, then the second, and so on.
#[derive(Debug)]
pub(super) struct Planes {
    pub(super) values: Vec<f32>,
    /// Number of Gaussians.
    pub(super) number: usize,
    encoding: String,
}

impl Planes {
    /// Triple `k` of a Gaussian.
    pub(super) fn triple(&self, k: usize, i: usize) -> Vec3 {
        Vec3::from([0, 1, 2].map(|axis| self.values[(3 * k + axis) * self.number + i]))
    }

    pub(super) fn are_logarithms(&self) -> bool {
        self.encoding.starts_with("ln")
    }

    pub(super) fn are_bytes(&self) -> bool {
        self.encoding == "r8"
    }

    /// The quaternion (w, x, y, z) of a Gaussian.
    pub(super) fn rotation(&self, i: usize) -> [f32; 4] {
        if self.encoding != "oct88r8" {
            return with_largest(0, self.triple(0, i).to_array());
        }
        let [u, v, angle] = [0, 1, 2].map(|k| self.values[3 * i + k] / 255.0);
        let [x, y] = [2.0 * u - 1.0, 2.0 * v - 1.0];
        let z = 1.0 - x.abs() - y.abs();
        // The lower half is folded outwards over the edges of the upper.
        let fold = |v: f32| v - z.min(0.0).abs().copysign(v);
        let axis = Vec3::new(fold(x), fold(y), z).normalize();
        let (sine, cosine) = (angle * FRAC_PI_2).sin_cos();
        [cosine, axis.x * sine, axis.y * sine, axis.z * sine]
    }
}

impl Chunk<'_> {
    fn find(&self, name: &str, encodings: &[&str]) -> Result<Option<&Property>, Error> {
        let Some(found) = self.properties.iter().find(|found| found.property == name) else { return Ok(None) };
        if !encodings.contains(&found.encoding.as_str()) {
            let what = format!("the encoding {:.20?} of `{name}`", found.encoding);
            return Err(Error::unsupported(self.source.path, what, "export a PLY"));
        }
        Ok(Some(found))
    }

    /// The bytes of a property, of which there must be `len`.
    fn bytes(&self, property: &Property, len: usize) -> Result<Vec<u8>, Error> {
        let (source, name) = (self.source, &property.property);
        let at = usize::try_from(property.offset).ok().and_then(|offset| self.start.checked_add(offset));
        let at = at.ok_or_else(|| {
            source.damaged(self.start, format!("an offset of `{name}` in the file"), property.offset.to_string())
        })?;
        let stored = source.slice(at, property.bytes, name)?;
        let mut bytes = Vec::new();
        match property.compression.as_deref() {
            None => bytes.extend(stored),
            Some("gz") => {
                let mut stream = DeflateDecoder::new(stored).take(len as u64 + 1);
                stream.read_to_end(&mut bytes).map_err(|e| source.damaged(at, "a stream of Deflate", e.to_string()))?;
            }
            Some(other) => {
                return Err(Error::unsupported(source.path, format!("the compression {other:.20?}"), "export a PLY"));
            }
        }
        match bytes.len() == len {
            true => Ok(bytes),
            false => Err(source.damaged(at, format!("{len} bytes of `{name}`"), format!("{}", bytes.len()))),
        }
    }

    /// The numbers of a property, `width` for each of `number` Gaussians; `None` where the chunk has none.
    pub(super) fn numbers(
        &self,
        name: &str,
        width: usize,
        number: usize,
        encodings: &[&str],
    ) -> Result<Option<Planes>, Error> {
        let Some(property) = self.find(name, encodings)? else { return Ok(None) };
        let all = width * number;
        let bytes = |size: usize| self.bytes(property, size * all);
        let half = |bytes: [u8; 2]| of_half(u16::from_le_bytes(bytes));
        let end = |end: Option<f32>, which: &str| {
            let end = end.filter(|end| end.is_finite());
            end.ok_or_else(|| self.source.damaged(self.start, format!("a `{which}` of `{name}`"), "none"))
        };
        // Sums over the Gaussians of each plane, if they are differences.
        let summed = |mut bytes: Vec<u8>| {
            for plane in bytes.chunks_mut(number.max(1)).filter(|_| property.encoding.ends_with("_delta")) {
                let mut sum = 0_u8;
                plane.iter_mut().for_each(|byte| {
                    sum = sum.wrapping_add(*byte);
                    *byte = sum;
                });
            }
            bytes
        };
        let values: Vec<f32> = match property.encoding.as_str() {
            "f32" => bytes(4)?.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
            "f32_lebytes" => {
                let bytes = bytes(4)?;
                (0..all).map(|k| f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[byte * all + k]))).collect()
            }
            "f16_lebytes" => {
                let bytes = bytes(2)?;
                (0..all).map(|k| half([bytes[k], bytes[all + k]])).collect()
            }
            "f16" | "ln_f16" => bytes(2)?.as_chunks().0.iter().map(|bytes| half(*bytes)).collect(),
            "oct88r8" => bytes(1)?.into_iter().map(f32::from).collect(),
            "s8" | "s8_delta" => {
                let max = end(property.max, "max")?;
                summed(bytes(1)?).into_iter().map(|byte| f32::from(byte.cast_signed()) / 127.0 * max).collect()
            }
            "ln_0r8" => {
                let [min, max] = [end(property.min, "min")?, end(property.max, "max")?];
                let log = |byte: u8| min + (f32::from(byte) - 1.0) * ((max - min) / 254.0);
                bytes(1)?.into_iter().map(|byte| if byte == 0 { f32::NEG_INFINITY } else { log(byte) }).collect()
            }
            _ => {
                let [min, max] = [end(property.min, "min")?, end(property.max, "max")?];
                summed(bytes(1)?).into_iter().map(|byte| f32::from(byte) / 255.0 * (max - min) + min).collect()
            }
        };
        Ok(Some(Planes { values, number, encoding: property.encoding.clone() }))
    }

    /// The whole numbers of a property, one for each Gaussian; `None` where the chunk has none.
    pub(super) fn whole_numbers(&self, name: &str, number: usize) -> Result<Option<Vec<u32>>, Error> {
        let Some(property) = self.find(name, &["u16", "u32"])? else { return Ok(None) };
        Ok(Some(match property.encoding.as_str() {
            "u16" => {
                self.bytes(property, 2 * number)?.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b).into()).collect()
            }
            _ => self.bytes(property, 4 * number)?.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect(),
        }))
    }
}
