//! The window: events in, pixels out. The session decides what they mean.

use std::{
    fmt::Display,
    num::NonZero,
    sync::{
        Arc,
        mpsc::{self, Sender},
    },
    thread,
    time::Instant,
};

use glam::Vec2;
use gs_backend::AnyRasterizer;
use gs_core::{Rasterizer, Scene};
use gs_io::IccProfile;
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
    error::Error,
    keys::{Command, command},
    levels::Finer,
    navigation::{Drag, Navigate},
    overlay::{self, Subject},
    pixels::{Picture, Screen},
    renderer::{Answer, Renderer, Request, View},
    session::{Session, Text},
    text::Writer,
};

/// The distance on a touchpad that counts as a notch of a wheel, px at the usual density.
const NOTCH_PX: f64 = 40.0;

/// Shows a scene until the window is closed or something fails.
///
/// # Errors
/// Where there is no display, the window cannot be opened or drawn to, or the backend fails.
pub(crate) fn show<S, N>(
    rasterizer: &AnyRasterizer,
    (scene, profile, finer): (&S, Option<&IccProfile>, Option<Finer<S>>),
    subject: Subject,
    session: Session<N>,
    size: (u32, u32),
) -> Result<(), Error>
where
    S: Scene<View: View>,
    N: Navigate<View = S::View>,
    AnyRasterizer: Rasterizer<S>,
{
    // winit's error says only where in its own source it was raised.
    let events = EventLoop::with_user_event().build().map_err(|_| Error::NoDisplay)?;
    let context = Context::new(events.owned_display_handle()).map_err(unusable)?;
    let (requests, received) = mpsc::channel();
    let proxy = events.create_proxy();
    let answer = move |answer| proxy.send_event(answer).is_ok();
    let renderer = Renderer { scene, finer, profile, requests: received, answer };
    let writer = Writer::new(1.0);
    thread::scope(|scope| {
        scope.spawn(move || renderer.run(rasterizer));
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
            error: None,
        };
        let ended = events.run_app(&mut viewer);
        // The renderer ends when the viewer is dropped, after the frame under way.
        viewer.error.map_or(Ok(()), Err)?;
        ended.map_err(|error| failed("the window", error))
    })
}

fn failed(what: &'static str, error: impl Display) -> Error {
    Error::Window { what, message: error.to_string() }
}

fn unusable(error: SoftBufferError) -> Error {
    failed("the window cannot be drawn to", error)
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
    /// Columns and rows at first, px.
    size: (u32, u32),
    requests: Sender<Request<N::View>>,
    canvas: Option<Canvas>,
    picture: Option<Picture>,
    title: String,
    error: Option<Error>,
}

impl<N: Navigate> Viewer<N> {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<(), Error> {
        let attributes = Window::default_attributes()
            .with_title(overlay::title(&self.subject, &self.session))
            .with_inner_size(PhysicalSize::new(self.size.0, self.size.1));
        let window = events.create_window(attributes).map_err(|error| failed("the window cannot be opened", error))?;
        let window = Arc::new(window);
        let surface = Surface::new(&self.context, window.clone()).map_err(unusable)?;
        self.writer = Writer::new(window.scale_factor());
        let size = window.inner_size();
        self.canvas = Some(Canvas { window, surface });
        self.resize(size)
    }

    fn resize(&mut self, size: PhysicalSize<u32>) -> Result<(), Error> {
        self.session.resize(size.width, size.height);
        let sides = (NonZero::new(size.width), NonZero::new(size.height));
        if let (Some(canvas), (Some(width), Some(height))) = (&mut self.canvas, sides) {
            canvas.surface.resize(width, height).map_err(unusable)?;
            canvas.window.request_redraw();
        }
        Ok(())
    }

    fn draw(&mut self) -> Result<(), Error> {
        let Some(Canvas { window, surface }) = &mut self.canvas else { return Ok(()) };
        let size = window.inner_size();
        let (width, height) = (size.width as usize, size.height as usize);
        if width == 0 || height == 0 {
            return Ok(());
        }
        let mut buffer = surface.buffer_mut().map_err(unusable)?;
        // The window is changing its size. An event with the new size will follow, and draw again.
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
        buffer.present().map_err(unusable)
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

    fn handle(&mut self, event: WindowEvent, events: &ActiveEventLoop) -> Result<(), Error> {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(size) => self.resize(size)?,
            WindowEvent::ScaleFactorChanged { scale_factor, .. } => self.writer = Writer::new(scale_factor),
            WindowEvent::RedrawRequested => self.draw()?,
            WindowEvent::Focused(false) => self.session.lose_focus(),
            // Keys pressed before the window had the focus were meant for another window.
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

    /// Ends on an error.
    fn exit_on_error(&mut self, result: Result<(), Error>, events: &ActiveEventLoop) {
        if let Err(error) = result {
            self.error.get_or_insert(error);
            events.exit();
        }
    }
}

impl<N: Navigate> ApplicationHandler<Answer<N::View>> for Viewer<N> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.canvas.is_none() {
            let opened = self.open(events);
            self.exit_on_error(opened, events);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let handled = self.handle(event, events);
        self.exit_on_error(handled, events);
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
            Err(error) => self.exit_on_error(Err(error), events),
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let next = self.session.next(Instant::now());
        if let Some(request) = next.request {
            // If the renderer has ended, its last answer says why.
            let _gone = self.requests.send(request);
        }
        events.set_control_flow(next.wake.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // The window must be dropped before its connection to the display.
        self.canvas = None;
    }
}
