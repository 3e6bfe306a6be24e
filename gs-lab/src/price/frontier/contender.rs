//! A contender: a backend with its configuration and the uploaded scene.

use gs_backend::FutureExt as _;
use std::{rc::Rc, time::Instant};

use gs_core::{Error, Image, Optimizer, RenderSettings, Scene};

use super::Change;

/// A rasterizer with its scene, independent of its type.
pub trait Renderer<V> {
    /// Seconds of one forward pass, until the backend has finished it. The image is not read back.
    fn seconds(&self, view: &V, settings: &RenderSettings) -> Result<f64, Error>;

    /// The picture.
    fn image(&self, view: &V, settings: &RenderSettings) -> Result<Image, Error>;
}

/// A rasterizer with splats, which several rasterizers of the type may share.
#[derive(Debug)]
pub struct Loaded<R: Optimizer<S>, S: Scene> {
    /// What renders.
    pub rasterizer: R,
    /// What is rendered.
    pub splats: Rc<R::Splats>,
}

impl<R: Optimizer<S>, S: Scene> Renderer<S::View> for Loaded<R, S> {
    fn seconds(&self, view: &S::View, settings: &RenderSettings) -> Result<f64, Error> {
        let start = Instant::now();
        let frame = self.rasterizer.forward(&self.splats, view, settings).block_on()?;
        // Reading the counts waits for the device.
        self.rasterizer.culled(&frame);
        Ok(start.elapsed().as_secs_f64())
    }

    fn image(&self, view: &S::View, settings: &RenderSettings) -> Result<Image, Error> {
        self.rasterizer.image(&self.rasterizer.forward(&self.splats, view, settings).block_on()?).block_on()
    }
}

/// A named renderer.
pub struct Contender<'a, V> {
    /// Name of the contender's backend. The first contender of a backend is the one that the
    /// default is measured on.
    pub backend: String,
    /// The machine for reports: "cpu (avx512, 2 threads)".
    pub name: String,
    /// The difference from the first contender of the same backend; `None` for the first.
    pub change: Option<Change>,
    /// What renders.
    pub renderer: Box<dyn Renderer<V> + 'a>,
}

impl<V> std::fmt::Debug for Contender<'_, V> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Contender").field("backend", &self.backend).field("name", &self.name).finish_non_exhaustive()
    }
}
