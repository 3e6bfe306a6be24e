//! A window that shows a scene file, and turns it when the pointer moves:
//! `cargo run --release -p gs-backend --example window -- scene.ply`. With a number after the file, it closes after as
//! many pictures. The pictures stay on the GPU: the rasterizer draws into the textures of the window.

use std::{error::Error, sync::Arc};

use glam::{Quat, Vec3};
use gs_core::{Camera, Parameterization, Rasterizer, view::Bulk};
use gs_wgpu::{WgpuRasterizer, WgpuSettings, wgpu};
use pollster::block_on;
use winit::{
    application::ApplicationHandler,
    event::WindowEvent,
    event_loop::{ActiveEventLoop, EventLoop},
    window::{Window, WindowId},
};

fn main() -> Result<(), Box<dyn Error>> {
    let file = gs_io::read_3d(std::env::args_os().nth(1).ok_or("usage: window SCENE [FRAMES]")?)?;
    let center = Bulk::of(&file.scene).ok_or("the scene has no Gaussian with a finite mean")?.center;
    let frames = std::env::args().nth(2).map(|count| count.parse()).transpose()?;
    let mut app = App { file, center, turn: 0.0, frames, draw: None, failed: None };
    EventLoop::new()?.run_app(&mut app)?;
    app.failed.map_or(Ok(()), Err)
}

/// What draws the scene, seen from a side, once there is a window.
type Draw = Box<dyn FnMut(f32) -> Result<(), Box<dyn Error>>>;

struct App {
    file: gs_io::File3d,
    center: Vec3,
    /// Angle by which the scene is turned, rad.
    turn: f32,
    /// Pictures that are left to draw, if they are counted.
    frames: Option<usize>,
    draw: Option<(Arc<Window>, Draw)>,
    failed: Option<Box<dyn Error>>,
}

impl App {
    fn open(&self, events: &ActiveEventLoop) -> Result<(Arc<Window>, Draw), Box<dyn Error>> {
        let window = Arc::new(events.create_window(Window::default_attributes().with_title("A scene"))?);
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let surface = instance.create_surface(window.clone())?;
        let options = wgpu::RequestAdapterOptions { compatible_surface: Some(&surface), ..Default::default() };
        let adapter = block_on(instance.request_adapter(&options))?;
        let (device, queue) = block_on(adapter.request_device(&Default::default()))?;
        let rasterizer = WgpuRasterizer::from_device(device.clone(), queue.clone(), WgpuSettings::default())?;
        let splats = rasterizer.upload(&self.file.scene, Parameterization::ScaleRotation)?;
        let (bulk, settings) = (Bulk::of(&self.file.scene), self.file.render_settings(None));
        let (shown, center) = (window.clone(), self.center);
        let draw = move |turn: f32| {
            let size = shown.inner_size();
            let config = surface.get_default_config(&adapter, size.width.max(1), size.height.max(1));
            let config = config.ok_or("the adapter can't draw into this window")?;
            surface.configure(&device, &config);
            let home =
                bulk.and_then(|bulk| bulk.overview(config.width, config.height, Bulk::FIELD_OF_VIEW, Vec3::NEG_Y));
            let turned = |home: Camera| {
                let position = center + Quat::from_rotation_y(turn) * (home.position() - center);
                home.looking_at(position, center, Vec3::NEG_Y)
            };
            let camera = home.and_then(turned).ok_or("there is no camera")?;
            use wgpu::CurrentSurfaceTexture::{Suboptimal, Success};
            let (Success(target) | Suboptimal(target)) = surface.get_current_texture() else { return Ok(()) };
            block_on(rasterizer.draw_to_texture(&splats, &camera, &settings, &target.texture))?;
            queue.present(target);
            Ok(())
        };
        Ok((window, Box::new(draw)))
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        match self.open(events) {
            Ok(opened) => self.draw = Some(opened),
            Err(error) => {
                self.failed = Some(error);
                events.exit();
            }
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some((window, draw)) = &mut self.draw else { return };
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(_) => window.request_redraw(),
            WindowEvent::CursorMoved { position, .. } => {
                self.turn = position.x as f32 / 200.0;
                window.request_redraw();
            }
            WindowEvent::RedrawRequested => {
                if let Err(error) = draw(self.turn) {
                    self.failed = Some(error);
                    return events.exit();
                }
                if let Some(left) = &mut self.frames {
                    *left = left.saturating_sub(1);
                    if *left == 0 { events.exit() } else { window.request_redraw() }
                }
            }
            _ => {}
        }
    }
}
