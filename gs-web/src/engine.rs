//! The backend that computes.

use gs_backend::{AnyRasterizer, Request, Wanted, can_render_2d, open};
use gs_core::{Backend as _, RenderSettings};
use wasm_bindgen::prelude::*;

use crate::failure;

/// A backend. It is opened once in a worker, and kept until the worker ends.
#[wasm_bindgen]
#[derive(Debug, Clone, Copy)]
pub struct Engine {
    pub(crate) on: &'static AnyRasterizer,
    reason: &'static str,
}

#[wasm_bindgen]
impl Engine {
    /// Opens a backend: "cpu", "wgpu", or "fastest", which is WebGPU where the browser has it.
    pub async fn open(wanted: String) -> Result<Engine, JsError> {
        let wanted = match wanted.as_str() {
            "cpu" => Wanted::Cpu,
            "wgpu" => Wanted::Wgpu,
            "fastest" => Wanted::Fastest,
            other => return Err(JsError::new(&format!("`{other}` is no backend: use cpu, wgpu or fastest"))),
        };
        let request = Request::default().with(|s| {
            s.wanted = wanted;
            s.threads = Some(rayon::current_num_threads());
        });
        let chosen = open(&request).await.map_err(failure)?;
        let on: &AnyRasterizer = Box::leak(Box::new(chosen.rasterizer));
        let what = match on {
            AnyRasterizer::Cpu(_) => "the CPU (WebAssembly with SIMD)".to_owned(),
            gpu => format!("WebGPU, {}", gpu.describe()),
        };
        Ok(Self { on, reason: format!("{what}: {}", chosen.why).leak() })
    }

    /// Whether the backend computes. A GPU no longer does after it was lost.
    pub async fn works(&self) -> bool {
        can_render_2d(self.on, &RenderSettings::default()).await.is_ok()
    }

    /// "cpu" or "wgpu".
    #[wasm_bindgen(getter)]
    pub fn name(&self) -> String {
        self.on.name().to_owned()
    }

    /// Threads of the worker's pool.
    #[wasm_bindgen(getter)]
    pub fn threads(&self) -> usize {
        rayon::current_num_threads()
    }

    /// What was chosen and why, in one line.
    #[wasm_bindgen(getter)]
    pub fn reason(&self) -> String {
        self.reason.to_owned()
    }
}
