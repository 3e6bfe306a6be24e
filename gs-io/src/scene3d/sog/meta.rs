//! `meta.json` of a SOG.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{error::Error, scene3d::source::Source, text::utf8_text};

/// The file that describes the others.
pub(crate) const META: &str = "meta.json";

/// The version that is read and written.
pub(super) const VERSION: u32 = 2;

const CONVERT: &str = "convert it with PlayCanvas's splat-transform: npx @playcanvas/splat-transform FILE scene.sog";

/// Names of images.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Named {
    pub(super) files: Vec<String>,
}

/// Means: the range of each axis, and the images of low and high bytes.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Means {
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
    pub(super) files: Vec<String>,
}

/// What bytes stand for. JSON has null for NaN.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Coded {
    pub(super) codebook: Vec<Option<f32>>,
    pub(super) files: Vec<String>,
}

/// SH above degree 0: `count` rows of the degrees 1 to `bands`; the images of the palette and of
/// labels.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Palette {
    pub(super) count: u32,
    pub(super) bands: u8,
    pub(super) codebook: Vec<Option<f32>>,
    pub(super) files: Vec<String>,
}

/// The whole file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Meta {
    pub(super) version: u32,
    pub(super) count: u32,
    /// Whether the scene was trained with antialiasing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) antialias: Option<bool>,
    pub(super) means: Means,
    pub(super) scales: Coded,
    pub(super) quats: Named,
    pub(super) sh0: Coded,
    #[serde(default, rename = "shN", skip_serializing_if = "Option::is_none")]
    pub(super) sh_n: Option<Palette>,
}

impl Meta {
    pub(super) fn parse(source: &Source<'_>, text: &[u8]) -> Result<Self, Error> {
        let text = utf8_text(source.path, text)?;
        let damaged =
            |error: serde_json::Error| source.damaged(0, "the meta.json of a SOG", format!("one with: {error}"));
        let version = serde_json::from_slice::<Value>(text).map_err(damaged)?["version"].as_u64();
        if version != Some(VERSION.into()) {
            return Err(match version {
                None | Some(..VERSION_1_END) => Error::unsupported(source.path, "version 1 of SOG", CONVERT),
                Some(found) => Error::too_new(source.path, source.what, VERSION, found),
            });
        }
        let meta: Self = serde_json::from_slice(text).map_err(damaged)?;
        match meta.sh_n.as_ref().map(|palette| palette.bands) {
            None | Some(1..=3) => Ok(meta),
            Some(bands) => Err(source.damaged(0, "1 to 3 bands of SH", bands.to_string())),
        }
    }

    pub(super) fn text(&self) -> Vec<u8> {
        let mut value = serde_json::to_value(self).unwrap_or_default();
        value["asset"] = serde_json::json!({ "generator": concat!("gs ", env!("CARGO_PKG_VERSION")) });
        value.to_string().into_bytes()
    }
}

const VERSION_1_END: u64 = VERSION as u64;
