//! Pictures of `.gsi` files, without anything else of the engine.

use gs_codec::Extent;
use gs_core::{Canvas, to_8_bits};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_io::{StoredImage, decode_gsi};
use gs_train::draw_picture;
use wasm_bindgen::prelude::*;

use crate::failure;

/// A decoded picture.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Picture {
    /// Columns, px.
    #[wasm_bindgen(readonly)]
    pub width: u32,
    /// Rows, px.
    #[wasm_bindgen(readonly)]
    pub height: u32,
    rgba: Vec<u8>,
    profile: Vec<u8>,
}

#[wasm_bindgen]
impl Picture {
    /// Decodes a file. With `partial`, it may end anywhere after its header.
    ///
    /// The CPU draws at once. As the caller waits for it, a fault is an exception for the caller; a promise would
    /// stay pending.
    pub fn decode(bytes: Vec<u8>, partial: bool) -> Result<Picture, JsError> {
        let file = decode_gsi(&bytes, if partial { Extent::Prefix } else { Extent::Whole }).map_err(failure)?;
        let (width, height) = (file.colors.width, file.colors.height);
        let on = CpuRasterizer::new(CpuSettings::default().with(|s| s.threads = Some(1))).map_err(failure)?;
        let drawn = pollster::block_on(draw_picture(&on, &file, &Canvas::new(width, height))).map_err(failure)?;
        let StoredImage { image, alpha, profile, .. } = drawn;
        let alphas = alpha.into_iter().flatten().chain(std::iter::repeat(1.0));
        let pixels = image.pixels().iter().zip(alphas);
        let rgba = pixels.flat_map(|(&[r, g, b], alpha)| [r, g, b, alpha].map(to_8_bits)).collect();
        let profile = profile.map_or_else(Vec::new, |profile| profile.bytes().to_vec());
        Ok(Self { width, height, rgba, profile })
    }

    /// The ICC profile of its colours; empty for sRGB. Browsers convert colours themselves, so this module, which
    /// is to be small, does not.
    pub fn profile(&self) -> Vec<u8> {
        self.profile.clone()
    }

    /// Its pixels: RGBA, row by row from the top, alpha not multiplied into the colours.
    pub fn pixels(self) -> Vec<u8> {
        self.rgba
    }
}
