//! PlayCanvas's compressed PLY: 16 bytes per Gaussian, with value ranges for each group of 256.
//!
//! | element | properties |
//! |---|---|
//! | `chunk`, one for 256 vertices | `min_x … max_z`; `min_scale_x … max_scale_z` (logarithms); in newer files `min_r … max_b` |
//! | `vertex` | `packed_position`, `packed_scale`: 11, 10, 11 bits of the way from min to max; `packed_rotation`: 2 bits say which part of (w, x, y, z) is the largest, three times 10 bits the others; `packed_color`: RGB and opacity in 8 bits each |
//! | `sh`, not always | `f_rest_*`, bytes; 0 to 255 stand for −4 to 4 |
//!
//! *Source:* PlayCanvas engine, `gsplat-compressed-data`.

use gs_core::Scene3d;
use gs_core::constants::SH_C0;

use super::{columns, element_start, header::Header, rest_columns, rows};
use crate::{
    error::Error,
    scene3d::{
        File3d, Format3d,
        conversion_loss::ConversionLoss,
        source::Source,
        values::{MAX_DEGREE, degree_of_rest, logit_of_step, with_largest},
    },
};

/// Vertices per chunk.
const CHUNK: usize = 256;

const RANGES: [&str; 12] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
];
const COLOR_RANGES: [&str; 6] = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];
const PACKED: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// The value ranges of a chunk.
struct Chunk {
    position: [[f32; 3]; 2],
    log_scale: [[f32; 3]; 2],
    color: [[f32; 3]; 2],
}

/// Reads a file whose [`Header`] is of this kind.
pub(super) fn read(source: &Source<'_>, header: &Header) -> Result<File3d, Error> {
    let chunks = read_chunks(source, header)?;
    let place = |name: &str| header.find(name).ok_or_else(|| source.damaged(0, format!("an element `{name}`"), "none"));
    let vertex = place("vertex")?;
    let element = &header.elements[vertex];
    let needed = element.count.div_ceil(CHUNK as u64);
    if needed > chunks.len() as u64 {
        let found = format!("{}", chunks.len());
        return Err(source.damaged(0, format!("{needed} chunks for {} vertices", element.count), found));
    }
    let wanted = columns(source, element, &PACKED)?;
    let mut scene = Scene3d::default();
    let mut dc = Vec::new();
    let start = element_start(source, header, vertex)?;
    rows::read(source, header, element, start, &wanted, |row| {
        let [position, rotation, scale, color] = [0, 1, 2, 3].map(|k: usize| row[k] as u32);
        let chunk = &chunks[scene.means.len() / CHUNK];
        scene.means.push(between(&chunk.position, unpack_111011(position)).into());
        scene.log_scales.push(between(&chunk.log_scale, unpack_111011(scale)).into());
        scene.rotations.push(unpack_rotation(rotation));
        let [red, green, blue, opacity] = color.to_be_bytes();
        scene.opacity_logits.push(logit_of_step(opacity.into(), 255));
        let share = [red, green, blue].map(|byte| f32::from(byte) / 255.0);
        dc.push(glam::Vec3::from(between(&chunk.color, share).map(|c| (c - 0.5) / SH_C0)));
    })?;
    let losses = match header.find("sh") {
        None => {
            scene.sh = dc;
            None
        }
        Some(sh) => read_sh(source, header, sh, &mut scene, &dc)?,
    };
    let losses = Vec::from_iter(losses);
    Ok(File3d { losses, trained_with: header.trained_with(), ..File3d::of(Format3d::CompressedPly, scene) })
}

fn read_chunks(source: &Source<'_>, header: &Header) -> Result<Vec<Chunk>, Error> {
    let Some(place) = header.find("chunk") else { return Err(source.damaged(0, "an element `chunk`", "none")) };
    let element = &header.elements[place];
    let mut wanted = columns(source, element, &RANGES)?;
    // Files of the first version have no colour ranges: 0 to 1.
    let colors: Vec<usize> = COLOR_RANGES.iter().filter_map(|name| element.find(name)).collect();
    let has_colors = colors.len() == COLOR_RANGES.len();
    wanted.extend(colors.iter().filter(|_| has_colors));
    let mut chunks = Vec::new();
    let start = element_start(source, header, place)?;
    rows::read(source, header, element, start, &wanted, |row| {
        let triple = |k: usize| [row[k] as f32, row[k + 1] as f32, row[k + 2] as f32];
        let color = if has_colors { [triple(12), triple(15)] } else { [[0.0; 3], [1.0; 3]] };
        chunks.push(Chunk { position: [triple(0), triple(3)], log_scale: [triple(6), triple(9)], color });
    })?;
    Ok(chunks)
}

/// Adds the SH coefficients: those of degree 0 and those of the element `sh`.
fn read_sh(
    source: &Source<'_>,
    header: &Header,
    place: usize,
    scene: &mut Scene3d,
    dc: &[glam::Vec3],
) -> Result<Option<ConversionLoss>, Error> {
    let element = &header.elements[place];
    if element.count != dc.len() as u64 {
        return Err(source.damaged(0, format!("{} rows of element sh", dc.len()), format!("{}", element.count)));
    }
    let wanted = rest_columns(source, element)?;
    if wanted.is_empty() {
        // Rows may have no bytes here, and there is nothing to read.
        scene.sh = dc.to_vec();
        return Ok(None);
    }
    let file_degree = degree_of_rest(wanted.len()).unwrap_or(0);
    scene.sh_degree = file_degree.min(MAX_DEGREE);
    let (kept, per_channel) = (scene.sh_len() - 1, wanted.len() / 3);
    let mut rest_of = dc.iter();
    let start = element_start(source, header, place)?;
    rows::read(source, header, element, start, &wanted, |row| {
        scene.sh.extend(rest_of.next());
        let value = |channel: usize, k: usize| sh_of_byte(row[channel * per_channel + k]);
        scene.sh.extend((0..kept).map(|k| glam::Vec3::new(value(0, k), value(1, k), value(2, k))));
    })?;
    Ok(ConversionLoss::of_degree(file_degree, scene.sh_degree))
}

/// A coefficient from a byte: the middle of a 256th of −4..4, but at the ends the ends themselves.
fn sh_of_byte(byte: f64) -> f32 {
    let share = match byte {
        0.0 => 0.0,
        255.0 => 1.0,
        byte => (byte + 0.5) / 256.0,
    };
    ((share - 0.5) * 8.0) as f32
}

fn between([low, high]: &[[f32; 3]; 2], share: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| low[k] + (high[k] - low[k]) * share[k])
}

fn unpack_111011(bits: u32) -> [f32; 3] {
    [(bits >> 21) as f32 / 2047.0, (bits >> 11 & 1023) as f32 / 1023.0, (bits & 2047) as f32 / 2047.0]
}

fn unpack_rotation(bits: u32) -> [f32; 4] {
    let part = |shift: u32| ((bits >> shift & 1023) as f32 / 1023.0 - 0.5) * std::f32::consts::SQRT_2;
    with_largest((bits >> 30) as usize, [part(20), part(10), part(0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_numbers_unpack_to_their_ends_and_middles() {
        assert_eq!(unpack_111011(u32::MAX), [1.0; 3]);
        assert_eq!(unpack_111011(2047 << 21), [1.0, 0.0, 0.0]);
        assert_eq!(unpack_111011(1023 << 11), [0.0, 1.0, 0.0]);
        assert_eq!((sh_of_byte(0.0), sh_of_byte(255.0)), (-4.0, 4.0));
        assert!((sh_of_byte(128.0) - 4.0 / 256.0).abs() < 1e-6);
    }

    #[test]
    fn the_largest_part_of_a_rotation_is_found_again() {
        for place in 0..4_u32 {
            // The others are 512/1023, next to 0.
            let q = unpack_rotation(place << 30 | 512 << 20 | 512 << 10 | 512);
            assert!(q[place as usize] > 0.999 && q.iter().map(|v| v * v).sum::<f32>() - 1.0 < 1e-6, "{q:?}");
        }
        let q = unpack_rotation(2 << 30 | 1023 << 20 | 512 << 10);
        assert!(q[0] > 0.7 && q[1].abs() < 1e-3 && q[3] < -0.7 && q[2] < 0.1, "{q:?}");
    }
}
