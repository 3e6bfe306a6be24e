//! The container of SPZ files.
//!
//! Versions 2 and 3 are one gzip stream: a head of 16 bytes, the parameters one after the other,
//! then extensions. Version 4:
//!
//! | bytes | what |
//! |---|---|
//! | 0–15 | `NGSP`, version, number of Gaussians (u32 each); degree, fractional bits, flags, number of streams (u8 each) |
//! | 16–19 | where the table of contents starts, T; then 12 bytes without meaning |
//! | 32–T | extensions, where flag 2 is set: records of a type, a length (u32 each) and as many bytes |
//! | T … | for each stream its compressed and its decompressed size (u64 each), then the streams: zstd |
//!
//! The first 15 bytes are the same in all versions. The head determines the decompressed size,
//! which is checked against the file's size before anything is decompressed.

use std::io::{self, Read, Write};

use flate2::{Compression, read::GzDecoder, write::GzEncoder};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

#[cfg(feature = "zstd")]
use zstd::bulk::{compress, decompress};

use super::quantum::FractionalBits;
use crate::{
    error::Error,
    scene3d::{
        source::Source,
        values::{MAX_FILE_DEGREE, rest_of_degree},
    },
};

const MAGIC: [u8; 4] = *b"NGSP";
const GZIP_HEAD_BYTES: usize = 16;
const HEAD_BYTES: usize = 32;
const TABLE_ENTRY_BYTES: usize = 16;
const NEWEST_VERSION: u32 = 4;

/// Position of the flags in the head.
const FLAGS: usize = 14;

/// Flag of scenes that were trained with antialiasing; see [`TrainedWith`](crate::TrainedWith).
const ANTIALIASED: u8 = 1;

/// Flag of files with extensions.
const HAS_EXTENSIONS: u8 = 2;

/// Largest number of bytes of extensions that are read after the parameters of a gzip stream.
const MAX_EXTENSION_BYTES: u64 = 1 << 16;

/// Adobe's extension with the orientation of a file's axes.
const AXES_EXTENSION: u32 = 0xadbe_0003;

/// zstd's level for SH above degree 0. At Niantic's, 12, files are at most 2 % smaller, and take
/// nearly twice as long.
const SH_LEVEL: i32 = 9;

/// zstd's level for the other parameters, whose streams hardly shrink at any level.
const ZSTD_LEVEL: i32 = 6;

/// The content of the head.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    pub(super) version: u32,
    pub(super) count: u32,
    pub(super) degree: u8,
    pub(super) fraction: FractionalBits,
    pub(super) antialiased: bool,
}

/// The parameters of all Gaussians, in sequence.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Streams<B> {
    pub(super) positions: B,
    pub(super) opacities: B,
    pub(super) colors: B,
    pub(super) scales: B,
    pub(super) rotations: B,
    /// SH above degree 0; empty at degree 0.
    pub(super) sh: B,
}

/// An extension's record.
#[derive(Debug)]
pub(super) struct Extension {
    kind: u32,
    content: Vec<u8>,
}

impl Extension {
    /// The flips of a file's axes, if this record contains them.
    pub(super) fn axes(&self) -> Option<DMat3> {
        let number = u32::from_le_bytes(*self.content.first_chunk()?);
        if self.kind == AXES_EXTENSION { axes_of_number(number) } else { None }
    }
}

/// The map from a file's axes to ours (right, down, forward) by the number of [`AXES_EXTENSION`]. 1
/// to 8 have left or right as x, down or up as y, back or front as z; 9 to 16 have z and y swapped.
fn axes_of_number(number: u32) -> Option<DMat3> {
    let bits = number.checked_sub(1).filter(|&bits| bits < 16)?;
    let sign = |bit: u32| if bits >> bit & 1 == 1 { 1.0 } else { -1.0 };
    let (right, up, front) = (DVec3::X * sign(0), DVec3::Y * -sign(1), DVec3::Z * sign(2));
    Some(if bits < 8 { DMat3::from_cols(right, up, front) } else { DMat3::from_cols(right, front, up) })
}

/// A decompressed file.
#[derive(Debug)]
pub(super) struct Packed {
    pub(super) head: Head,
    pub(super) extensions: Vec<Extension>,
    /// All streams in sequence.
    bytes: Vec<u8>,
}

impl Head {
    /// Size of each stream, in order.
    fn sizes(&self) -> [u64; 6] {
        let rotation = if self.version == 2 { 3 } else { 4 };
        [9, 1, 3, 3, rotation, rest_of_degree(self.degree) as u64].map(|each| each * u64::from(self.count))
    }

    /// Parses the common part from the first bytes of the head; `place` is their position.
    fn parse(source: &Source<'_>, bytes: &[u8; GZIP_HEAD_BYTES], place: &str) -> Result<Self, Error> {
        let bad = |byte, expected: &str, found: String| source.damaged(byte, format!("{expected}{place}"), found);
        let u32_at = |k: usize| u32::from_le_bytes([bytes[k], bytes[k + 1], bytes[k + 2], bytes[k + 3]]);
        if bytes[..4] != MAGIC {
            return Err(bad(0, "`NGSP`", format!("{:02x?}", &bytes[..4])));
        }
        let (version, count) = (u32_at(4), u32_at(8));
        if version > NEWEST_VERSION {
            return Err(Error::too_new(source.path, source.what, NEWEST_VERSION, version));
        }
        if version == 1 {
            let hint = "write it again with a current version of the program";
            return Err(Error::unsupported(source.path, "version 1 of SPZ", hint));
        }
        if version < 2 {
            return Err(bad(4, "version 2, 3 or 4", version.to_string()));
        }
        let degree = bytes[12];
        if degree > MAX_FILE_DEGREE {
            return Err(bad(12, "an SH degree of 0 to 4", degree.to_string()));
        }
        let fraction = FractionalBits::new(bytes[13])
            .ok_or_else(|| bad(13, "at most 23 fractional bits", bytes[13].to_string()))?;
        let antialiased = bytes[FLAGS] & ANTIALIASED != 0;
        let head = Self { version, count, degree, fraction, antialiased };
        source.check_claim(source.bytes.len() as u64, head.sizes().iter().sum())?;
        Ok(head)
    }
}

impl Packed {
    /// The streams, with the lengths that the head requires.
    pub(super) fn streams(&self) -> Streams<&[u8]> {
        let mut rest = self.bytes.as_slice();
        let [positions, opacities, colors, scales, rotations, sh] =
            self.head.sizes().map(|size| rest.split_off(..size as usize).unwrap_or_default());
        Streams { positions, opacities, colors, scales, rotations, sh }
    }
}

/// Reads a file of any version.
pub(super) fn read(source: &Source<'_>) -> Result<Packed, Error> {
    if source.bytes.starts_with(&MAGIC) { read_streams(source) } else { read_gzip(source) }
}

fn read_gzip(source: &Source<'_>) -> Result<Packed, Error> {
    let place = " in the decompressed data";
    let damaged = |error: io::Error| source.damaged(0, "a gzip stream", error.to_string());
    let mut stream = GzDecoder::new(source.bytes);
    let mut start = [0; GZIP_HEAD_BYTES];
    stream.read_exact(&mut start).map_err(damaged)?;
    let head = Head::parse(source, &start, place)?;
    if head.version > 3 {
        return Err(source.damaged(4, format!("version 2 or 3{place}"), head.version.to_string()));
    }
    let size: u64 = head.sizes().iter().sum();
    let mut bytes = Vec::with_capacity(size as usize);
    stream.by_ref().take(size).read_to_end(&mut bytes).map_err(damaged)?;
    if bytes.len() as u64 != size {
        let found = format!("{}", bytes.len());
        return Err(source.damaged(source.bytes.len(), format!("{size} bytes of parameters{place}"), found));
    }
    // Reads to the end, so that the checksum is verified.
    let mut rest = Vec::new();
    stream.take(MAX_EXTENSION_BYTES).read_to_end(&mut rest).map_err(damaged)?;
    let extensions = if start[FLAGS] & HAS_EXTENSIONS != 0 { extensions(&rest) } else { Vec::new() };
    Ok(Packed { head, extensions, bytes })
}

fn read_streams(source: &Source<'_>) -> Result<Packed, Error> {
    let start: [u8; HEAD_BYTES] = source.array(0, "the head")?;
    let head = Head::parse(source, &source.array(0, "the head")?, "")?;
    if head.version < NEWEST_VERSION {
        return Err(source.damaged(4, "version 4 where there is no gzip stream", head.version.to_string()));
    }
    let sizes = head.sizes();
    let wanted = sizes.iter().filter(|&&size| size > 0).count();
    if usize::from(start[15]) != wanted {
        return Err(source.damaged(15, format!("{wanted} streams"), start[15].to_string()));
    }
    let table = source.u32(16, "the head")? as usize;
    let between = table.checked_sub(HEAD_BYTES).and_then(|_| source.bytes.get(HEAD_BYTES..table));
    let Some(between) = between else {
        return Err(source.damaged(16, "where the table of contents starts", format!("byte {table}")));
    };
    let extensions = if start[FLAGS] & HAS_EXTENSIONS != 0 { extensions(between) } else { Vec::new() };
    let mut at = table + wanted * TABLE_ENTRY_BYTES;
    let mut bytes = Vec::with_capacity(sizes.iter().sum::<u64>() as usize);
    for (k, size) in sizes.into_iter().filter(|&size| size > 0).enumerate() {
        let entry = table + k * TABLE_ENTRY_BYTES;
        let (compressed, claimed) =
            (source.u64(entry, "the table of contents")?, source.u64(entry + 8, "the table of contents")?);
        if claimed != size {
            return Err(source.damaged(entry + 8, format!("a stream of {size} bytes"), claimed.to_string()));
        }
        let stream = source.slice(at, compressed, "a stream")?;
        let damaged = |found: String| source.damaged(at, format!("a zstd stream of {size} bytes"), found);
        // Decoded at once into memory of the right size: piecewise decoding would allocate what a
        // frame claims as its window.
        let part = decompress(stream, size as usize).map_err(|error| damaged(error.to_string()))?;
        if part.len() as u64 != size {
            return Err(damaged(part.len().to_string()));
        }
        bytes.extend(part);
        at += stream.len();
    }
    Ok(Packed { head, extensions, bytes })
}

#[cfg(not(feature = "zstd"))]
fn without_zstd() -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, "SPZ version 4 needs zstd, and this build is without it")
}

#[cfg(not(feature = "zstd"))]
fn compress(_: &[u8], _: i32) -> io::Result<Vec<u8>> {
    Err(without_zstd())
}

#[cfg(all(not(feature = "zstd"), target_family = "wasm"))]
fn decompress(stream: &[u8], size: usize) -> io::Result<Vec<u8>> {
    let decoder = ruzstd::decoding::StreamingDecoder::new(stream).map_err(io::Error::other)?;
    let mut bytes = Vec::with_capacity(size);
    // A byte more than there should be is noticed by the caller.
    decoder.take(size as u64 + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(all(not(feature = "zstd"), not(target_family = "wasm")))]
fn decompress(_: &[u8], _: usize) -> io::Result<Vec<u8>> {
    Err(without_zstd())
}

/// The records of extensions; a truncated record ends them.
fn extensions(mut bytes: &[u8]) -> Vec<Extension> {
    let mut records = Vec::new();
    while let Some((record, rest)) = bytes.split_first_chunk::<8>() {
        let [a, b, c, d, e, f, g, h] = *record;
        let Some(content) = rest.get(..u32::from_le_bytes([e, f, g, h]) as usize) else { break };
        records.push(Extension { kind: u32::from_le_bytes([a, b, c, d]), content: content.to_vec() });
        bytes = &rest[content.len()..];
    }
    records
}

/// Encodes a file of the head's version, 3 or 4.
pub(super) fn write(head: &Head, streams: &Streams<Vec<u8>>) -> io::Result<Vec<u8>> {
    let Streams { positions, opacities, colors, scales, rotations, sh } = streams;
    let streams = [positions, opacities, colors, scales, rotations, sh];
    let mut start = MAGIC.to_vec();
    start.extend([head.version, head.count].map(u32::to_le_bytes).concat());
    start.extend([head.degree, head.fraction.get(), if head.antialiased { ANTIALIASED } else { 0 }]);
    if head.version < NEWEST_VERSION {
        start.push(0);
        let mut stream = GzEncoder::new(Vec::new(), Compression::best());
        stream.write_all(&start)?;
        streams.into_iter().try_for_each(|bytes| stream.write_all(bytes))?;
        return stream.finish();
    }
    let levels = [ZSTD_LEVEL, ZSTD_LEVEL, ZSTD_LEVEL, ZSTD_LEVEL, ZSTD_LEVEL, SH_LEVEL];
    let streams: Vec<(&Vec<u8>, i32)> =
        streams.into_iter().zip(levels).filter(|(bytes, _)| !bytes.is_empty()).collect();
    start.push(streams.len() as u8);
    start.extend((HEAD_BYTES as u32).to_le_bytes());
    start.resize(HEAD_BYTES, 0);
    let compressed: Vec<Vec<u8>> =
        streams.par_iter().map(|&(bytes, level)| compress(bytes, level)).collect::<io::Result<_>>()?;
    for (part, (bytes, _)) in compressed.iter().zip(&streams) {
        start.extend([part.len() as u64, bytes.len() as u64].map(u64::to_le_bytes).concat());
    }
    compressed.iter().for_each(|part| start.extend(part));
    Ok(start)
}
