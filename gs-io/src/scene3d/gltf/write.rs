//! Writes glTF: a primitive of points whose attributes are floats in one buffer.

use std::path::Path;

use base64::{Engine, engine::general_purpose::STANDARD};
use glam::Vec3;
use gs_core::{Scene, Scene3d};
use serde_json::{Value, json};

use super::{
    SRGB, axes,
    buffers::{BINARY_CHUNK, GLB_MAGIC, GLB_VERSION, JSON_CHUNK},
    document::EXTENSION,
};
use crate::{
    error::Error,
    scene3d::{
        Encoded3d, Format3d,
        conversion_loss::ConversionLoss,
        options::ToWrite,
        values::{UnitRotations, opacity_of_logit, scale_of_log},
    },
};

/// Encodes a scene, with the buffer of a `.gltf` inside.
pub(crate) fn encode(&ToWrite { format, path, scene, options }: &ToWrite<'_>) -> Result<Encoded3d, Error> {
    let rotations = UnitRotations::new(scene, path)?;
    let pieces = attributes(scene, &rotations);
    let Pieces { buffer, .. } = &pieces;
    let mut json = document(&pieces, splatting());
    if let Some(frame) = options.world() {
        json["nodes"][0]["translation"] = json!((frame.origin * super::signs()).to_array());
        json["nodes"][0]["scale"] = json!([frame.unit, frame.unit, frame.unit]);
    }
    if let Some(extras) = options.trained_with.extras() {
        json["meshes"][0]["primitives"][0]["extras"] = extras;
    }
    let mut losses = vec![
        ConversionLoss::Rounded { what: "opacities", to: "24 bits of 0..1".to_owned() },
        ConversionLoss::Rounded { what: "scales", to: "24 bits".to_owned() },
    ];
    losses.extend(rotations.loss());
    if format == Format3d::Glb {
        return Ok(Encoded3d::of(format, binary(path, &json, buffer)?, losses));
    }
    json["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{}", STANDARD.encode(buffer)).into();
    Ok(Encoded3d::of(format, json.to_string().into_bytes(), losses))
}

/// The attributes of a scene, with their values.
fn attributes(scene: &Scene3d, rotations: &UnitRotations<'_>) -> Pieces {
    let (count, len) = (scene.len(), scene.sh_len());
    let mut pieces = Pieces { count, ..Pieces::default() };
    pieces.add("POSITION", scene.means.iter().map(|&mean| axes().mean(mean).to_array()));
    pieces.set_range(scene);
    let xyzw = |i: usize| {
        let [w, x, y, z] = axes().rotation(rotations.get(i));
        [x, y, z, w]
    };
    pieces.add("ROTATION", (0..count).map(xyzw));
    pieces.add("SCALE", scene.log_scales.iter().map(|log| log.to_array().map(scale_of_log)));
    pieces.add("OPACITY", scene.opacity_logits.iter().map(|&logit| [opacity_of_logit(logit)]));
    for (k, name) in coefficients(scene.sh_degree).enumerate() {
        let sign = axes().sign_of_coefficient(k);
        pieces.add(&name, scene.sh.iter().skip(k).step_by(len).map(|c| (*c * sign).to_array()));
    }
    pieces
}

/// The names of the coefficients up to a degree.
pub(super) fn coefficients(sh_degree: u8) -> impl Iterator<Item = String> {
    (0..=sh_degree).flat_map(|l| (0..=2 * l).map(move |n| format!("SH_DEGREE_{l}_COEF_{n}")))
}

/// The extension's object in a primitive.
pub(super) fn splatting() -> Value {
    json!({ "kernel": "ellipse", "colorSpace": SRGB, "projection": "perspective", "sortingMethod": "cameraDistance" })
}

/// The JSON, without a uri for its buffer.
pub(super) fn document(pieces: &Pieces, splatting: Value) -> Value {
    const POINTS: u8 = 0;
    json!({
        "asset": { "version": "2.0", "generator": concat!("gs ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{
            "attributes": pieces.attributes, "mode": POINTS, "extensions": { EXTENSION: splatting }
        }] }],
        "accessors": pieces.accessors,
        "bufferViews": pieces.views,
        "buffers": [{ "byteLength": pieces.buffer.len() }],
    })
}

pub(super) const FLOAT: u32 = 5126;

/// The attributes in sequence.
#[derive(Default)]
pub(super) struct Pieces {
    pub(super) count: usize,
    pub(super) buffer: Vec<u8>,
    pub(super) attributes: serde_json::Map<String, Value>,
    pub(super) accessors: Vec<Value>,
    pub(super) views: Vec<Value>,
}

impl Pieces {
    fn add<const N: usize>(&mut self, name: &str, rows: impl Iterator<Item = [f32; N]>) {
        let start = self.buffer.len();
        rows.flatten().for_each(|value| self.buffer.extend(value.to_le_bytes()));
        let kind = match N {
            1 => "SCALAR",
            3 => "VEC3",
            _ => "VEC4",
        };
        self.declare(name, FLOAT, kind);
        if let Some(accessor) = self.accessors.last_mut() {
            accessor["bufferView"] = self.views.len().into();
        }
        self.views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": self.buffer.len() - start }));
    }

    /// An attribute without values.
    pub(super) fn declare(&mut self, name: &str, component: u32, kind: &str) {
        let is_of_gltf = matches!(name, "POSITION" | "COLOR_0");
        let name = if is_of_gltf { name.to_owned() } else { format!("{EXTENSION}:{name}") };
        self.attributes.insert(name, json!(self.accessors.len()));
        self.accessors.push(json!({ "componentType": component, "count": self.count, "type": kind }));
    }

    /// Adds the smallest and the largest coordinates to the first attribute, POSITION.
    pub(super) fn set_range(&mut self, scene: &Scene3d) {
        let (low, high) = range(scene.means.iter().map(|&mean| axes().mean(mean)));
        self.accessors[0]["min"] = json!(low.to_array());
        self.accessors[0]["max"] = json!(high.to_array());
    }
}

/// The smallest and the largest coordinates.
pub(super) fn range(mut means: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    let first = means.next().unwrap_or_default();
    means.fold((first, first), |(low, high), mean| (low.min(mean), high.max(mean)))
}

/// A `.glb` of two chunks, each padded to a multiple of four bytes.
pub(super) fn binary(path: &Path, json: &Value, buffer: &[u8]) -> Result<Vec<u8>, Error> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + buffer.len().next_multiple_of(4);
    let total = u32::try_from(total).map_err(|_| {
        let what = format!("a .glb of {total} bytes, more than its 32-bit lengths hold,");
        Error::unsupported(path, what, "write a PLY or an SPZ")
    })?;
    let mut file = GLB_MAGIC.to_vec();
    file.extend([GLB_VERSION, total].map(u32::to_le_bytes).concat());
    file.extend([(text.len() as u32).to_le_bytes(), JSON_CHUNK].concat());
    file.extend(text);
    file.extend([(buffer.len().next_multiple_of(4) as u32).to_le_bytes(), BINARY_CHUNK].concat());
    file.extend(buffer);
    file.resize(file.len().next_multiple_of(4), 0);
    Ok(file)
}
