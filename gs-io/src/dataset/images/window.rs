//! A part of an image.

use glam::Vec2;
use gs_core::Camera;
use serde::{Deserialize, Serialize};

/// A rectangle of an image, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Its first column.
    pub left: u32,
    /// Its first row.
    pub top: u32,
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
}

impl Window {
    /// The camera that sees the window of another's image.
    pub fn camera(&self, whole: &Camera) -> Camera {
        let corner = Vec2::new(self.left as f32, self.top as f32);
        Camera { center: whole.center - corner, width: self.width, height: self.height, ..*whole }
    }

    /// Whether the window lies in an image of this size (columns, rows).
    pub fn is_in(&self, (width, height): (u32, u32)) -> bool {
        let fits =
            |from: u32, length: u32, size: u32| length > 0 && from.checked_add(length).is_some_and(|end| end <= size);
        fits(self.left, self.width, width) && fits(self.top, self.height, height)
    }

    /// The window that is a whole image of this size.
    pub(super) fn whole((width, height): (u32, u32)) -> Self {
        Self { left: 0, top: 0, width, height }
    }
}
