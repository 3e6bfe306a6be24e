//! The state of a window, without the window: what input does, which frame is wanted next and when,
//! and what an answer changes. The caller passes the time.

use std::time::{Duration, Instant};

use glam::Vec2;
use gs_core::{RenderSettings, constants::MAX_SIDE_PX, effects::Effect};
use winit::keyboard::KeyCode;

use crate::{
    error::Error,
    keys::{Command, HeldKeys},
    navigation::{Drag, Navigate},
    pixels::Picture,
    renderer::{Answer, Request, View},
    resolution::{FrameTimes, MotionResolution},
};

/// Time from the last movement until the picture is rendered at full resolution.
const REST_AFTER: Duration = Duration::from_millis(150);

/// The least time between requests.
const SHORTEST_FRAME: Duration = Duration::from_millis(8);

/// Time between frames of the same view while finer levels of the scene are being read.
const FINER_AFTER: Duration = Duration::from_millis(33);

/// The time of motion before the first frame.
const FIRST_STEP: Duration = Duration::from_millis(16);

/// Notches of the wheel for a zoom key.
const KEY_NOTCHES: f32 = 2.0;

/// Whether the overlay is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Text {
    Shown,
    Hidden,
}

/// What the window has to do now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Next<V> {
    /// The request for the renderer.
    pub(crate) request: Option<Request<V>>,
    /// Time to call again, if nothing happens before.
    pub(crate) wake: Option<Instant>,
}

/// A value with nothing to do.
impl<V> Default for Next<V> {
    fn default() -> Self {
        Self { request: None, wake: None }
    }
}

/// The state of a window.
#[derive(Debug)]
pub(crate) struct Session<N: Navigate> {
    pub(crate) navigator: N,
    pub(crate) settings: RenderSettings,
    pub(crate) text: Text,
    /// The last error, for the overlay.
    pub(crate) notice: Option<String>,
    /// Times of frames of the shown kind.
    pub(crate) times: FrameTimes,
    /// Time of the last frame at full resolution, ms.
    pub(crate) full_ms: Option<f32>,
    /// Number of Gaussians of the scene in the last frame.
    pub(crate) gaussians: Option<usize>,
    /// When to draw the same view again, as finer levels of the scene are being read for it.
    pub(crate) again: Option<Instant>,
    /// The request whose frame is on the screen.
    shown: Option<Request<N::View>>,
    in_flight: Option<Request<N::View>>,
    /// Size of the window, px; `None` while it is hidden.
    size: Option<(u32, u32)>,
    motion: MotionResolution,
    keys: HeldKeys,
    pointer: Vec2,
    drag: Option<Drag>,
    moved: Option<Instant>,
    stepped: Option<Instant>,
    asked: Option<Instant>,
}

impl<N: Navigate> Session<N> {
    /// A session whose window has no size yet.
    pub(crate) fn new(navigator: N, settings: RenderSettings) -> Self {
        Self {
            navigator,
            settings,
            text: Text::Shown,
            notice: None,
            times: FrameTimes::default(),
            full_ms: None,
            gaussians: None,
            again: None,
            shown: None,
            in_flight: None,
            size: None,
            motion: MotionResolution::default(),
            keys: HeldKeys::default(),
            pointer: Vec2::ZERO,
            drag: None,
            moved: None,
            stepped: None,
            asked: None,
        }
    }

    /// The request whose frame is on the screen.
    pub(crate) fn shown(&self) -> Option<&Request<N::View>> {
        self.shown.as_ref()
    }

    /// Sets the size of the window, px; 0 if it is hidden.
    pub(crate) fn resize(&mut self, width: u32, height: u32) {
        self.size = (width > 0 && height > 0).then_some((width.min(MAX_SIDE_PX), height.min(MAX_SIDE_PX)));
        if let Some((width, height)) = self.size {
            self.navigator.resize(width, height);
        }
    }

    /// A button was pressed for this kind of drag. With the shift key it always pans.
    pub(crate) fn grab(&mut self, drag: Drag) {
        self.drag = Some(if self.keys.shift() { Drag::Pan } else { drag });
    }

    /// The button was released.
    pub(crate) fn let_go(&mut self) {
        self.drag = None;
    }

    /// The pointer has moved, px from the window's top-left corner.
    pub(crate) fn point(&mut self, place: Vec2, now: Instant) {
        let shift = place - std::mem::replace(&mut self.pointer, place);
        if let Some(drag) = self.drag.filter(|_| shift != Vec2::ZERO) {
            self.navigator.drag(drag, shift);
            self.moved = Some(now);
        }
    }

    /// The wheel was turned; away from the user if positive.
    pub(crate) fn wheel(&mut self, notches: f32, now: Instant) {
        self.navigator.zoom(notches, Some(self.pointer));
        self.moved = Some(now);
    }

    /// A key was pressed.
    pub(crate) fn press(&mut self, key: KeyCode) {
        self.keys.0.insert(key);
    }

    /// A key was released.
    pub(crate) fn release(&mut self, key: KeyCode) {
        self.keys.0.remove(&key);
    }

    /// The window gets no more keys and buttons.
    pub(crate) fn lose_focus(&mut self) {
        self.keys.0.clear();
        self.drag = None;
    }

    /// Carries out a command, except for [`Command::Close`], which is the window's.
    pub(crate) fn obey(&mut self, command: Command) {
        self.notice = None;
        let effects = &mut self.settings.effects;
        match command {
            Command::SwitchMode => self.navigator.switch_mode(),
            Command::Reset => self.navigator.reset(),
            Command::ZoomIn => self.navigator.zoom(KEY_NOTCHES, None),
            Command::ZoomOut => self.navigator.zoom(-KEY_NOTCHES, None),
            Command::Choose(effect, at) => *effects = effect.values(effects).get(at).copied().unwrap_or(*effects),
            Command::Next(effect) => {
                let values = effect.values(effects);
                let after = values.iter().skip_while(|value| *value != effects).nth(1);
                // In space, the order by index is none to choose.
                *effects = *after.unwrap_or(&values[usize::from(effect == Effect::Order)]);
            }
            Command::Text => {
                self.text = match self.text {
                    Text::Shown => Text::Hidden,
                    Text::Hidden => Text::Shown,
                }
            }
            Command::Close => {}
        }
    }

    /// Advances to `now` and returns what to do. A returned request counts as sent.
    pub(crate) fn next(&mut self, now: Instant) -> Next<N::View> {
        let motion = self.keys.motion(self.navigator.mode());
        if motion.is_none() {
            self.stepped = None;
        } else {
            let since = self.stepped.map_or(FIRST_STEP, |last| now.saturating_duration_since(last));
            self.navigator.advance(&motion, since.as_secs_f32());
            (self.stepped, self.moved) = (Some(now), Some(now));
        }
        // The answer to the request under way will wake the window.
        if self.size.is_none() || self.in_flight.is_some() {
            return Next::default();
        }
        let rest = self.moved.map(|moved| moved + REST_AFTER).filter(|rest| now < *rest);
        let divisor = if rest.is_some() { self.motion.divisor() } else { 1 };
        let request = Request { view: self.navigator.view(), settings: self.settings, divisor };
        let is_shown = |shown: &Request<N::View>| shown.divisor <= divisor && Request { divisor, ..*shown } == request;
        if self.shown.as_ref().is_some_and(is_shown) && self.again.is_none_or(|again| now < again) {
            let soonest = rest.into_iter().chain(self.again).min();
            let wake = if motion.is_none() { soonest } else { Some(now + SHORTEST_FRAME) };
            return Next { request: None, wake };
        }
        let earliest = self.asked.map(|asked| asked + SHORTEST_FRAME);
        if earliest.is_some_and(|earliest| now < earliest) {
            return Next { request: None, wake: earliest };
        }
        (self.in_flight, self.asked) = (Some(request), Some(now));
        Next { request: Some(request), wake: None }
    }

    /// Takes an answer of the renderer, and returns a new picture for the screen.
    ///
    /// If the backend does not offer an effect that was just switched on, it is switched off again,
    /// with a notice.
    ///
    /// # Errors
    /// Any other error of the backend.
    pub(crate) fn take(&mut self, answer: Answer<N::View>) -> Result<Option<Picture>, Error> {
        self.in_flight = None;
        let Answer { request, result } = answer;
        match (result, &self.shown) {
            (Ok(frame), shown) => {
                let milliseconds = frame.took.as_secs_f32() * 1e3;
                let kind = |request: &Request<N::View>| (request.size(), request.settings);
                if shown.as_ref().map(kind) != Some(kind(&request)) {
                    self.times.clear();
                }
                let cost = |request: &Request<N::View>| (request.view.size(), request.settings);
                if shown.as_ref().map(cost) != Some(cost(&request)) {
                    self.motion.clear();
                    self.full_ms = None;
                }
                self.times.add(milliseconds);
                self.motion.add(request.divisor, milliseconds);
                if request.divisor == 1 {
                    self.full_ms = Some(milliseconds);
                }
                self.gaussians = Some(frame.gaussians);
                self.again = self.asked.filter(|_| frame.is_coarse).map(|asked| asked + frame.took + FINER_AFTER);
                self.shown = Some(request);
                Ok(Some(frame.picture))
            }
            (Err(Error::Backend(error)), Some(shown))
                if shown.settings != request.settings && !matches!(error, gs_core::Error::Backend { .. }) =>
            {
                self.settings = shown.settings;
                self.notice = Some(error.to_string());
                Ok(None)
            }
            (Err(error), _) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use gs_core::view::Bulk;
    use gs_core::{Blend, Camera, Image, effects::Order};

    use super::*;
    use crate::{
        navigation::{CameraNavigator, CanvasNavigator},
        renderer::Frame,
    };

    fn session() -> Session<CameraNavigator> {
        let bulk = Bulk { center: Vec3::ZERO, radius: 1.0 };
        let camera = bulk.overview(80, 60, 0.9, Vec3::NEG_Y).unwrap();
        let mut settings = RenderSettings::blended(Blend::Over);
        settings.effects.order = Order::Global;
        Session::new(CameraNavigator::new(&camera, camera.position().length(), Vec3::NEG_Y, bulk), settings)
    }

    fn answer(request: Request<Camera>, milliseconds: u64) -> Answer<Camera> {
        let image = Image::filled(request.size().0, request.size().1, [0.5; 3]).unwrap();
        let took = Duration::from_millis(milliseconds);
        Answer { request, result: Ok(Frame { picture: Picture::of(&image), took, gaussians: 1, is_coarse: false }) }
    }

    /// A session that shows its first frame, which took so long; and the clock.
    fn showing(milliseconds: u64) -> (Session<CameraNavigator>, Instant) {
        let mut session = session();
        session.resize(80, 60);
        let now = Instant::now();
        let request = session.next(now).request.unwrap();
        assert_eq!((request.divisor, request.size()), (1, (80, 60)));
        assert_eq!(session.next(now), Next::default(), "one at a time");
        assert!(session.take(answer(request, milliseconds)).unwrap().is_some());
        (session, now + Duration::from_secs(1))
    }

    #[test]
    fn frames_need_a_size_and_a_change() {
        let now = Instant::now();
        assert_eq!(session().next(now), Next::default());
        let (mut session, now) = showing(5);
        assert_eq!(session.next(now), Next::default());
        session.resize(0, 60);
        assert_eq!(session.next(now), Next::default());
        session.resize(90, 60);
        assert_eq!(session.next(now).request.unwrap().size(), (90, 60));
    }

    #[test]
    fn slow_frames_are_coarse_in_motion_and_full_at_rest() {
        let (mut session, now) = showing(400);
        session.grab(Drag::Turn);
        session.point(Vec2::new(5.0, 0.0), now);
        let coarse = session.next(now).request.unwrap();
        assert!(coarse.divisor > 1, "{}", coarse.divisor);
        session.take(answer(coarse, 30)).unwrap();
        let then = now + Duration::from_millis(40);
        assert_eq!(session.next(then), Next { request: None, wake: Some(now + REST_AFTER) });
        let whole = session.next(now + REST_AFTER).request.unwrap();
        assert_eq!(whole, Request { divisor: 1, ..coarse });
        session.take(answer(whole, 410)).unwrap();
        assert_eq!(session.full_ms, Some(410.0));
        assert_eq!(session.next(now + 2 * REST_AFTER), Next::default());
        // A wheel event without effect does not make the frame coarse again.
        session.wheel(0.0, now + 3 * REST_AFTER);
        assert_eq!(session.next(now + 3 * REST_AFTER).request, None);
    }

    #[test]
    fn fast_frames_stay_full_and_are_not_requested_too_often() {
        let (mut session, now) = showing(5);
        session.grab(Drag::Pan);
        session.point(Vec2::new(5.0, 0.0), now);
        let request = session.next(now).request.unwrap();
        assert_eq!(request.divisor, 1);
        session.take(answer(request, 2)).unwrap();
        let soon = now + Duration::from_millis(2);
        session.point(Vec2::new(9.0, 0.0), soon);
        assert_eq!(session.next(soon), Next { request: None, wake: Some(now + SHORTEST_FRAME) });
        assert!(session.next(now + SHORTEST_FRAME).request.is_some());
        session.let_go();
        let before = session.navigator.view();
        session.point(Vec2::new(50.0, 50.0), soon);
        assert_eq!(session.navigator.view(), before, "nothing is held");
    }

    #[test]
    fn a_view_is_drawn_again_until_its_finest_levels_are_there() {
        let (mut session, now) = showing(5);
        session.grab(Drag::Turn);
        session.point(Vec2::new(5.0, 0.0), now);
        let coarse = |request| {
            let Answer { request, result } = answer(request, 5);
            Answer { request, result: result.map(|frame| Frame { is_coarse: true, ..frame }) }
        };
        let request = session.next(now).request.unwrap();
        session.take(coarse(request)).unwrap();
        let again = now + Duration::from_millis(5) + FINER_AFTER;
        assert_eq!(session.next(now + FINER_AFTER / 2).wake, Some(again));
        assert_eq!(session.next(again).request, Some(request));
        session.take(answer(request, 5)).unwrap();
        assert_eq!(session.next(now + REST_AFTER + FINER_AFTER), Next::default());
    }

    #[test]
    fn held_keys_move_until_the_focus_is_lost() {
        let (mut session, mut now) = showing(5);
        session.obey(Command::SwitchMode);
        session.press(KeyCode::KeyW);
        let mut last = session.navigator.view().position();
        for _ in 0..3 {
            let request = session.next(now).request.unwrap();
            assert!(request.view.position().distance(last) > 1e-3);
            last = request.view.position();
            session.take(answer(request, 5)).unwrap();
            now += Duration::from_millis(20);
        }
        session.lose_focus();
        now += REST_AFTER;
        assert_eq!(session.next(now), Next::default());
    }

    #[test]
    fn an_unsupported_effect_is_switched_off_again_with_a_notice() {
        let (mut session, now) = showing(5);
        session.obey(Command::Next(Effect::Order));
        let request = session.next(now).request.unwrap();
        assert_eq!(request.settings.effects.order, Order::PerPixel);
        let refused = || gs_core::Error::Unsupported { backend: "wgpu", effect: "Order::PerPixel".to_owned() };
        let answer = Answer { request, result: Err(refused().into()) };
        assert!(session.take(answer).unwrap().is_none());
        assert_eq!(session.settings.effects.order, Order::Global);
        assert!(session.notice.as_ref().is_some_and(|notice| notice.contains("PerPixel")));
        assert_eq!(session.next(now + REST_AFTER), Next::default(), "what is shown is what is wanted");
        session.obey(Command::Text);
        assert_eq!((session.notice.is_none(), session.text), (true, Text::Hidden));
        // The same error for settings that were shown before is fatal, as is a lost device.
        session.obey(Command::Reset);
        let request = Request { settings: session.settings, ..request };
        assert!(session.take(Answer { request, result: Err(refused().into()) }).is_err());
        session.obey(Command::Next(Effect::Antialias));
        let request = Request { settings: session.settings, ..request };
        let lost = gs_core::Error::Backend { backend: "wgpu", message: "the device is lost".to_owned() };
        assert!(session.take(Answer { request, result: Err(lost.into()) }).is_err());
    }

    #[test]
    fn a_2d_scene_is_rendered_anew_at_each_zoom_and_place() {
        let mut session = Session::new(CanvasNavigator::new(30, 20), RenderSettings::blended(Blend::Sum));
        session.resize(60, 40);
        let mut now = Instant::now();
        let mut next = |session: &mut Session<CanvasNavigator>| {
            now += REST_AFTER;
            let request = session.next(now).request?;
            let image = Image::filled(request.size().0, request.size().1, [0.5; 3]).unwrap();
            let result = Ok(Frame {
                picture: Picture::of(&image),
                took: Duration::from_millis(5),
                gaussians: 1,
                is_coarse: false,
            });
            session.take(Answer { request, result }).unwrap();
            Some(request.view)
        };
        let whole = next(&mut session).unwrap();
        assert_eq!(
            (whole.width, whole.height, whole.origin, whole.extent),
            (60, 40, Vec2::ZERO, Vec2::new(30.0, 20.0))
        );
        assert_eq!(next(&mut session), None, "nothing has changed");
        session.obey(Command::ZoomIn);
        let nearer = next(&mut session).unwrap();
        assert!(
            nearer.extent.x < whole.extent.x
                && (nearer.origin + 0.5 * nearer.extent).abs_diff_eq(Vec2::new(15.0, 10.0), 1e-4)
        );
        session.point(Vec2::new(30.0, 20.0), Instant::now());
        session.grab(Drag::Turn);
        session.point(Vec2::new(20.0, 20.0), Instant::now());
        let dragged = next(&mut session).unwrap();
        assert!(dragged.origin.x > nearer.origin.x && dragged.extent == nearer.extent);
        session.wheel(-2.0, Instant::now());
        assert!(next(&mut session).unwrap().extent.x > dragged.extent.x);
        session.obey(Command::Reset);
        assert_eq!(next(&mut session), Some(whole));
        session.press(KeyCode::ArrowRight);
        assert!(next(&mut session).unwrap().origin.x > whole.origin.x);
    }
}
