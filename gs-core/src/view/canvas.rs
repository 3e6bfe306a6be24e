//! Views of 2D scenes: pixel grids over a rectangle of the plane.

use glam::Vec2;
use serde::{Deserialize, Serialize};

use crate::{error::Error, image::check_size};

/// A pixel grid over a rectangle of the plane, so that a 2D scene can be rendered at any size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Canvas {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Top-left corner of the rectangle shown, plane coordinates (px of the original image).
    pub origin: Vec2,
    /// Extent of the rectangle shown, plane coordinates; both sides positive.
    pub extent: Vec2,
}

impl Canvas {
    /// The canvas of a plane of `width` × `height` px at its own size.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, origin: Vec2::ZERO, extent: Vec2::new(width as f32, height as f32) }
    }

    /// Returns a canvas of the same rectangle of the plane at another size in pixels.
    pub fn resized(self, width: u32, height: u32) -> Self {
        Self { width, height, ..self }
    }

    /// Returns a canvas of another rectangle of the plane at the same size in pixels.
    pub fn showing(self, origin: Vec2, extent: Vec2) -> Self {
        Self { origin, extent, ..self }
    }

    /// Pixels per unit of the plane, along x and y.
    pub fn scale(&self) -> Vec2 {
        Vec2::new(self.width as f32, self.height as f32) / self.extent
    }

    /// Checks that the size is possible and the rectangle is finite with a positive extent.
    ///
    /// # Errors
    /// [`Error::Size`] or [`Error::Setting`] naming the first fault.
    pub fn validate(&self) -> Result<(), Error> {
        check_size(self.width, self.height)?;
        if !self.origin.is_finite() || !self.extent.is_finite() || !(self.extent.min_element() > 0.0) {
            let value = format!("{} + {}", self.origin, self.extent);
            return Err(Error::setting("canvas rectangle", value, "finite, with a positive extent"));
        }
        Ok(())
    }
}
