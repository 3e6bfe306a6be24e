//! How one moves through a scene: around a point, or flying; over a picture, panning. Arithmetic alone, without window, keys or clock.

mod plane;
mod viewpoint;

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use gs_core::{Camera, view::Bulk};

pub(crate) use self::{plane::PlaneNavigator, viewpoint::Viewpoint};
use crate::view::painter::View;

/// How far the camera turns around the point looked at while the pointer crosses the picture from top to bottom, rad.
const TURN_PER_HEIGHT: f32 = PI;

/// What a notch of the wheel makes of the distance: about seven halve it.
const ZOOM_PER_NOTCH: f32 = 0.9;

/// What a notch of the wheel makes of the speed of flight.
const SPEED_PER_NOTCH: f32 = 1.25;

/// The most notches that one event of a wheel counts as.
const MOST_NOTCHES: f32 = 20.0;

/// Speed of flight in the beginning, radii of the scene's bulk per second.
const SPEED: f32 = 0.5;

/// How much slower or faster than that it may become.
const SPEED_RANGE: [f32; 2] = [1e-3, 1e3];

/// Turn by the arrow keys, rad/s.
const TURN_SPEED: f32 = 1.2;

/// How far from the scene one can get, radii of its bulk.
const FARTHEST: f32 = 1e3;

/// The target is not zoomed to nearer than this many times the distance at which things vanish.
const NEAREST: f32 = 2.0;

/// The longest time in one go, s; whoever comes back from a pause is not carried off.
const LONGEST_STEP: f32 = 0.25;

/// What moves, and what stands still.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// The camera goes around the point looked at.
    Orbit,
    /// The camera turns on the spot, and keys move it.
    Fly,
    /// A picture is moved and enlarged.
    Plane,
}

/// What is seen in a window, and how that changes.
pub(crate) trait Navigate {
    /// What a frame is rendered from.
    type View: View;

    /// What moves.
    fn mode(&self) -> Mode;

    /// The window has another size from now on, px.
    fn resize(&mut self, width: u32, height: u32);

    /// What the window shows.
    fn view(&self) -> Self::View;

    /// The pointer was dragged by `shift`, px to the right and downwards.
    fn drag(&mut self, drag: Drag, shift: Vec2);

    /// The wheel was turned, away from oneself if positive, with the pointer there, px; or a key does the same.
    fn zoom(&mut self, notches: f32, pointer: Option<Vec2>);

    /// Goes where the keys ask to, for so many seconds.
    fn advance(&mut self, motion: &Motion, seconds: f32);

    /// Back to where it began.
    fn reset(&mut self);

    /// Goes on in another way, where there is one.
    fn switch_mode(&mut self) {}

    /// How one moves, for people.
    fn hint(&self) -> String;
}

/// What a drag of the pointer does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drag {
    /// Around the point looked at; flying, on the spot.
    Turn,
    /// Sideways.
    Pan,
}

/// What the keys that are held ask for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Motion {
    /// To the right, up, forward, each −1 to 1; heard in flight only.
    pub(crate) way: Vec3,
    /// To the right and downwards, each −1 to 1.
    pub(crate) turn: Vec2,
    /// How many times faster than usual.
    pub(crate) haste: f32,
}

/// The camera of a window, and how it moves.
#[derive(Debug, Clone)]
pub(crate) struct Navigator {
    mode: Mode,
    viewpoint: Viewpoint,
    home: Viewpoint,
    /// The camera that it began with: intrinsics for its own size of picture.
    lens: Camera,
    /// Size of the picture, px.
    size: (u32, u32),
    /// What is moved through.
    bulk: Bulk,
    /// Speed of flight, world units per second.
    speed: f32,
}

impl Navigator {
    /// Begins with a camera whose axis passes what it looks at `distance` ahead; `up` is what turns go around.
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

    /// Goes on in the other way, from where it is.
    pub(crate) fn switch_mode(&mut self) {
        self.mode = match self.mode {
            Mode::Orbit => Mode::Fly,
            Mode::Fly | Mode::Plane => Mode::Orbit,
        };
    }

    /// Back to where it began.
    pub(crate) fn reset(&mut self) {
        self.viewpoint = self.home;
        self.speed = SPEED * self.bulk.radius;
    }

    /// The picture has another size from now on, px, each side at least 1.
    pub(crate) fn resize(&mut self, width: u32, height: u32) {
        self.size = (width.max(1), height.max(1));
    }

    /// The camera: pixels stay square (or as they were), and all that the first picture showed is in it, with more to the sides if need be.
    pub(crate) fn camera(&self) -> Camera {
        let (lens, (width, height)) = (&self.lens, self.size);
        let size = |width: u32, height: u32| Vec2::new(width as f32, height as f32);
        let (before, now) = (size(lens.width, lens.height), size(width, height));
        let scale = (now / before).min_element();
        let center = 0.5 * now + scale * (lens.center - 0.5 * before);
        self.viewpoint.camera(&Camera { focal: scale * lens.focal, center, width, height, ..*lens })
    }

    /// The pointer was dragged by `shift`, px to the right and downwards.
    pub(crate) fn drag(&mut self, drag: Drag, shift: Vec2) {
        let camera = self.camera();
        match (drag, self.mode) {
            (Drag::Turn, Mode::Orbit | Mode::Plane) => {
                self.viewpoint.orbit(shift * TURN_PER_HEIGHT / camera.height as f32)
            }
            (Drag::Turn, Mode::Fly) => self.viewpoint.look(shift / camera.focal),
            (Drag::Pan, _) => self.viewpoint.pan(shift, camera.focal),
        }
        self.stay_near();
    }

    /// The wheel was turned, away from oneself if positive: towards the point looked at, which is never passed; flying, faster.
    pub(crate) fn wheel(&mut self, notches: f32) {
        let notches = notches.clamp(-MOST_NOTCHES, MOST_NOTCHES);
        match self.mode {
            Mode::Orbit | Mode::Plane => {
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

    /// Goes where the keys ask to, for so many seconds.
    pub(crate) fn advance(&mut self, motion: &Motion, seconds: f32) {
        let seconds = seconds.clamp(0.0, LONGEST_STEP);
        let turn = motion.turn * TURN_SPEED * seconds;
        match self.mode {
            Mode::Orbit | Mode::Plane => self.viewpoint.orbit(turn),
            Mode::Fly => {
                self.viewpoint.look(turn);
                self.viewpoint.walk(motion.way.normalize_or_zero() * self.speed * motion.haste * seconds);
            }
        }
        self.stay_near();
    }

    /// Keeps the point looked at within reach of the scene, or of where it was in the beginning, so that numbers stay what they are.
    fn stay_near(&mut self) {
        let (center, reach) = (self.bulk.center, FARTHEST * self.bulk.radius);
        let reach = reach.max(2.0 * self.home.target.distance(center));
        let away = self.viewpoint.target - center;
        self.viewpoint.target = center + away.clamp_length_max(reach);
    }
}

impl Navigate for Navigator {
    type View = Camera;

    fn mode(&self) -> Mode {
        self.mode
    }

    fn resize(&mut self, width: u32, height: u32) {
        self.resize(width, height);
    }

    fn view(&self) -> Camera {
        self.camera()
    }

    fn drag(&mut self, drag: Drag, shift: Vec2) {
        self.drag(drag, shift);
    }

    fn zoom(&mut self, notches: f32, _: Option<Vec2>) {
        self.wheel(notches);
    }

    fn advance(&mut self, motion: &Motion, seconds: f32) {
        self.advance(motion, seconds);
    }

    fn reset(&mut self) {
        self.reset();
    }

    fn switch_mode(&mut self) {
        self.switch_mode();
    }

    fn hint(&self) -> String {
        match self.mode {
            Mode::Orbit | Mode::Plane => {
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
    /// Whether nothing is asked for.
    pub(crate) fn is_none(&self) -> bool {
        self.way == Vec3::ZERO && self.turn == Vec2::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BULK: Bulk = Bulk { center: Vec3::new(1.0, 0.5, 0.0), radius: 2.0 };

    fn navigator() -> Navigator {
        let camera = BULK.overview(80, 60, 0.9, Vec3::NEG_Y).unwrap();
        Navigator::new(&camera, camera.position().distance(BULK.center), Vec3::NEG_Y, BULK)
    }

    #[test]
    fn zooming_comes_near_but_never_passes() {
        let mut navigator = navigator();
        let (target, forward) = (navigator.viewpoint.target, navigator.viewpoint.axes().forward);
        let mut last = f32::INFINITY;
        for _ in 0..500 {
            navigator.wheel(3.0);
            let depth = navigator.camera().to_camera(target).z;
            assert!(depth > navigator.camera().near && depth <= last, "{depth} after {last}");
            last = depth;
        }
        assert!(last < 0.05, "it does come near: {last}");
        assert_eq!(navigator.viewpoint.axes().forward, forward);
        navigator.wheel(-1.0);
        assert!(navigator.camera().to_camera(target).z > last, "and goes back");
        for notches in [f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, -20.0, -20.0, -20.0] {
            navigator.wheel(notches);
            navigator.camera().validate().unwrap();
        }
    }

    #[test]
    fn nothing_leads_to_where_numbers_end() {
        let mut navigator = navigator();
        navigator.switch_mode();
        for i in 0..4000 {
            navigator.wheel(20.0);
            navigator.advance(&Motion { way: Vec3::new(1.0, 0.3, 1.0), turn: Vec2::splat(0.01), haste: 4.0 }, 1e9);
            navigator.drag(Drag::Pan, Vec2::new(1e6, -1e6));
            if i % 7 == 0 {
                navigator.drag(Drag::Turn, Vec2::new(1e4, 1e4));
            }
        }
        navigator.camera().validate().unwrap();
        assert!(navigator.camera().position().distance(BULK.center) < 3.0 * FARTHEST * BULK.radius);
        navigator.reset();
        assert_eq!(navigator.viewpoint, navigator.home);
    }

    #[test]
    fn flying_goes_where_one_looks_and_orbiting_stays() {
        let forward = Motion { way: Vec3::Z, turn: Vec2::ZERO, haste: 1.0 };
        let mut orbiting = navigator();
        let before = orbiting.camera();
        orbiting.advance(&forward, 0.1);
        assert_eq!(orbiting.camera(), before, "only flight has a forward");
        let mut flying = navigator();
        flying.switch_mode();
        flying.advance(&forward, 0.1);
        let moved = flying.camera().position() - before.position();
        let expected = 0.1 * flying.speed * before.rotation.row(2);
        assert!(moved.distance(expected) < 1e-4, "{moved} {expected}");
        flying.advance(&Motion { haste: 4.0, way: -Vec3::Z, ..forward }, 0.1);
        let back = flying.camera().position() - before.position();
        assert!(back.distance(-3.0 * expected) < 1e-4, "{back}");
        flying.advance(&Motion { turn: Vec2::new(-1.0, 0.0), way: Vec3::ZERO, haste: 1.0 }, 0.1);
        let turned = flying.camera().rotation.row(2).dot(before.rotation.row(0));
        assert!(turned < -0.05, "to the left: {turned}");
        flying.switch_mode();
        let eye = flying.viewpoint.eye();
        assert!(flying.camera().position().distance(eye) < 1e-5, "a switch moves nothing: {eye}");
    }

    #[test]
    fn another_size_shows_all_that_was_there() {
        let mut navigator = navigator();
        let home = navigator.camera();
        let corner = |camera: &Camera| {
            (camera.center / camera.focal, {
                let size = Vec2::new(camera.width as f32, camera.height as f32);
                (size - camera.center) / camera.focal
            })
        };
        for (width, height) in [(160, 120), (200, 60), (31, 90), (1, 1), (0, 7)] {
            navigator.resize(width, height);
            let camera = navigator.camera();
            camera.validate().unwrap();
            assert_eq!(camera.focal.x, camera.focal.y);
            let ((a, b), (c, d)) = (corner(&home), corner(&camera));
            assert!((c - a).min_element() > -1e-5 && (d - b).min_element() > -1e-5, "{width}x{height}");
        }
    }
}
