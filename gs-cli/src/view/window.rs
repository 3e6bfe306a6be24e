//! The window: events in, pixels out. What they mean is the session's.

use std::{
    num::NonZero,
    sync::{
        Arc,
        mpsc::{self, Sender},
    },
    thread,
    time::Instant,
};

use glam::Vec2;
use gs_core::{Scene, Scene2d, Scene3d};
use softbuffer::{Context, SoftBufferError, Surface};
use winit::{
    application::ApplicationHandler,
    dpi::{PhysicalPosition, PhysicalSize},
    event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, EventLoop, OwnedDisplayHandle},
    keyboard::PhysicalKey,
    window::{Window, WindowId},
};

use crate::{
    backend::Backend,
    failure::Failure,
    values::Size,
    view::{
        keys::{Command, command},
        navigation::{Drag, Navigate, Navigator, PlaneNavigator},
        overlay::{self, Subject},
        painter::{Answer, Painter, Request, View},
        pixels::{Picture, Screen},
        session::{Session, Text},
        text::Writer,
    },
};

/// How far touchpads scroll for what is a notch of a wheel, px at the usual density.
const NOTCH_PX: f64 = 40.0;

/// What to do where there is no display.
const WITHOUT: &str = "without a display, gs render SCENE -o turn.apng --orbit 60 shows a scene all the way round";

/// A connection to the display.
pub(crate) struct Desktop<V: 'static> {
    events: EventLoop<Answer<V>>,
}

/// A kind of scene that a window shows.
pub(crate) trait Viewed: Scene<View: View> {
    /// How one moves through it.
    type Navigator: Navigate<View = Self::View>;

    /// Draws what is asked for on a backend.
    fn paint<A: Fn(Answer<Self::View>) -> bool>(backend: &Backend, painter: Painter<'_, Self, A>);
}

impl Viewed for Scene3d {
    type Navigator = Navigator;

    fn paint<A: Fn(Answer<Self::View>) -> bool>(backend: &Backend, painter: Painter<'_, Self, A>) {
        backend.run_3d(painter);
    }
}

impl Viewed for Scene2d {
    type Navigator = PlaneNavigator;

    fn paint<A: Fn(Answer<Self::View>) -> bool>(backend: &Backend, painter: Painter<'_, Self, A>) {
        backend.run(painter);
    }
}

impl<V: View> Desktop<V> {
    /// Connects, once what is to be shown is known to be all right, and before a backend is started.
    ///
    /// # Errors
    /// Where there is no display.
    pub(crate) fn connect() -> Result<Self, Failure> {
        // What winit says is where in its own source it gave up.
        let events = EventLoop::with_user_event().build().map_err(|_| {
            let what = "gs view has no display to open its window on, or it cannot be reached";
            Failure::failed(what).mend(WITHOUT)
        })?;
        Ok(Self { events })
    }

    /// Shows the scene until the window is closed.
    ///
    /// # Errors
    /// Where the window cannot be opened or drawn to, or the backend fails.
    pub(crate) fn show<S: Viewed<View = V>>(
        self,
        backend: &Backend,
        scene: &S,
        subject: Subject,
        session: Session<S::Navigator>,
        size: Size,
    ) -> Result<(), Failure> {
        let context = Context::new(self.events.owned_display_handle()).map_err(|error| unusable(&error))?;
        let (requests, received) = mpsc::channel();
        let proxy = self.events.create_proxy();
        let painter = Painter { scene, requests: received, answer: move |answer| proxy.send_event(answer).is_ok() };
        let writer = Writer::new(1.0)?;
        thread::scope(|scope| {
            scope.spawn(move || S::paint(backend, painter));
            let mut viewer = Viewer {
                writer,
                context,
                subject,
                session,
                size,
                requests,
                canvas: None,
                picture: None,
                title: String::new(),
                failure: None,
            };
            let ended = self.events.run_app(&mut viewer);
            // The window has gone; the painter goes with the viewer, after the frame that it draws.
            viewer.failure.map_or(Ok(()), Err)?;
            ended.map_err(|error| Failure::failed(error).at("the window").mend(WITHOUT))
        })
    }
}

fn unusable(error: &SoftBufferError) -> Failure {
    Failure::failed(error).at("the window cannot be drawn to").mend(WITHOUT)
}

/// The open window.
struct Canvas {
    window: Arc<Window>,
    surface: Surface<OwnedDisplayHandle, Arc<Window>>,
}

struct Viewer<N: Navigate> {
    context: Context<OwnedDisplayHandle>,
    writer: Writer,
    subject: Subject,
    session: Session<N>,
    /// Of the picture in the beginning.
    size: Size,
    requests: Sender<Request<N::View>>,
    canvas: Option<Canvas>,
    picture: Option<Picture>,
    title: String,
    failure: Option<Failure>,
}

impl<N: Navigate> Viewer<N> {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<(), Failure> {
        let attributes = Window::default_attributes()
            .with_title(overlay::title(&self.subject, &self.session))
            .with_inner_size(PhysicalSize::new(self.size.width, self.size.height));
        let window = events
            .create_window(attributes)
            .map_err(|error| Failure::failed(error).at("the window cannot be opened").mend(WITHOUT))?;
        let window = Arc::new(window);
        let surface = Surface::new(&self.context, window.clone()).map_err(|error| unusable(&error))?;
        self.writer = Writer::new(window.scale_factor())?;
        let size = window.inner_size();
        self.canvas = Some(Canvas { window, surface });
        self.resize(size)
    }

    fn resize(&mut self, size: PhysicalSize<u32>) -> Result<(), Failure> {
        self.session.resize(size.width, size.height);
        let sides = (NonZero::new(size.width), NonZero::new(size.height));
        if let (Some(canvas), (Some(width), Some(height))) = (&mut self.canvas, sides) {
            canvas.surface.resize(width, height).map_err(|error| unusable(&error))?;
            canvas.window.request_redraw();
        }
        Ok(())
    }

    fn draw(&mut self) -> Result<(), Failure> {
        let Some(Canvas { window, surface }) = &mut self.canvas else { return Ok(()) };
        let size = window.inner_size();
        let (width, height) = (size.width as usize, size.height as usize);
        if width == 0 || height == 0 {
            return Ok(());
        }
        let mut buffer = surface.buffer_mut().map_err(|error| unusable(&error))?;
        // Of a window that changes its size right now; its next size is on its way, and draws again.
        if buffer.len() != width * height {
            return Ok(());
        }
        let mut screen = Screen { width, height, pixels: &mut buffer };
        match &self.picture {
            Some(picture) => picture.show(&mut screen),
            None => screen.pixels.fill(0),
        }
        if self.session.text == Text::Shown {
            self.writer.write(&overlay::lines(&self.subject, &self.session), &mut screen);
        }
        window.pre_present_notify();
        buffer.present().map_err(|error| unusable(&error))
    }

    fn redraw(&self) {
        if let Some(canvas) = &self.canvas {
            canvas.window.request_redraw();
        }
    }

    fn key(&mut self, event: &KeyEvent, events: &ActiveEventLoop) {
        if let PhysicalKey::Code(code) = event.physical_key {
            match event.state {
                ElementState::Pressed => self.session.press(code),
                ElementState::Released => self.session.release(code),
            }
        }
        if event.state == ElementState::Released || event.repeat {
            return;
        }
        match command(&event.logical_key, self.session.navigator.mode()) {
            Some(Command::Close) => events.exit(),
            Some(command) => {
                self.session.obey(command);
                self.redraw();
            }
            None => {}
        }
    }

    fn hear(&mut self, event: WindowEvent, events: &ActiveEventLoop) -> Result<(), Failure> {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(size) => self.resize(size)?,
            WindowEvent::ScaleFactorChanged { scale_factor, .. } => self.writer = Writer::new(scale_factor)?,
            WindowEvent::RedrawRequested => self.draw()?,
            WindowEvent::Focused(false) => self.session.lose_focus(),
            // What was pressed before the window had the focus was meant for another.
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => self.key(&event, events),
            WindowEvent::CursorMoved { position: PhysicalPosition { x, y }, .. } => {
                self.session.point(Vec2::new(x as f32, y as f32), Instant::now());
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. } => match button {
                MouseButton::Left => self.session.grab(Drag::Turn),
                MouseButton::Right | MouseButton::Middle => self.session.grab(Drag::Pan),
                _ => {}
            },
            WindowEvent::MouseInput { state: ElementState::Released, .. } => self.session.let_go(),
            WindowEvent::MouseWheel { delta, .. } => {
                let density = self.canvas.as_ref().map_or(1.0, |canvas| canvas.window.scale_factor());
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => lines,
                    MouseScrollDelta::PixelDelta(shift) => (shift.y / (NOTCH_PX * density)) as f32,
                };
                self.session.wheel(notches, Instant::now());
                self.redraw();
            }
            _ => {}
        }
        Ok(())
    }

    /// Ends where something failed.
    fn settle(&mut self, result: Result<(), Failure>, events: &ActiveEventLoop) {
        if let Err(failure) = result {
            self.failure.get_or_insert(failure);
            events.exit();
        }
    }
}

impl<N: Navigate> ApplicationHandler<Answer<N::View>> for Viewer<N> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.canvas.is_none() {
            let opened = self.open(events);
            self.settle(opened, events);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let heard = self.hear(event, events);
        self.settle(heard, events);
    }

    fn user_event(&mut self, events: &ActiveEventLoop, answer: Answer<N::View>) {
        match self.session.take(answer) {
            Ok(picture) => {
                self.picture = picture.or(self.picture.take());
                let title = overlay::title(&self.subject, &self.session);
                if let Some(canvas) = self.canvas.as_ref().filter(|_| title != self.title) {
                    canvas.window.set_title(&title);
                    self.title = title;
                }
                self.redraw();
            }
            Err(failure) => self.settle(Err(failure), events),
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let next = self.session.next(Instant::now());
        if let Some(request) = next.request {
            // If the painter has gone, its last answer says why.
            let _gone = self.requests.send(request);
        }
        events.set_control_flow(next.wake.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // Windows go before the connection they were opened on.
        self.canvas = None;
    }
}
