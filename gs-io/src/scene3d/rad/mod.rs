//! RAD, the format of Spark, with a tree of levels of detail. [`read`] reads its leaves, which are the whole scene, and
//! [`levels()`] all of the tree.
//!
//! | bytes | what |
//! |---|---|
//! | 0–7 | `RAD0`, length of the JSON (u32) |
//! | 8 … | JSON, filled to a multiple of 8 bytes: number of Gaussians, degree, byte ranges of the chunks |
//! | then | chunks, each of at most 65,536 Gaussians; or in files of their own |
//!
//! A chunk is `RADC`, the length of its JSON, JSON (as above), the length of the rest (u64), and then the properties,
//! whose byte ranges, encodings and value ranges are in its JSON. A property has all values of the first number of its
//! Gaussians, then all of the second, and so on; see [`planes`] for encodings.
//!
//! With levels of detail, Gaussian 0 stands in place of all others. Each one with `child_count` children stands in
//! place of them, which are consecutive from `child_start`, and come after it. Viewers go down from the first as far
//! as the size in a picture demands. Opacities of those with children may be up to 2, which stands for a wider plateau:
//! with α > 1, d = 4 α − 3 and n = exp((d² − 1) / e), Spark draws 1 − (1 − g)ⁿ in place of a Gaussian g. Here they become
//! opaque Gaussians of the same width at half height.
//!
//! Axes are those of the PLY that it was made from.
//!
//! *Source:* sparkjsdev/spark 2, `rust/spark-lib/src/rad.rs`, `splat_encode.rs` and `rust/spark-rs/src/lod_tree.rs`.

mod levels;
mod planes;
#[cfg(feature = "write")]
mod tree;
#[cfg(feature = "write")]
mod write;

use std::{borrow::Cow, collections::BTreeMap, f32::consts::E, ops::Range};

use glam::Vec3;
use gs_core::{Scene3d, constants::SH_C0};
use serde::{Deserialize, de::DeserializeOwned};

pub(super) use self::levels::levels;
use self::planes::{Chunk, Planes, Property};
#[cfg(feature = "write")]
pub(super) use self::write::encode;
use super::{
    File3d, Format3d,
    conversion_loss::Clamp,
    source::Source,
    streamed::stays_inside,
    values::{MAX_DEGREE, log_of_scale, logit_of_opacity, rest_of_degree},
};
use crate::error::Error;

pub(super) const MAGIC: [u8; 4] = *b"RAD0";
const CHUNK_MAGIC: [u8; 4] = *b"RADC";
const VERSION: u64 = 1;

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Meta {
    version: u64,
    #[serde(rename = "type")]
    kind: String,
    count: u64,
    max_sh: Option<u8>,
    lod_tree: Option<bool>,
    /// Number of SH in the palette, if there is one.
    sh_code_count: Option<u32>,
    chunks: Vec<ByteRange>,
}

/// Where a chunk is, from the end of the first JSON, or in another file.
#[derive(Debug, Deserialize)]
struct ByteRange {
    offset: u64,
    bytes: u64,
    filename: Option<String>,
}

#[derive(Debug, Deserialize)]
struct ChunkMeta {
    version: u64,
    /// Number of its first Gaussian.
    base: u64,
    count: u64,
    properties: Vec<Property>,
}

/// The Gaussians that are read.
enum Which {
    /// Those that stand for no others.
    Leaves,
    All,
}

/// Reads a scene of degree 0 to 3: those Gaussians that stand for no others.
pub(super) fn read(source: &Source<'_>, format: Format3d) -> Result<File3d, Error> {
    Ok(contents(source, format, Which::Leaves)?.0)
}

/// Reads Gaussians. If all are read, also returns the children of each.
fn contents(source: &Source<'_>, format: Format3d, which: Which) -> Result<(File3d, Vec<Range<usize>>), Error> {
    let (meta, start): (Meta, usize) = json(source, 0, MAGIC, "the head")?;
    check_version(source, meta.version)?;
    if meta.kind != "gsplat" {
        return Err(Error::unsupported(source.path, format!("a RAD file of {:.20?}", meta.kind), "export a PLY"));
    }
    let degree = meta.max_sh.unwrap_or(0);
    if degree > MAX_DEGREE {
        return Err(source.damaged(8, "an SH degree of 0 to 3", degree.to_string()));
    }
    // All files first, so that the claim is checked against the bytes of all.
    let (mut beside, mut files) = (BTreeMap::new(), Vec::new());
    for range in &meta.chunks {
        files.push(match &range.filename {
            None => (Cow::Borrowed(source.path), Cow::Borrowed(source.bytes), start),
            Some(name) if stays_inside(name) => {
                let path = source.path.with_file_name(name);
                let bytes = source.read_beside(&path, "a chunk of a RAD file")?;
                if beside.insert(path.clone(), bytes.len() as u64).is_some() {
                    return Err(source.damaged(8, "another file for each chunk", format!("{name:?} twice")));
                }
                (Cow::Owned(path), Cow::Owned(bytes), 0)
            }
            Some(name) => {
                let found = format!("{:?}", name.chars().take(60).collect::<String>());
                return Err(source.damaged(8, "names of chunks below its folder", found));
            }
        });
    }
    let bytes = beside.values().fold(source.bytes.len() as u64, |sum, bytes| sum.saturating_add(*bytes));
    let codes = meta.sh_code_count.unwrap_or(0);
    let numbers = 4 * (14 + rest_of_degree(degree) as u64);
    source.check_claim(bytes, meta.count.saturating_add(codes.into()).saturating_mul(numbers))?;
    let mut reading = Reading {
        scene: Scene3d { sh_degree: degree, ..Scene3d::default() },
        count: meta.count,
        next: 0,
        has_tree: meta.lod_tree.unwrap_or(false),
        has_parent: vec![false; meta.count as usize],
        children: matches!(which, Which::All).then(Vec::new),
        codes: codes as usize,
        palette: Default::default(),
        opacities: Clamp::new("opacities", 0.0, 1.0, 0.5 / 255.0),
    };
    for (range, (path, bytes, start)) in meta.chunks.iter().zip(&files) {
        let file = Source { path, bytes, ..*source };
        let at = usize::try_from(range.offset).ok().and_then(|offset| start.checked_add(offset));
        let at = at.ok_or_else(|| source.damaged(8, "offsets of chunks in the file", range.offset.to_string()))?;
        let end = at + file.slice(at, range.bytes, "a chunk")?.len();
        reading.chunk(&Source { bytes: &bytes[..end], ..file }, at)?;
    }
    if reading.next != meta.count {
        return Err(source.damaged(8, format!("{} Gaussians in the chunks", meta.count), reading.next.to_string()));
    }
    let losses = Vec::from_iter(reading.opacities.loss());
    let file = File3d { losses, ..File3d::of(format, reading.scene).beside(beside) };
    Ok((file, reading.children.unwrap_or_default()))
}

/// What of a file has been read.
struct Reading {
    scene: Scene3d,
    /// Number of Gaussians in the file, with those that stand for others.
    count: u64,
    /// Number of the next chunk's first Gaussian.
    next: u64,
    has_tree: bool,
    /// Whether each of these Gaussians is a child so far.
    has_parent: Vec<bool>,
    /// The children of each Gaussian, if those with children are read, too.
    children: Option<Vec<Range<usize>>>,
    /// Length of the palette, and its SH of each degree above 0.
    codes: usize,
    palette: [Option<Planes>; 3],
    opacities: Clamp,
}

impl Reading {
    /// Appends the Gaussians of the chunk at a byte.
    fn chunk(&mut self, source: &Source<'_>, at: usize) -> Result<(), Error> {
        let (meta, start): (ChunkMeta, usize) = json(source, at, CHUNK_MAGIC, "a chunk's head")?;
        check_version(source, meta.version)?;
        let left = self.count - self.next;
        if meta.base != self.next || meta.count > left {
            let expected = format!("a chunk of at most {left} Gaussians from {}", self.next);
            return Err(source.damaged(at, expected, format!("{} from {}", meta.count, meta.base)));
        }
        let (base, count) = (self.next, meta.count as usize);
        self.next += meta.count;
        let chunk = Chunk { source, start: start + size_of::<u64>(), properties: &meta.properties };
        let there = |name: &str, planes: Option<Planes>| {
            planes.ok_or_else(|| source.damaged(at, format!("the property `{name}`"), "none"))
        };
        let needed = |name, width, encodings| there(name, chunk.numbers(name, width, count, encodings)?);
        let means = needed("center", 3, planes::PLACES)?;
        let opacities = needed("alpha", 1, planes::OPACITIES)?;
        let colors = needed("rgb", 3, planes::COLORS)?;
        let scales = needed("scales", 3, planes::SCALES)?;
        let rotations = needed("orientation", 3, planes::ROTATIONS)?;
        let mut higher = Vec::new();
        for (degree, palette) in (1..=usize::from(self.scene.sh_degree)).zip(&mut self.palette) {
            let (name, width) = (format!("sh{degree}"), 3 * (2 * degree + 1));
            // Spark has the palette in the first chunk.
            if palette.is_none() {
                *palette = chunk.numbers(&format!("{name}_code"), width, self.codes, planes::SH)?;
            }
            higher.push((2 * degree + 1, chunk.numbers(&name, width, count, planes::SH)?));
        }
        let labels = chunk.whole_numbers("sh_label", count)?;
        let of_children = |name: &str| {
            let numbers = chunk.whole_numbers(name, count)?;
            numbers.ok_or_else(|| source.damaged(at, format!("the property `{name}`, as `lodTree` is true"), "none"))
        };
        let children = match self.has_tree {
            true => Some((of_children("child_count")?, of_children("child_start")?)),
            false => None,
        };
        for i in 0..count {
            let mut below = 0..0;
            if let Some((counts, starts)) = children.as_ref().filter(|(counts, _)| counts[i] > 0) {
                let (parent, first, number) = (base + i as u64, u64::from(starts[i]), u64::from(counts[i]));
                if first <= parent || first + number > self.count {
                    let expected = format!("children of Gaussian {parent} behind it and before {}", self.count);
                    return Err(source.damaged(at, expected, format!("{number} from {first}")));
                }
                below = first as usize..(first + number) as usize;
                if let Some(child) = below.clone().find(|child| self.has_parent[*child]) {
                    let expected = format!("Gaussian {child} as the child of one other");
                    return Err(source.damaged(at, expected, format!("it also as one of {parent}")));
                }
                self.has_parent[below.clone()].fill(true);
            }
            let stands_for_others = !below.is_empty();
            match &mut self.children {
                Some(all) => all.push(below),
                None if stands_for_others => continue,
                None => {}
            }
            let scene = &mut self.scene;
            scene.means.push(means.triple(0, i));
            let mut opacity = opacities.values[i];
            let wider = if stands_for_others && opacity > 1.0 { log_width(opacity) } else { 0.0 };
            if wider > 0.0 {
                opacity = 1.0;
            }
            let log_of = |v| if scales.are_logarithms() { v } else { log_of_scale(v) };
            scene.log_scales.push(scales.triple(0, i).map(log_of) + wider);
            scene.rotations.push(rotations.rotation(i));
            // A byte of 0 or 255 stands for all opacities that round to it.
            let end = if opacities.are_bytes() { 0.25 / 255.0 } else { 0.0 };
            let opacity = self.opacities.apply(opacity).clamp(end, 1.0 - end);
            scene.opacity_logits.push(logit_of_opacity(opacity));
            scene.sh.push((colors.triple(0, i) - 0.5) / SH_C0);
            for ((len, own), palette) in higher.iter().zip(&self.palette) {
                let (planes, i) = match (own, palette, &labels) {
                    (Some(own), ..) => (own, i),
                    (None, Some(palette), Some(labels)) => (palette, labels[i] as usize),
                    _ => {
                        scene.sh.extend(std::iter::repeat_n(Vec3::ZERO, *len));
                        continue;
                    }
                };
                if i >= planes.number {
                    return Err(source.damaged(at, format!("labels below {}", planes.number), i.to_string()));
                }
                scene.sh.extend((0..*len).map(|k| planes.triple(k, i)));
            }
        }
        Ok(())
    }
}

/// The logarithm of how much wider a Gaussian is at half height that Spark draws for an opacity of 1 to 2.
fn log_width(opacity: f32) -> f32 {
    let d = 4.0 * opacity.min(2.0) - 3.0;
    let n = ((d * d - 1.0) / E).exp();
    // Half height is where g = 1 − 2^(−1/n), in place of ½.
    let height = -(-std::f32::consts::LN_2 / n).exp_m1();
    0.5 * (-height.log2()).ln()
}

/// The JSON at a byte behind its magic number and length, and where what follows begins.
fn json<T: DeserializeOwned>(source: &Source<'_>, at: usize, magic: [u8; 4], what: &str) -> Result<(T, usize), Error> {
    let found: [u8; 4] = source.array(at, what)?;
    if found != magic {
        return Err(source.damaged(at, format!("`{}`", String::from_utf8_lossy(&magic)), format!("{found:02x?}")));
    }
    let text = source.slice(at + 8, source.u32(at + 4, what)?.into(), what)?;
    let value = serde_json::from_slice(text)
        .map_err(|error| source.damaged(at + 8, format!("{what} as JSON"), format!("one with: {error}")))?;
    Ok((value, at + 8 + text.len().next_multiple_of(8)))
}

fn check_version(source: &Source<'_>, version: u64) -> Result<(), Error> {
    if version == VERSION { Ok(()) } else { Err(Error::too_new(source.path, source.what, VERSION, version)) }
}
