//! Navigation in a scene: orbiting, flying, panning. It knows no window, no keys and no clock.

mod pan_zoom;
mod viewpoint;

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use gs_core::{Camera, view::Bulk};

pub(crate) use self::{pan_zoom::CanvasNavigator, viewpoint::Viewpoint};
use crate::renderer::View;

/// The turn of the camera while the pointer crosses the height of the picture, rad.
const TURN_PER_HEIGHT: f32 = PI;

/// The factor of the distance for a notch of the wheel: about seven halve it.
const ZOOM_PER_NOTCH: f32 = 0.9;

/// The factor of the flying speed for a notch of the wheel.
const SPEED_PER_NOTCH: f32 = 1.25;

/// The most notches of one wheel event.
const MOST_NOTCHES: f32 = 20.0;

/// The first flying speed, radii of the scene's bulk per second.
const SPEED: f32 = 0.5;

/// The range of the flying speed, relative to the first.
const SPEED_RANGE: [f32; 2] = [1e-3, 1e3];

/// Turning speed of the arrow keys, rad/s.
const TURN_SPEED: f32 = 1.2;

/// The largest distance from the scene, radii of its bulk.
const FARTHEST: f32 = 1e3;

/// The least distance of the target, in near-plane distances.
const NEAREST: f32 = 2.0;

/// The longest time of one step, s, so that a pause does not cause a jump.
const LONGEST_STEP: f32 = 0.25;

/// The mode of navigation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// The camera turns around the target.
    Orbit,
    /// The camera turns on the spot, and keys move it.
    Fly,
    /// A 2D scene is panned and zoomed.
    Pan,
}

/// Navigation in a window.
pub(crate) trait Navigate {
    /// A camera or a canvas.
    type View: View;

    /// The mode.
    fn mode(&self) -> Mode;

    /// Sets the size of the window, px.
    fn resize(&mut self, width: u32, height: u32);

    /// The view of the window.
    fn view(&self) -> Self::View;

    /// The pointer was dragged by `shift`, px to the right and downwards.
    fn drag(&mut self, drag: Drag, shift: Vec2);

    /// The wheel was turned, away from the user if positive, with the pointer at this place, px; or
    /// a key does the same.
    fn zoom(&mut self, notches: f32, pointer: Option<Vec2>);

    /// Moves according to the held keys, for this many seconds.
    fn advance(&mut self, motion: &Motion, seconds: f32);

    /// Returns to the first view.
    fn reset(&mut self);

    /// Switches to the other mode, if there is one.
    fn switch_mode(&mut self) {}

    /// A hint for the overlay.
    fn hint(&self) -> String;
}

/// The kind of a drag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drag {
    /// Turn around the target; when flying, on the spot.
    Turn,
    /// Move sideways.
    Pan,
}

/// The motion of the held keys.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Motion {
    /// Motion to the right, up, forward, each −1 to 1; only for flying.
    pub(crate) way: Vec3,
    /// Turn to the right and downwards, each −1 to 1.
    pub(crate) turn: Vec2,
    /// Speed relative to the usual one.
    pub(crate) speed: f32,
}

/// Navigation of a camera.
#[derive(Debug, Clone)]
pub(crate) struct CameraNavigator {
    mode: Mode,
    viewpoint: Viewpoint,
    home: Viewpoint,
    /// The first camera, with intrinsics for its own size of picture.
    lens: Camera,
    /// Size of the picture, px.
    size: (u32, u32),
    /// Where most of the scene is.
    bulk: Bulk,
    /// Flying speed, world units per second.
    speed: f32,
}

impl CameraNavigator {
    /// Begins with a camera whose target is `distance` ahead. Turns are around `up`.
    pub(crate) fn new(camera: &Camera, distance: f32, up: Vec3, bulk: Bulk) -> Self {
        let nearest = NEAREST * camera.near;
        let viewpoint = Viewpoint::of(camera, distance.max(nearest), up);
        Self {
            mode: Mode::Orbit,
            viewpoint,
            home: viewpoint,
            lens: *camera,
            size: (camera.width, camera.height),
            bulk,
            speed: SPEED * bulk.radius,
        }
    }

    /// Keeps the target near the scene or near the first target, so that numbers stay finite.
    fn stay_near(&mut self) {
        let (center, reach) = (self.bulk.center, FARTHEST * self.bulk.radius);
        let reach = reach.max(2.0 * self.home.target.distance(center));
        let away = self.viewpoint.target - center;
        self.viewpoint.target = center + away.clamp_length_max(reach);
    }
}

impl Navigate for CameraNavigator {
    type View = Camera;

    fn mode(&self) -> Mode {
        self.mode
    }

    fn resize(&mut self, width: u32, height: u32) {
        self.size = (width.max(1), height.max(1));
    }

    /// The camera for the size of the picture. It shows all that the first picture showed, with the
    /// same proportions of pixels.
    fn view(&self) -> Camera {
        let (lens, (width, height)) = (&self.lens, self.size);
        let size = |width: u32, height: u32| Vec2::new(width as f32, height as f32);
        let (before, now) = (size(lens.width, lens.height), size(width, height));
        let scale = (now / before).min_element();
        let center = 0.5 * now + scale * (lens.center - 0.5 * before);
        self.viewpoint.camera(&Camera { focal: scale * lens.focal, center, width, height, ..*lens })
    }

    fn drag(&mut self, drag: Drag, shift: Vec2) {
        let camera = self.view();
        match (drag, self.mode) {
            (Drag::Turn, Mode::Orbit | Mode::Pan) => {
                self.viewpoint.orbit(shift * TURN_PER_HEIGHT / camera.height as f32)
            }
            (Drag::Turn, Mode::Fly) => self.viewpoint.look(shift / camera.focal),
            (Drag::Pan, _) => self.viewpoint.pan(shift, camera.focal),
        }
        self.stay_near();
    }

    /// Moves nearer to the target, but never past it; when flying, moves faster.
    fn zoom(&mut self, notches: f32, _: Option<Vec2>) {
        let notches = notches.clamp(-MOST_NOTCHES, MOST_NOTCHES);
        match self.mode {
            Mode::Orbit | Mode::Pan => {
                let nearest = NEAREST * self.lens.near;
                let distance = self.viewpoint.distance * ZOOM_PER_NOTCH.powf(notches);
                self.viewpoint.distance = distance.min(FARTHEST * self.bulk.radius).max(nearest);
            }
            Mode::Fly => {
                let [slowest, fastest] = SPEED_RANGE.map(|times| times * SPEED * self.bulk.radius);
                self.speed = (self.speed * SPEED_PER_NOTCH.powf(notches)).min(fastest).max(slowest);
            }
        }
    }

    fn advance(&mut self, motion: &Motion, seconds: f32) {
        let seconds = seconds.clamp(0.0, LONGEST_STEP);
        let turn = motion.turn * TURN_SPEED * seconds;
        match self.mode {
            Mode::Orbit | Mode::Pan => self.viewpoint.orbit(turn),
            Mode::Fly => {
                self.viewpoint.look(turn);
                self.viewpoint.walk(motion.way.normalize_or_zero() * self.speed * motion.speed * seconds);
            }
        }
        self.stay_near();
    }

    fn reset(&mut self) {
        self.viewpoint = self.home;
        self.speed = SPEED * self.bulk.radius;
    }

    fn switch_mode(&mut self) {
        self.mode = match self.mode {
            Mode::Orbit => Mode::Fly,
            Mode::Fly | Mode::Pan => Mode::Orbit,
        };
    }

    fn hint(&self) -> String {
        match self.mode {
            Mode::Orbit | Mode::Pan => {
                "orbit: drag turns, right or shift+drag pans, wheel zooms, arrows turn".to_owned()
            }
            Mode::Fly => {
                let speed = self.speed;
                format!("fly: WASD QE move, shift faster, drag or arrows look, wheel sets the speed ({speed:.3}/s)")
            }
        }
    }
}

impl Motion {
    /// Whether no key asks for motion.
    pub(crate) fn is_none(&self) -> bool {
        self.way == Vec3::ZERO && self.turn == Vec2::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BULK: Bulk = Bulk { center: Vec3::new(1.0, 0.5, 0.0), radius: 2.0 };

    fn navigator() -> CameraNavigator {
        let camera = BULK.overview(80, 60, 0.9, Vec3::NEG_Y).unwrap();
        CameraNavigator::new(&camera, camera.position().distance(BULK.center), Vec3::NEG_Y, BULK)
    }

    #[test]
    fn zooming_never_passes_the_target() {
        let mut navigator = navigator();
        let (target, forward) = (navigator.viewpoint.target, navigator.viewpoint.axes().forward);
        let mut last = f32::INFINITY;
        for _ in 0..500 {
            navigator.zoom(3.0, None);
            let depth = navigator.view().to_camera(target).z;
            assert!(depth > navigator.view().near && depth <= last, "{depth} after {last}");
            last = depth;
        }
        assert!(last < 0.05, "it does come near: {last}");
        assert_eq!(navigator.viewpoint.axes().forward, forward);
        navigator.zoom(-1.0, None);
        assert!(navigator.view().to_camera(target).z > last, "and goes back");
        for notches in [f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, -20.0, -20.0, -20.0] {
            navigator.zoom(notches, None);
            navigator.view().validate().unwrap();
        }
    }

    #[test]
    fn numbers_stay_finite() {
        let mut navigator = navigator();
        navigator.switch_mode();
        for i in 0..4000 {
            navigator.zoom(20.0, None);
            navigator.advance(&Motion { way: Vec3::new(1.0, 0.3, 1.0), turn: Vec2::splat(0.01), speed: 4.0 }, 1e9);
            navigator.drag(Drag::Pan, Vec2::new(1e6, -1e6));
            if i % 7 == 0 {
                navigator.drag(Drag::Turn, Vec2::new(1e4, 1e4));
            }
        }
        navigator.view().validate().unwrap();
        assert!(navigator.view().position().distance(BULK.center) < 3.0 * FARTHEST * BULK.radius);
        navigator.reset();
        assert_eq!(navigator.viewpoint, navigator.home);
    }

    #[test]
    fn flying_moves_ahead_and_orbiting_does_not() {
        let forward = Motion { way: Vec3::Z, turn: Vec2::ZERO, speed: 1.0 };
        let mut orbiting = navigator();
        let before = orbiting.view();
        orbiting.advance(&forward, 0.1);
        assert_eq!(orbiting.view(), before, "only flight has a forward");
        let mut flying = navigator();
        flying.switch_mode();
        flying.advance(&forward, 0.1);
        let moved = flying.view().position() - before.position();
        let expected = 0.1 * flying.speed * before.rotation.row(2);
        assert!(moved.distance(expected) < 1e-4, "{moved} {expected}");
        flying.advance(&Motion { speed: 4.0, way: -Vec3::Z, ..forward }, 0.1);
        let back = flying.view().position() - before.position();
        assert!(back.distance(-3.0 * expected) < 1e-4, "{back}");
        flying.advance(&Motion { turn: Vec2::new(-1.0, 0.0), way: Vec3::ZERO, speed: 1.0 }, 0.1);
        let turned = flying.view().rotation.row(2).dot(before.rotation.row(0));
        assert!(turned < -0.05, "to the left: {turned}");
        flying.switch_mode();
        let eye = flying.viewpoint.eye();
        assert!(flying.view().position().distance(eye) < 1e-5, "a switch moves nothing: {eye}");
    }

    #[test]
    fn another_size_shows_all_of_the_first_picture() {
        let mut navigator = navigator();
        let home = navigator.view();
        let corner = |camera: &Camera| {
            (camera.center / camera.focal, {
                let size = Vec2::new(camera.width as f32, camera.height as f32);
                (size - camera.center) / camera.focal
            })
        };
        for (width, height) in [(160, 120), (200, 60), (31, 90), (1, 1), (0, 7)] {
            navigator.resize(width, height);
            let camera = navigator.view();
            camera.validate().unwrap();
            assert_eq!(camera.focal.x, camera.focal.y);
            let ((a, b), (c, d)) = (corner(&home), corner(&camera));
            assert!((c - a).min_element() > -1e-5 && (d - b).min_element() > -1e-5, "{width}x{height}");
        }
    }
}
