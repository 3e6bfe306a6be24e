//! Renders frames on a thread of its own, one at a time, as the window requests them.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::mpsc::Receiver,
    time::{Duration, Instant},
};

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{Camera, Canvas, Parameterization, Rasterizer, RenderSettings, Scene};
use gs_io::IccProfile;

use crate::{error::Error, levels::Finer, pixels::Picture};

/// A camera or a canvas.
pub(crate) trait View: Copy + std::fmt::Debug + PartialEq + Send + 'static {
    /// Columns and rows, px.
    fn size(&self) -> (u32, u32);

    /// Returns this view in this many pixels.
    fn resized(&self, width: u32, height: u32) -> Self;
}

impl View for Camera {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn resized(&self, width: u32, height: u32) -> Self {
        Camera::resized(self, width, height)
    }
}

impl View for Canvas {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn resized(&self, width: u32, height: u32) -> Self {
        Canvas::resized(*self, width, height)
    }
}

/// A request for a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Request<V> {
    /// The view of the whole window.
    pub(crate) view: V,
    /// Effects and background.
    pub(crate) settings: RenderSettings,
    /// The divisor of the picture's sides, at least 1.
    pub(crate) divisor: u32,
}

impl<V: View> Request<V> {
    /// Columns and rows of the picture, px.
    pub(crate) fn size(&self) -> (u32, u32) {
        let (width, height) = self.view.size();
        (width.div_ceil(self.divisor), height.div_ceil(self.divisor))
    }
}

/// The answer to a request.
#[derive(Debug)]
pub(crate) struct Answer<V> {
    /// The request.
    pub(crate) request: Request<V>,
    /// The picture, or why there is none.
    pub(crate) result: Result<Frame, Error>,
}

/// A frame.
#[derive(Debug)]
pub(crate) struct Frame {
    /// The picture.
    pub(crate) picture: Picture,
    /// The time from the request to the image on the host.
    pub(crate) took: Duration,
    /// Number of Gaussians of the scene in the picture.
    pub(crate) gaussians: usize,
    /// Whether finer levels of the scene are being read for this view.
    pub(crate) is_coarse: bool,
}

/// Renders until there are no more requests, or nobody takes the answer.
pub(crate) struct Renderer<'a, S: Scene, A> {
    /// The scene, or its coarsest levels of detail.
    pub(crate) scene: &'a S,
    /// Where finer levels come from.
    pub(crate) finer: Option<Finer<S>>,
    /// The profile of its colours; `None` for sRGB.
    pub(crate) profile: Option<&'a IccProfile>,
    /// The requests.
    pub(crate) requests: Receiver<Request<S::View>>,
    /// Takes an answer; false if nobody wants more.
    pub(crate) answer: A,
}

impl<S: Scene<View: View>, A: Fn(Answer<S::View>) -> bool> Renderer<'_, S, A>
where
    AnyRasterizer: Rasterizer<S>,
{
    /// Renders with this rasterizer.
    pub(crate) fn run(mut self, rasterizer: &AnyRasterizer) {
        let upload = |scene: &S| Ok(rasterizer.upload(scene, Parameterization::ScaleRotation)?);
        // An error is the answer to the first request.
        let (mut splats, mut gaussians) = (caught(|| upload(self.scene)), self.scene.len());
        let mut draw = |request: &Request<S::View>| -> Result<Frame, Error> {
            let start = Instant::now();
            let finer = self.finer.as_mut().map_or(Ok((None, false)), |finer| finer(&request.view));
            let (scene, is_coarse) = finer?;
            if let Some(scene) = scene {
                // A GPU may not hold both.
                splats = Err(Error::NothingVisible);
                (splats, gaussians) = (upload(&scene), scene.len());
            }
            let splats = splats.as_ref().map_err(Error::clone)?;
            let (width, height) = request.size();
            let pass =
                rasterizer.forward(splats, &request.view.resized(width, height), &request.settings).block_on()?;
            let mut image = Rasterizer::<S>::image(rasterizer, &pass).block_on()?;
            if let Some(profile) = self.profile {
                profile.to_srgb(&mut image);
            }
            let took = start.elapsed();
            Ok(Frame { picture: Picture::of(&image), took, gaussians, is_coarse })
        };
        for request in self.requests {
            if !(self.answer)(Answer { request, result: caught(|| draw(&request)) }) {
                return;
            }
        }
    }
}

/// The result of `draw`. A panic becomes an error of the backend: without an answer the window
/// would wait forever.
fn caught<T>(draw: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch_unwind(AssertUnwindSafe(draw)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        let message = format!("panic while rendering: {}", words.unwrap_or("without a message"));
        Err(gs_core::Error::Backend { backend: "view", message }.into())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_answer_like_any_other() {
        let error = caught::<()>(|| panic!("no frame {}", 7)).unwrap_err();
        assert!(matches!(error, Error::Backend(gs_core::Error::Backend { .. })));
        assert!(error.to_string().contains("no frame 7"), "{error}");
        assert_eq!(caught(|| Ok(3)), Ok(3));
    }
}
