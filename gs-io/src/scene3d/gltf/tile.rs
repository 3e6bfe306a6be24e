//! Writes a tile of 3D Tiles: a `.glb` whose Gaussians are an SPZ.

use glam::Mat4;
use gs_core::Scene as _;
use serde_json::json;

use super::{
    axes,
    document::{EXTENSION, SPZ_EXTENSION},
    write::{FLOAT, Pieces, binary, coefficients, document, range, splatting},
};
use crate::{
    error::Error,
    scene3d::{Encoded3d, SpzVersion, options::ToWrite, spz},
};

/// The extensions of a `.glb` that [`encode_spz`] makes.
pub(crate) const TILE_EXTENSIONS: [&str; 2] = [EXTENSION, SPZ_EXTENSION];

const UNSIGNED_BYTE: u32 = 5121;

/// Encodes a scene as a `.glb` whose buffer is an SPZ of version 3 with the axes of glTF, as CesiumJS reads it.
///
/// The node moves the middle of the means from the origin, so that 24 bits are enough for their differences. It has a
/// matrix, the SPZ is the first buffer view, and the attributes only say what the SPZ has, because CesiumJS expects this.
pub(crate) fn encode_spz(to: &ToWrite<'_>) -> Result<Encoded3d, Error> {
    let options = to.options.with(|s| s.spz_version = SpzVersion::V3);
    let (low, high) = range(to.scene.means.iter().copied());
    let middle = low.midpoint(high);
    let mut scene = to.scene.clone();
    scene.means.iter_mut().for_each(|mean| *mean -= middle);
    let (buffer, losses) = spz::encode_part(&ToWrite { options: &options, scene: &scene, ..*to }, axes())?;
    let view = json!({ "buffer": 0, "byteLength": buffer.len() });
    let mut pieces = Pieces { count: to.scene.len(), buffer, views: vec![view], ..Pieces::default() };
    pieces.declare("POSITION", FLOAT, "VEC3");
    pieces.set_range(&scene);
    pieces.declare("COLOR_0", UNSIGNED_BYTE, "VEC4");
    pieces.accessors[1]["normalized"] = true.into();
    pieces.declare("ROTATION", FLOAT, "VEC4");
    pieces.declare("SCALE", FLOAT, "VEC3");
    coefficients(to.scene.sh_degree).skip(1).for_each(|name| pieces.declare(&name, FLOAT, "VEC3"));
    let mut splatting = splatting();
    splatting["extensions"] = json!({ SPZ_EXTENSION: { "bufferView": 0 } });
    let mut json = document(&pieces, splatting);
    json["nodes"][0]["matrix"] = json!(Mat4::from_translation(axes().mean(middle)).to_cols_array());
    json["extensionsUsed"] = json!(TILE_EXTENSIONS);
    json["extensionsRequired"] = json!(TILE_EXTENSIONS);
    if let Some(extras) = options.trained_with.extras() {
        json["meshes"][0]["primitives"][0]["extras"] = extras;
    }
    Ok(Encoded3d::of(to.format, binary(to.path, &json, &pieces.buffer)?, losses))
}
