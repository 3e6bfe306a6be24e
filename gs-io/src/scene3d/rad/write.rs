//! Writes a scene with a tree of levels of detail, in the encodings that Spark chooses by default.

use std::{f32::consts::PI, io, io::Write as _, iter, ops::Range, path::Path};

use flate2::{Compression, write::DeflateEncoder};
use glam::Vec3;
use gs_core::{Scene, Scene3d, constants::SH_C0};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::{CHUNK_MAGIC, MAGIC, VERSION, tree::Tree};
use crate::{
    error::Error,
    scene3d::{
        ConversionLoss, Encoded3d, TrainedWith,
        conversion_loss::Clamp,
        options::ToWrite,
        values::{UnitRotations, byte_of_logit},
    },
};

/// Gaussians of a chunk, which Spark requires.
const CHUNK: usize = 1 << 16;

/// Most Gaussians of a scene: with the others of its tree, their numbers fit into 32 bits.
const MOST: usize = 1 << 31;

/// The share of values at an end of their range that may be clamped, so that few of them do not make all coarse.
const OUTLIERS: f64 = 0.001;

/// The range of ln-scales that Spark chooses by default. Beyond it, those of merged Gaussians are clamped, so that a few
/// that are far away do not make all coarse.
const USUAL_RANGE: f32 = 21.0;

/// Encodes a scene.
pub(in crate::scene3d) fn encode(&ToWrite { format, path, scene, options }: &ToWrite<'_>) -> Result<Encoded3d, Error> {
    if scene.len() > MOST {
        return Err(Error::unsupported(path, format!("a RAD file of {} Gaussians", scene.len()), "write a PLY"));
    }
    let rotations = UnitRotations::new(scene, path)?;
    let tree = Tree::of(scene);
    let mut clamps = clamps(scene, &tree);
    let (mut chunks, mut ranges) = (Vec::new(), Vec::new());
    for (number, numbers) in tree.order.chunks(CHUNK).enumerate() {
        let start = chunks.len();
        let properties = properties(&tree, numbers, &mut clamps, path)?;
        let head = json!({ "base": number * CHUNK, "count": numbers.len(), "maxSh": scene.sh_degree });
        put_chunk(&mut chunks, head, properties).map_err(|error| Error::write(path, error))?;
        ranges.push(json!({ "offset": start, "bytes": chunks.len() - start }));
    }
    let [rgb, log_scale, sh @ ..] = clamps.each_ref().map(Clamp::range);
    let mut bytes = Vec::new();
    let head = json!({
        "version": VERSION,
        "type": "gsplat",
        "count": tree.order.len(),
        "maxSh": scene.sh_degree,
        "lodTree": true,
        "chunkSize": CHUNK,
        "allChunkBytes": chunks.len(),
        "chunks": ranges,
        "splatEncoding": {
            "rgbMin": rgb[0], "rgbMax": rgb[1], "lnScaleMin": log_scale[0], "lnScaleMax": log_scale[1],
            "sh1Max": sh[0][1], "sh2Max": sh[1][1], "sh3Max": sh[2][1], "lodOpacity": true,
        },
        "comment": concat!("gs ", env!("CARGO_PKG_VERSION")),
    });
    put_json(&mut bytes, MAGIC, &head);
    bytes.extend(chunks);
    let rounded = |what, to: String| ConversionLoss::Rounded { what, to };
    let mut losses = vec![
        rounded("colours, opacities and coefficients", "8 bits".to_owned()),
        rounded("log-scales", format!("steps of {:.3}", (log_scale[1] - log_scale[0]) / 254.0)),
        rounded("rotations", "24 bits".to_owned()),
    ];
    losses.extend(clamps.iter().filter_map(Clamp::loss));
    losses.extend(rotations.loss());
    losses.extend(options.trained_with.lost(&TrainedWith::default()));
    let mut encoded = Encoded3d::of(format, bytes, losses);
    encoded.written.order = Some(tree.order.iter().copied().filter(|&i| (i as usize) < scene.len()).collect());
    Ok(encoded)
}

/// Puts a JSON behind its magic number and length, and fills it to a multiple of 8 bytes.
fn put_json(bytes: &mut Vec<u8>, magic: [u8; 4], json: &Value) {
    let text = json.to_string();
    bytes.extend(magic);
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(text.into_bytes());
    bytes.resize(bytes.len().next_multiple_of(8), 0);
}

/// Puts a chunk of these properties: the description of each, and its bytes before compression.
fn put_chunk(bytes: &mut Vec<u8>, mut head: Value, properties: Vec<(Value, Vec<u8>)>) -> io::Result<()> {
    let compressed = |(described, bytes): (Value, Vec<u8>)| {
        let mut stream = DeflateEncoder::new(Vec::new(), Compression::default());
        stream.write_all(&bytes)?;
        Ok((described, stream.finish()?))
    };
    let mut properties: Vec<_> = properties.into_par_iter().map(compressed).collect::<io::Result<_>>()?;
    let mut payload = Vec::new();
    for (described, stored) in &mut properties {
        described["offset"] = payload.len().into();
        described["bytes"] = stored.len().into();
        described["compression"] = "gz".into();
        payload.append(stored);
        payload.resize(payload.len().next_multiple_of(8), 0);
    }
    head["version"] = VERSION.into();
    head["lodTree"] = true.into();
    head["payloadBytes"] = payload.len().into();
    head["properties"] = properties.into_iter().map(|(described, _)| described).collect();
    put_json(bytes, CHUNK_MAGIC, &head);
    bytes.extend((payload.len() as u64).to_le_bytes());
    bytes.append(&mut payload);
    Ok(())
}

/// The ranges of colours, log-scales, and coefficients of degrees 1 to 3.
fn clamps(scene: &Scene3d, tree: &Tree<'_>) -> [Clamp; 5] {
    let clamp = |what, [low, high]: [f32; 2], steps: f32| Clamp::new(what, low, high, 0.5 * (high - low) / steps);
    let sh = |range: Range<usize>| {
        let of_one = move |all| <[Vec3]>::iter(all).take(range.end).skip(range.start).copied();
        scene.sh.chunks_exact(scene.sh_len()).flat_map(of_one)
    };
    let coefficients = |what, range| {
        let [low, high] = ends(sh(range));
        let end = high.max(-low).max(1.0);
        clamp(what, [-end, end], 254.0)
    };
    let [low, high] = ends(sh(0..1).map(|c| c * SH_C0 + 0.5));
    let least = ends(scene.log_scales.iter().copied())[0];
    let [of_scene, of_merged] = [scene, &tree.merged]
        .map(|scene| scene.log_scales.iter().map(|scale| scale.max_element()).fold(f32::NEG_INFINITY, f32::max));
    let largest = of_scene.max(of_merged.min(least + USUAL_RANGE));
    [
        clamp("colours", [low.clamp(-1.0, 0.0), high.clamp(1.0, 2.0)], 255.0),
        clamp("log-scales", [least.min(largest - 1.0), largest], 254.0),
        coefficients("coefficients of degree 1", 1..4),
        coefficients("coefficients of degree 2", 4..9),
        coefficients("coefficients of degree 3", 9..16),
    ]
}

/// The values at both ends of the usual ones; 0 where there are none.
fn ends(values: impl Iterator<Item = Vec3>) -> [f32; 2] {
    let mut values: Vec<f32> = values.flat_map(|value| value.to_array()).collect();
    let Some(last) = values.len().checked_sub(1) else { return [0.0; 2] };
    [OUTLIERS, 1.0 - OUTLIERS].map(|share| {
        let place = (share * last as f64).round() as usize;
        *values.select_nth_unstable_by(place, f32::total_cmp).1
    })
}

/// The properties of the Gaussians with these numbers, as [`put_chunk`] takes them.
fn properties(
    tree: &Tree<'_>,
    numbers: &[u32],
    [rgb, log_scale, sh @ ..]: &mut [Clamp; 5],
    path: &Path,
) -> Result<Vec<(Value, Vec<u8>)>, Error> {
    let scene: Scene3d = numbers.iter().map(|&number| tree.gaussian(number)).collect();
    let rotations = UnitRotations::new(&scene, path)?;
    let plain = |property: &str, encoding: &str| json!({ "property": property, "encoding": encoding });
    let within = |property: &str, encoding: &str, [min, max]: [f32; 2]| json!({ "property": property, "encoding": encoding, "min": min, "max": max });
    let coefficient = |k: usize| scene.sh.iter().skip(k).step_by(scene.sh_len()).copied();
    let means: Vec<[u8; 4]> = planes(scene.means.iter().copied()).map(f32::to_le_bytes).collect();
    let [low, high] = rgb.range();
    let color = |v: f32| ((rgb.apply(v) - low) / (high - low) * 255.0).round() as u8;
    let colors: Vec<u8> = planes(coefficient(0).map(|c| c * SH_C0 + 0.5)).map(color).collect();
    let differences = |plane: &[u8]| -> Vec<u8> {
        plane.iter().zip(iter::once(&0).chain(plane)).map(|(byte, before)| byte.wrapping_sub(*before)).collect()
    };
    let [least, largest] = log_scale.range();
    let scale = |v: f32| ((log_scale.apply(v) - least) / (largest - least) * 254.0).round() as u8 + 1;
    let opacities = scene.opacity_logits.iter().map(|&logit| byte_of_logit(logit)).collect();
    let mut properties = vec![
        (plain("center", "f32_lebytes"), (0..4).flat_map(|k| means.iter().map(move |bytes| bytes[k])).collect()),
        (within("alpha", "r8", [0.0, 1.0]), opacities),
        (within("rgb", "r8_delta", [low, high]), colors.chunks(scene.len()).flat_map(differences).collect()),
        (within("scales", "ln_0r8", [least, largest]), planes(scene.log_scales.iter().copied()).map(scale).collect()),
        (plain("orientation", "oct88r8"), (0..scene.len()).flat_map(|i| octahedral(rotations.get(i))).collect()),
    ];
    for (degree, clamp) in (1..=usize::from(scene.sh_degree)).zip(sh) {
        let [min, max] = clamp.range();
        let byte = |v: f32| ((clamp.apply(v) / max * 127.0).round() as i8).cast_unsigned();
        let bytes = (degree.pow(2)..(degree + 1).pow(2)).flat_map(|k| planes(coefficient(k))).map(byte).collect();
        properties.push((within(&format!("sh{degree}"), "s8", [min, max]), bytes));
    }
    let (counts, starts): (Vec<u16>, Vec<u32>) = numbers.iter().map(|&number| tree.children(number)).unzip();
    properties.push((plain("child_count", "u16"), counts.into_iter().flat_map(u16::to_le_bytes).collect()));
    properties.push((plain("child_start", "u32"), starts.into_iter().flat_map(u32::to_le_bytes).collect()));
    Ok(properties)
}

/// All first numbers, then all second, then all third.
fn planes(values: impl Iterator<Item = Vec3> + Clone) -> impl Iterator<Item = f32> {
    (0..3).flat_map(move |axis| values.clone().map(move |value| value[axis]))
}

/// A unit quaternion (w, x, y, z) in three bytes; see [`planes`](super::planes).
fn octahedral(q: [f32; 4]) -> [u8; 3] {
    let [w, axis @ ..] = if q[0] < 0.0 { q.map(|v| -v) } else { q };
    let axis = Vec3::from(axis);
    let angle = 2.0 * axis.length().atan2(w);
    let size = axis.abs().element_sum();
    let [x, y, z] = if size > 0.0 { (axis / size).to_array() } else { [1.0, 0.0, 0.0] };
    let [x, y] = if z < 0.0 { [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)] } else { [x, y] };
    [0.5 * (x + 1.0), 0.5 * (y + 1.0), angle / PI].map(|share| (share * 255.0).round() as u8)
}
