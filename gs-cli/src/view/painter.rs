//! Frames, off the window's thread: the chosen backend holds the scene and draws what it is sent, one frame at a time.

use pollster::FutureExt as _;
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::mpsc::Receiver,
    time::{Duration, Instant},
};

use gs_core::{Camera, Canvas, Optimizer, Parameterization, RenderSettings, Scene, Scene2d, Scene3d};

use crate::{
    backend::{Task, Task3d},
    failure::Failure,
    view::pixels::Picture,
};

/// What a frame is rendered from.
pub(crate) trait View: Copy + std::fmt::Debug + PartialEq + Send + 'static {
    /// Columns and rows, px.
    fn size(&self) -> (u32, u32);

    /// The same in so many pixels.
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

/// A frame to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Request<V> {
    /// What the whole window shows.
    pub(crate) view: V,
    /// Effects and background.
    pub(crate) settings: RenderSettings,
    /// By what the sides of the picture are divided, at least 1.
    pub(crate) divisor: u32,
}

impl<V: View> Request<V> {
    /// Size of the picture that is drawn, px.
    pub(crate) fn size(&self) -> (u32, u32) {
        let (width, height) = self.view.size();
        (width.div_ceil(self.divisor), height.div_ceil(self.divisor))
    }
}

/// What came of a request.
#[derive(Debug)]
pub(crate) struct Answer<V> {
    /// What was asked for.
    pub(crate) request: Request<V>,
    /// The picture, or why there is none.
    pub(crate) result: Result<Painted, Failure>,
}

/// A frame.
#[derive(Debug)]
pub(crate) struct Painted {
    /// What is to be seen.
    pub(crate) picture: Picture,
    /// From the request to the image on the host.
    pub(crate) took: Duration,
}

/// Draws until nobody asks any more, or nobody wants the answer.
pub(crate) struct Painter<'a, S: Scene, A> {
    /// What is drawn.
    pub(crate) scene: &'a S,
    /// What is asked for.
    pub(crate) requests: Receiver<Request<S::View>>,
    /// Takes the answers; false where nobody is there any more.
    pub(crate) answer: A,
}

impl<A: Fn(Answer<Camera>) -> bool> Task3d for Painter<'_, Scene3d, A> {
    type Output = ();

    fn run<R: Optimizer<Scene3d>>(self, rasterizer: &R) {
        self.paint(rasterizer);
    }
}

impl<A: Fn(Answer<Canvas>) -> bool> Task for Painter<'_, Scene2d, A> {
    type Output = ();

    fn run<R: Optimizer<Scene2d>>(self, rasterizer: &R) {
        self.paint(rasterizer);
    }
}

impl<S: Scene<View: View>, A: Fn(Answer<S::View>) -> bool> Painter<'_, S, A> {
    fn paint<R: Optimizer<S>>(self, rasterizer: &R) {
        // What fails here is told to whoever asks for the first frame.
        let splats = caught(|| Ok(rasterizer.upload(self.scene, Parameterization::ScaleRotation)?));
        let draw = |request: &Request<S::View>| -> Result<Painted, Failure> {
            let splats = splats.as_ref().map_err(Failure::clone)?;
            let (width, height) = request.size();
            let start = Instant::now();
            let frame =
                rasterizer.forward(splats, &request.view.resized(width, height), &request.settings).block_on()?;
            let image = rasterizer.image(&frame).block_on()?;
            let took = start.elapsed();
            Ok(Painted { picture: Picture::of(&image), took })
        };
        for request in self.requests {
            if !(self.answer)(Answer { request, result: caught(|| draw(&request)) }) {
                return;
            }
        }
    }
}

/// What `draw` comes to; a panic as the failure of a backend, which ends the program: without an answer the window would wait for ever.
fn caught<T>(draw: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    catch_unwind(AssertUnwindSafe(draw)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        let message = format!("it panicked while it drew: {}", words.unwrap_or("without words"));
        Err(gs_core::Error::Backend { backend: "view", message }.into())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_answer_like_any_other() {
        let failure = caught::<()>(|| panic!("no frame {}", 7)).unwrap_err();
        assert!(failure.is_of_backend());
        assert!(failure.line().is_some_and(|line| line.contains("no frame 7")), "{failure:?}");
        assert_eq!(caught(|| Ok(3)), Ok(3));
    }
}
