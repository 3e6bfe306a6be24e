//! The engine of the page, for JavaScript: backends, fits of images, and scenes to look at.
//!
//! All of it runs in a worker, or in several that share its memory. Numbers and pixels cross the border as arrays, everything else as
//! JSON. A failure is an `Error` whose message can be shown.
#![cfg(target_family = "wasm")]

#[cfg(feature = "viewer")]
mod engine;
#[cfg(feature = "page")]
mod fit;
#[cfg(feature = "viewer")]
mod levels;
#[cfg(feature = "picture")]
mod picture;
#[cfg(feature = "viewer")]
mod pixels;
#[cfg(feature = "page")]
mod settings;
#[cfg(feature = "page")]
mod threads;
#[cfg(feature = "viewer")]
mod view;

use wasm_bindgen::prelude::*;

#[cfg(feature = "viewer")]
pub use crate::engine::Engine;
#[cfg(feature = "picture")]
pub use crate::picture::Picture;
#[cfg(feature = "page")]
pub use crate::{
    fit::Fit,
    settings::policies,
    threads::{run_thread, start_threads},
};
#[cfg(feature = "viewer")]
pub use crate::{levels::Levels, view::View};

/// The text of any error, for JavaScript.
fn failure(error: impl std::fmt::Display) -> JsError {
    JsError::new(&error.to_string())
}

/// What a JSON argument holds.
#[cfg(feature = "viewer")]
fn parsed<T: serde::de::DeserializeOwned>(json: &str) -> Result<T, JsError> {
    serde_json::from_str(json).map_err(failure)
}

#[wasm_bindgen]
extern "C" {
    #[wasm_bindgen(js_namespace = console, js_name = error)]
    fn console_error(text: &str);
}

/// Panics are faults of the program; the console gets their place.
#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|info| console_error(&info.to_string())));
}

/// Bytes of the engine's memory, which never shrinks: freed parts are used again.
#[wasm_bindgen(js_name = memoryBytes)]
pub fn memory_bytes() -> f64 {
    core::arch::wasm32::memory_size(0) as f64 * 65_536.0
}
