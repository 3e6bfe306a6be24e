//! `gs fit --film`: an animation of the fit, with the number of Gaussians.

use std::{
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
};

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{Canvas, Image, Rasterizer as _, Scene2d, counted};
use gs_io::{Animation, write_animation};
use gs_lab::report::captioned;
use gs_train::Trainer;

use crate::{failure::Failure, training::Pauses};

/// Frames of the whole fit, about; the first shows the initial Gaussians, the last the result.
const FRAMES: u32 = 40;

/// Longer side of a frame without its caption, px.
const LONGEST_PX: u32 = 512;

/// Frames per second, and time for which the last one stays, s.
const FPS: u16 = 12;
const LAST_S: u16 = 2;

/// The frames of a fit so far, 8 bits a channel.
#[derive(Debug)]
pub(super) struct Film<'a> {
    on: &'a AnyRasterizer,
    canvas: Canvas,
    iterations: u32,
    taken: Mutex<Taken>,
}

/// The frames, all of one size.
#[derive(Debug, Default)]
struct Taken {
    size: (u32, u32),
    /// R, G, B of each pixel.
    frames: Vec<Vec<u8>>,
    /// Step of the last frame.
    last: Option<u32>,
}

impl<'a> Film<'a> {
    /// A film that begins with the state of this run.
    pub(super) fn begin(on: &'a AnyRasterizer, trainer: &Trainer<'_, AnyRasterizer>) -> Result<Self, Failure> {
        let (width, height) = trainer.target().size();
        let scale = (f64::from(LONGEST_PX) / f64::from(width.max(height))).min(1.0);
        let [columns, rows] = [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
        let canvas = Canvas::new(width, height).resized(columns, rows);
        let iterations = trainer.iterations();
        let film = Self { on, canvas, iterations, taken: Mutex::default() };
        film.take(trainer)?;
        Ok(film)
    }

    fn taken(&self) -> MutexGuard<'_, Taken> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What takes the frames.
    pub(super) fn as_pauses(&self) -> &dyn Pauses<Scene2d> {
        self
    }

    /// Takes a frame of the present state.
    fn take(&self, trainer: &Trainer<'_, AnyRasterizer>) -> Result<(), Failure> {
        let scene = trainer.scene().block_on()?;
        let picture = self.on.render(&scene, &self.canvas, &trainer.shown()).block_on()?;
        let text = format!("step {} of {}: {}", trainer.step(), self.iterations, counted(trainer.count(), "Gaussian"));
        let frame = captioned(&picture, &text)?;
        let mut taken = self.taken();
        taken.size = frame.size();
        taken.frames.push(frame.to_8_bits());
        taken.last = Some(trainer.step());
        Ok(())
    }

    /// Writes the frames, the last of which is the present state.
    pub(super) fn write(&self, path: &Path, trainer: &Trainer<'_, AnyRasterizer>) -> Result<(), Failure> {
        if self.taken().last != Some(trainer.step()) {
            self.take(trainer)?;
        }
        let Taken { size: (width, height), frames, .. } = &*self.taken();
        let (width, height) = (*width, *height);
        let animation = Animation { width, height, frames: frames.len() as u32, fps: FPS, last_s: LAST_S };
        write_animation(path, animation, |number| {
            let bytes = &frames[number as usize];
            let pixels = bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
            Image::from_pixels(width, height, pixels).map_err(Failure::from)
        })
    }
}

impl Pauses<Scene2d> for Film<'_> {
    /// The number grows at first and hardly changes later, so frames are closer at first.
    fn next(&self) -> u32 {
        let share = f64::from(self.taken().frames.len() as u32) / f64::from(FRAMES - 1);
        (f64::from(self.iterations) * share.powf(1.5)).ceil() as u32
    }

    fn pause(&self, trainer: &mut Trainer<'_, AnyRasterizer>) -> Result<(), Failure> {
        self.take(trainer)
    }
}
