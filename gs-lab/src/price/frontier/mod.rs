//! What accuracy costs in time: every approximation of a rendering is a setting, and its time and
//! its error are measured on the given scene, views and machine.
//!
//! A `Sweep` is a scene on several candidates: backends, instruction sets and configurations.
//! [`Search::run`] measures every setting alone: its time, and its error against a rendering
//! without cut-offs. Measurements are interleaved, after a warm-up. Each backend's default is
//! measured twice, as if it were two settings. Differences in time below the difference of these
//! two are noise.
//!
//! The reference picture has the effects of the default settings and no cut-offs: no α cut, no
//! early stop at full pixels. The first backend that can render it makes it. Other sort orders,
//! other antialiasing and fewer SH coefficients change the picture; their error is the difference
//! from the reference.
//!
//! `Binning::Reuse` is not measured: it is an approximation of training steps, not of a picture.

mod outcome;
mod pareto;
mod setting;
mod sweep;
#[cfg(test)]
mod tests;

use gs_backend::AnyRasterizer;
use gs_core::{Optimizer, RenderSettings, Scene};

use self::sweep::{Sweep, search};
use super::machine::candidates;
use crate::error::Error;

pub use self::outcome::Frontier;
pub(crate) use self::setting::Change;

/// A search for the frontier of a scene.
#[derive(Debug)]
pub struct Search<'a, S: Scene> {
    /// The scene.
    pub scene: &'a S,
    /// A rasterizer of each backend. Other configurations of the backend are candidates, too.
    pub backends: Vec<AnyRasterizer>,
    /// The default settings of all backends. Their effects define the reference picture.
    pub shown: RenderSettings,
    /// The views.
    pub views: &'a [S::View],
    /// Seconds for timing. At least seven rounds are measured, however long they take.
    pub seconds: f64,
}

impl<S: Scene> Search<'_, S>
where
    AnyRasterizer: Optimizer<S>,
{
    /// Measures every setting alone, on every backend. Reports its progress to `watch`.
    ///
    /// # Errors
    /// Those of the backends; [`gs_core::Error::Setting`] without a view or a backend.
    pub fn run(self, watch: &mut dyn FnMut(&str)) -> Result<Frontier, Error> {
        let Self { scene, backends, shown, views, seconds } = self;
        let mut all = Vec::new();
        for base in backends {
            all.extend(candidates(base, scene)?);
        }
        Ok(search(&Sweep { candidates: all, shown }, views, seconds, watch)?)
    }
}
