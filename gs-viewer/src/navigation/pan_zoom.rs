//! Panning and zooming over a 2D scene.

use glam::Vec2;
use gs_core::Canvas;

use super::{Drag, MOST_NOTCHES, Mode, Motion, Navigate};

/// The factor of the zoom for a notch of the wheel.
const ZOOM_PER_NOTCH: f32 = 1.2;

/// The smallest zoom, relative to where the whole picture just fits.
const LEAST: f32 = 0.25;

/// The largest zoom, pixels of the window per pixel of the picture.
const MOST: f32 = 256.0;

/// Panning speed of the arrow keys, shares of the window's shorter side per second.
const PAN_SPEED: f32 = 0.8;

/// The longest time of one step, s.
const LONGEST_STEP: f32 = 0.25;

/// Navigation over a canvas.
#[derive(Debug, Clone)]
pub(crate) struct CanvasNavigator {
    /// Width and height of the picture, plane coordinates.
    picture: Vec2,
    /// Size of the window, px.
    size: (u32, u32),
    /// The point in the middle of the window, plane coordinates.
    center: Vec2,
    /// The zoom, relative to where the whole picture just fits.
    zoom: f32,
}

impl CanvasNavigator {
    /// Begins with the whole picture in view.
    pub(crate) fn new(width: u32, height: u32) -> Self {
        let picture = Vec2::new(width as f32, height as f32);
        Self { picture, size: (width, height), center: 0.5 * picture, zoom: 1.0 }
    }

    fn window(&self) -> Vec2 {
        Vec2::new(self.size.0 as f32, self.size.1 as f32)
    }

    /// Pixels of the window per pixel of the picture if the whole picture just fits.
    fn fit(&self) -> f32 {
        (self.window() / self.picture).min_element()
    }

    /// Pixels of the window per pixel of the picture.
    fn scale(&self) -> f32 {
        self.fit() * self.zoom
    }

    fn move_by(&mut self, shift: Vec2) {
        self.center = (self.center + shift).clamp(Vec2::ZERO, self.picture);
    }
}

impl Navigate for CanvasNavigator {
    type View = Canvas;

    fn mode(&self) -> Mode {
        Mode::Pan
    }

    fn resize(&mut self, width: u32, height: u32) {
        self.size = (width.max(1), height.max(1));
    }

    fn view(&self) -> Canvas {
        let extent = self.window() / self.scale();
        Canvas::new(self.size.0, self.size.1).showing(self.center - 0.5 * extent, extent)
    }

    fn drag(&mut self, _: Drag, shift: Vec2) {
        self.move_by(-shift / self.scale());
    }

    fn zoom(&mut self, notches: f32, pointer: Option<Vec2>) {
        let from_middle = pointer.map_or(Vec2::ZERO, |pointer| pointer - 0.5 * self.window());
        let before = self.scale();
        let zoom = self.zoom * ZOOM_PER_NOTCH.powf(notches.clamp(-MOST_NOTCHES, MOST_NOTCHES));
        self.zoom = zoom.min((MOST / self.fit()).max(1.0)).max(LEAST);
        // The point under the pointer stays there.
        self.move_by(from_middle / before - from_middle / self.scale());
    }

    fn advance(&mut self, motion: &Motion, seconds: f32) {
        let px =
            motion.turn * PAN_SPEED * self.window().min_element() * seconds.clamp(0.0, LONGEST_STEP) * motion.speed;
        self.move_by(px / self.scale());
    }

    fn reset(&mut self) {
        (self.center, self.zoom) = (0.5 * self.picture, 1.0);
    }

    fn hint(&self) -> String {
        format!("{:.0} % · drag or arrows pan, wheel or + - zoom", 100.0 * self.scale())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn navigator() -> CanvasNavigator {
        let mut navigator = CanvasNavigator::new(300, 200);
        navigator.resize(600, 600);
        navigator
    }

    /// The place of the picture under a pixel of the window.
    fn under(navigator: &CanvasNavigator, pixel: Vec2) -> Vec2 {
        let Canvas { origin, .. } = navigator.view();
        origin + pixel / navigator.view().scale()
    }

    #[test]
    fn the_whole_picture_is_in_view_first() {
        let canvas = navigator().view();
        assert_eq!((canvas.width, canvas.height, canvas.scale()), (600, 600, Vec2::splat(2.0)));
        assert_eq!((canvas.origin, canvas.extent), (Vec2::new(0.0, -50.0), Vec2::splat(300.0)));
        assert!(navigator().hint().starts_with("200 %"));
    }

    #[test]
    fn the_point_under_the_pointer_stays_there() {
        let mut navigator = navigator();
        let pointer = Vec2::new(140.0, 330.0);
        let before = under(&navigator, pointer);
        for notches in [3.0, 1.0, -2.0, 4.5] {
            navigator.zoom(notches, Some(pointer));
            assert!(under(&navigator, pointer).abs_diff_eq(before, 1e-2), "{}", under(&navigator, pointer));
        }
        assert!(navigator.scale() > 2.0);
        navigator.reset();
        assert_eq!(navigator.view(), self::navigator().view());
    }

    #[test]
    fn drags_and_arrows_pan() {
        let mut navigator = navigator();
        navigator.zoom(5.0, None);
        let grabbed = under(&navigator, Vec2::new(300.0, 300.0));
        navigator.drag(Drag::Turn, Vec2::new(40.0, -25.0));
        assert!(under(&navigator, Vec2::new(340.0, 275.0)).abs_diff_eq(grabbed, 1e-3));
        let before = navigator.center;
        navigator.advance(&Motion { turn: Vec2::X, speed: 1.0, ..Motion::default() }, 0.1);
        assert!(navigator.center.x > before.x && navigator.center.y == before.y);
    }

    #[test]
    fn the_picture_stays_in_reach_and_numbers_finite() {
        let mut navigator = navigator();
        for notches in [f32::MAX, f32::INFINITY, 20.0, f32::MIN, -20.0, -20.0, 7.0] {
            navigator.zoom(notches, Some(Vec2::new(3.0, 599.0)));
            navigator.drag(Drag::Pan, Vec2::new(1e6, -1e6));
            navigator.view().validate().unwrap();
            assert!(navigator.center.clamp(Vec2::ZERO, navigator.picture) == navigator.center);
            assert!(navigator.scale() <= MOST && navigator.zoom >= LEAST);
        }
    }
}
