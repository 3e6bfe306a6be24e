//! The parts of a glTF's JSON that concern Gaussians.
//!
//! The gltf crates are not used because they drop unknown attributes.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde::Deserialize;

/// The name of the extension, with which its attributes begin.
pub(super) const EXTENSION: &str = "KHR_gaussian_splatting";

/// The name of its extension for an SPZ in place of the attributes' values.
pub(super) const SPZ_EXTENSION: &str = "KHR_gaussian_splatting_compression_spz_2";

/// A document; other members are ignored.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub(super) extensions_required: Vec<String>,
    pub(super) scene: usize,
    pub(super) scenes: Vec<SceneNodes>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct SceneNodes {
    pub(super) nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    pub(super) children: Vec<usize>,
    /// The transform's matrix, by columns.
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    /// x, y, z, w.
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

impl Node {
    /// The map from the node's coordinates to its parent's.
    pub(super) fn map(&self) -> DAffine3 {
        match &self.matrix {
            Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(matrix)),
            None => {
                let rotation = self.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
                // A quaternion that is not normalised would scale.
                let rotation = if rotation.is_normalized() { rotation } else { rotation.normalize() };
                DAffine3::from_scale_rotation_translation(
                    self.scale.map_or(DVec3::ONE, DVec3::from),
                    rotation,
                    self.translation.map_or(DVec3::ZERO, DVec3::from),
                )
            }
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    extensions: BTreeMap<String, serde_json::Value>,
    /// Free data of the program that wrote the file.
    pub(super) extras: serde_json::Value,
}

/// The extension's object in a primitive.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Splatting {
    pub(super) color_space: Option<String>,
    /// Extensions of the extension, for example a compression.
    pub(super) extensions: BTreeMap<String, serde_json::Value>,
}

impl Splatting {
    /// The buffer view of the SPZ that has the Gaussians, if one has them.
    pub(super) fn spz(&self) -> Option<usize> {
        self.extensions.get(SPZ_EXTENSION)?["bufferView"].as_u64()?.try_into().ok()
    }
}

impl Primitive {
    /// The extension, if the primitive consists of Gaussians.
    pub(super) fn splatting(&self) -> Option<Splatting> {
        self.extensions.get(EXTENSION).map(|value| serde_json::from_value(value.clone()).unwrap_or_default())
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) kind: String,
    #[serde(default)]
    pub(super) sparse: Option<serde_json::Value>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: u64,
}
