//! `.ksplat`, the format of mkkellogg's GaussianSplats3D, version 0.1; read only.
//!
//! | bytes | what |
//! |---|---|
//! | 0–1 | version: major, minor |
//! | 4, 16 | number of section headers; number of Gaussians (u32 each) |
//! | 20 | compression level, 0 to 2 (u16) |
//! | 36, 40 | range of SH at level 2 (f32 each); 0 stands for −1.5 and 1.5 |
//! | 4096 … | section headers of 1,024 bytes, then the sections |
//!
//! A section has the sizes of its partly filled buckets (u32), the centres of all buckets (three
//! f32), and its Gaussians: mean, scale (not its logarithm), quaternion w x y z, colour and opacity
//! (a byte each), SH by degree and channel.
//!
//! | level | mean | scale, quaternion | SH |
//! |---|---|---|---|
//! | 0 | f32 | f32 | f32 |
//! | 1 | u16, relative to its bucket | f16 | f16 |
//! | 2 | u16, relative to its bucket | f16 | u8 |
//!
//! *Source:* the reader of `@playcanvas/splat-transform`, and files written by
//! `@mkkellogg/gaussian-splats-3d`.

use glam::Vec3;
use gs_core::{Scene3d, constants::SH_C0};

use super::{
    File3d, Format3d,
    source::Source,
    values::{log_of_scale, logit_of_step, of_half, rest_of_degree},
};
use crate::error::Error;

const HEAD_BYTES: usize = 4096;
const SECTION_HEAD_BYTES: usize = 1024;

/// Steps from the centre of a bucket to its side, unless the section says otherwise.
const DEFAULT_RANGE: u32 = 32_767;

/// The highest degree of a section.
const MAX_DEGREE: u16 = 2;

/// Reads a scene of degree 0, 1 or 2.
pub(crate) fn read(source: &Source<'_>, format: Format3d) -> Result<File3d, Error> {
    let version = [source.bytes.first(), source.bytes.get(1)].map(|byte| byte.copied().unwrap_or_default());
    if version[0] != 0 || version[1] < 1 {
        return Err(source.damaged(0, "version 0.1", format!("{}.{}", version[0], version[1])));
    }
    source.slice(0, HEAD_BYTES as u64, "the head")?;
    let (sections, count) = (source.u32(4, "the head")? as usize, source.u32(16, "the head")? as usize);
    let level = Level::of_head(source)?;
    let heads = source.slice(HEAD_BYTES, sections as u64 * SECTION_HEAD_BYTES as u64, "section headers")?;
    let mut at = HEAD_BYTES + heads.len();
    let mut read = Vec::new();
    for number in 0..sections {
        let section = Section::read(source, HEAD_BYTES + number * SECTION_HEAD_BYTES, at, &level)?;
        at = section.end;
        read.push(section);
    }
    let found: usize = read.iter().map(|section| section.count).sum();
    if found != count {
        return Err(source.damaged(16, format!("{found} Gaussians, as many as in the sections"), count.to_string()));
    }
    let degree = read.iter().filter(|section| section.count > 0).map(|section| section.degree).max().unwrap_or(0);
    let mut scene = Scene3d { sh_degree: degree, ..Scene3d::default() };
    read.iter().try_for_each(|section| section.append(source, &level, &mut scene))?;
    Ok(File3d::of(format, scene))
}

/// How numbers are stored.
#[derive(Debug)]
struct Level {
    /// 0 to 2.
    number: u16,
    /// What the bytes 0 and 255 of SH stand for.
    sh_range: [f32; 2],
}

impl Level {
    fn of_head(source: &Source<'_>) -> Result<Self, Error> {
        let number = u16::from_le_bytes(source.array(20, "the head")?);
        if number > 2 {
            return Err(source.damaged(20, "a compression level of 0, 1 or 2", number.to_string()));
        }
        let or = |value: f32, usual: f32| if value == 0.0 { usual } else { value };
        let at = |byte| source.array(byte, "the head").map(f32::from_le_bytes);
        Ok(Self { number, sh_range: [or(at(36)?, -1.5), or(at(40)?, 1.5)] })
    }

    /// Bytes of a mean or of a scale, and of a quaternion.
    fn sizes(&self) -> (usize, usize) {
        if self.number == 0 { (12, 16) } else { (6, 8) }
    }

    fn sh_bytes(&self) -> usize {
        [4, 2, 1][usize::from(self.number)]
    }

    /// Bytes of a Gaussian.
    fn record(&self, degree: u8) -> usize {
        let (three, four) = self.sizes();
        2 * three + four + 4 + rest_of_degree(degree) * self.sh_bytes()
    }

    /// A number of a scale or quaternion.
    fn number(&self, bytes: &[u8], index: usize) -> f32 {
        match self.number {
            0 => f32::from_le_bytes(bytes.as_chunks::<4>().0[index]),
            _ => of_half(u16::from_le_bytes(bytes.as_chunks::<2>().0[index])),
        }
    }

    fn sh(&self, bytes: &[u8], index: usize) -> f32 {
        let [low, high] = self.sh_range;
        match self.number {
            2 => low + f32::from(bytes[index]) / 255.0 * (high - low),
            _ => self.number(bytes, index),
        }
    }
}

/// A part of a file.
#[derive(Debug)]
struct Section {
    count: usize,
    degree: u8,
    /// Where its Gaussians start, bytes.
    start: usize,
    /// Where the next section starts, bytes.
    end: usize,
    /// Centre of the bucket of each Gaussian, where means are relative to it.
    buckets: Vec<Bucket>,
    /// A step of a mean, world units, and the steps from a bucket's least corner to its centre.
    step: f32,
    range: f32,
}

/// Gaussians in sequence that share a centre.
#[derive(Debug)]
struct Bucket {
    gaussians: usize,
    center: Vec3,
}

impl Section {
    fn read(source: &Source<'_>, head: usize, at: usize, level: &Level) -> Result<Self, Error> {
        let u32_at = |offset: usize| source.u32(head + offset, "a section's header").map(|v| v as usize);
        let (count, capacity) = (u32_at(0)?, u32_at(4)?);
        let (bucket_capacity, bucket_count) = (u32_at(8)?, u32_at(12)?);
        let side = f32::from_bits(u32_at(16)? as u32);
        let bucket_bytes = u16::from_le_bytes(source.array(head + 20, "a section's header")?);
        let range = match u32_at(24)? as u32 {
            0 => DEFAULT_RANGE,
            range => range,
        } as f32;
        let (full, partial) = (u32_at(32)?, u32_at(36)?);
        let degree = u16::from_le_bytes(source.array(head + 40, "a section's header")?);
        if degree > MAX_DEGREE {
            return Err(source.damaged(head + 40, "an SH degree of 0, 1 or 2", degree.to_string()));
        }
        if count > capacity {
            return Err(source.damaged(head, format!("at most {capacity} Gaussians"), count.to_string()));
        }
        let sizes = source.slice(at, 4 * partial as u64, "sizes of buckets")?;
        let centers_at = at + sizes.len();
        let centers = source.slice(centers_at, u64::from(bucket_bytes) * bucket_count as u64, "centres of buckets")?;
        let start = centers_at + centers.len();
        let degree = degree as u8;
        let records = source.slice(start, level.record(degree) as u64 * capacity as u64, "Gaussians")?;
        let mut section = Self {
            count,
            degree,
            start,
            end: start + records.len(),
            buckets: Vec::new(),
            step: side / 2.0 / range,
            range,
        };
        if level.number > 0 && count > 0 {
            let partial = sizes.as_chunks::<4>().0.iter().map(|&size| u32::from_le_bytes(size) as usize);
            let gaussians = std::iter::repeat_n(bucket_capacity, full).chain(partial);
            let center = |bytes: &[u8]| bytes.as_chunks::<4>().0.first_chunk::<3>().map(|c| c.map(f32::from_le_bytes));
            let centers = centers.chunks_exact(usize::from(bucket_bytes).max(1)).map(center);
            for (gaussians, center) in gaussians.zip(centers) {
                let bad = || source.damaged(head + 20, "12 bytes a bucket", bucket_bytes.to_string());
                section.buckets.push(Bucket { gaussians, center: center.ok_or_else(bad)?.into() });
            }
            let inside = section.buckets.iter().fold(0_usize, |sum, bucket| sum.saturating_add(bucket.gaussians));
            if inside < count {
                return Err(source.damaged(
                    head,
                    format!("at most {inside} Gaussians, as in its buckets"),
                    count.to_string(),
                ));
            }
        }
        Ok(section)
    }

    /// Appends the Gaussians to a scene of the same or a higher degree.
    fn append(&self, source: &Source<'_>, level: &Level, scene: &mut Scene3d) -> Result<(), Error> {
        let size = level.record(self.degree);
        let records = source.slice(self.start, (size * self.count) as u64, "Gaussians")?;
        let (three, four) = level.sizes();
        let mut centers = self.buckets.iter().flat_map(|bucket| std::iter::repeat_n(bucket.center, bucket.gaussians));
        let higher = scene.sh_len() - 1;
        for record in records.chunks_exact(size) {
            let (mean, rest) = record.split_at(three);
            let (scale, rest) = rest.split_at(three);
            let (rotation, rest) = rest.split_at(four);
            let (color, sh) = rest.split_at(4);
            let center = centers.next().unwrap_or_default();
            scene.means.push(if level.number == 0 {
                Vec3::from([0, 1, 2].map(|k| level.number(mean, k)))
            } else {
                let words = [0, 1, 2].map(|k| f32::from(u16::from_le_bytes(mean.as_chunks::<2>().0[k])));
                (Vec3::from(words) - self.range) * self.step + center
            });
            scene.log_scales.push([0, 1, 2].map(|k| log_of_scale(level.number(scale, k))).into());
            scene.rotations.push([0, 1, 2, 3].map(|k| level.number(rotation, k)));
            scene.sh.push([0, 1, 2].map(|k| (f32::from(color[k]) / 255.0 - 0.5) / SH_C0).into());
            scene.opacity_logits.push(logit_of_step(color[3].into(), 255));
            scene.sh.extend((0..higher).map(|k| self.coefficient(level, sh, k)));
        }
        Ok(())
    }

    /// Coefficient `k` above degree 0; degrees are stored one after the other, each by channel.
    fn coefficient(&self, level: &Level, sh: &[u8], k: usize) -> Vec3 {
        let (first, len) = if k < 3 { (0, 3) } else { (3, 5) };
        if 3 * (first + len) > rest_of_degree(self.degree) {
            return Vec3::ZERO;
        }
        Vec3::from([0, 1, 2].map(|channel| level.sh(sh, 3 * first + channel * len + k - first)))
    }
}
