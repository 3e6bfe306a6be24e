//! A program with a device of its own, on which the rasterizer draws a 3D scene into a texture of the program.
//! The program then draws the edges of a box over it, with the same camera, and nothing has left the device.
//! To be looked at, the texture is written to a file: `cargo run --example host_device -- drawn.png`.

#![allow(clippy::print_stdout)]

use std::{error::Error, fs::File, io::BufWriter, path::Path};

use glam::{Quat, Vec2, Vec3};
use gs_core::{
    Blend, Camera, Gaussian3d, Parameterization, Rasterizer, RenderSettings, Scene3d, constants::SH_C0, effects::Order,
};
use gs_wgpu::{WgpuRasterizer, WgpuSettings, wgpu};

/// Columns and rows of the picture, px.
const SIDE: u32 = 256;

/// Half the length of the box's edges, world units.
const HALF: f32 = 1.2;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).unwrap_or_else(|| "drawn.png".into());
    let path = Path::new(&path);
    write(path, &pollster::block_on(draw())?)?;
    println!("{}", path.display());
    Ok(())
}

/// Draws scene and box, and returns the pixels: RGBA, row by row.
pub(crate) async fn draw() -> Result<Vec<u8>, Box<dyn Error>> {
    // A program with a window already has these.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default()).await?;
    let (device, queue) = adapter.request_device(&wgpu::DeviceDescriptor::default()).await?;
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("the program's own"),
        size: wgpu::Extent3d { width: SIDE, height: SIDE, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8UnormSrgb,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });

    let rasterizer = WgpuRasterizer::from_device(device.clone(), queue.clone(), WgpuSettings::default())?;
    let splats = rasterizer.upload(&ring(), Parameterization::ScaleRotation)?;
    rasterizer.draw_to_texture(&splats, &camera(), &settings(), &texture).await?;
    draw_box(&device, &queue, &texture);
    pixels(&device, &queue, &texture)
}

/// A camera above and in front of the origin; y points down.
pub(crate) fn camera() -> Camera {
    let lens = Camera::looking_forward(SIDE, SIDE, 0.9);
    lens.looking_at(Vec3::new(1.4, -2.0, -4.8), Vec3::ZERO, Vec3::NEG_Y).expect("it does not look straight down")
}

/// On white, in the order of depth. A scene of a file says how it is drawn: `gs_io::File3d::render_settings`.
pub(crate) fn settings() -> RenderSettings {
    let mut settings = RenderSettings::blended(Blend::Over).on([1.0; 3]);
    settings.effects.order = Order::Global;
    settings
}

/// Twelve Gaussians in a ring.
pub(crate) fn ring() -> Scene3d {
    let gaussian = |i: u16| {
        let turn = f32::from(i) / 12.0;
        let direction = Vec2::from_angle(turn * std::f32::consts::TAU);
        let [x, y, z, w] = Quat::from_rotation_y(-turn * std::f32::consts::TAU).to_array();
        Gaussian3d {
            mean: Vec3::new(direction.x, 0.0, direction.y),
            log_scale: Vec3::new(-2.0, -1.3, -1.3),
            rotation: [w, x, y, z],
            opacity_logit: 2.0,
            sh: vec![(Vec3::new(turn, 0.4, 1.0 - turn) - 0.5) / SH_C0],
        }
    };
    (0..12).map(gaussian).collect()
}

/// The ends of the box's edges, world units.
pub(crate) fn edges() -> Vec<[Vec3; 2]> {
    let corner = |k: usize| Vec3::from_array(std::array::from_fn(|axis| if k >> axis & 1 == 1 { HALF } else { -HALF }));
    let edges_of = |k: usize| (0..3).filter(move |axis| k >> axis & 1 == 0).map(move |axis| [k, k | 1 << axis]);
    (0..8).flat_map(edges_of).map(|ends| ends.map(corner)).collect()
}

/// Clip coordinates of a point, as GPUs take them: x right, y up, depth 0 to 1 times w.
fn clip(camera: &Camera, point: Vec3) -> [f32; 4] {
    let seen = camera.to_camera(point);
    let pixel = (camera.focal * seen.truncate() + camera.center * seen.z) / SIDE as f32;
    [2.0 * pixel.x - seen.z, seen.z - 2.0 * pixel.y, 0.5 * seen.z, seen.z]
}

/// Draws the box over what is in the texture.
fn draw_box(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) {
    let camera = camera();
    let points: Vec<[f32; 4]> = edges().as_flattened().iter().map(|&point| clip(&camera, point)).collect();
    let bytes: Vec<u8> = points.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    let vertices = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes.len() as u64,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    queue.write_buffer(&vertices, 0, &bytes);
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(
            "@vertex fn place(@location(0) clip: vec4f) -> @builtin(position) vec4f { return clip; }
             @fragment fn color() -> @location(0) vec4f { return vec4f(0.0, 0.0, 0.0, 1.0); }"
                .into(),
        ),
    });
    let attributes = wgpu::vertex_attr_array![0 => Float32x4];
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: 16,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &attributes,
            })],
        },
        primitive: wgpu::PrimitiveState { topology: wgpu::PrimitiveTopology::LineList, ..Default::default() },
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            targets: &[Some(texture.format().into())],
        }),
        multiview_mask: None,
        cache: None,
    });
    let view = texture.create_view(&Default::default());
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            // What the rasterizer has drawn stays.
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    });
    pass.set_pipeline(&pipeline);
    pass.set_vertex_buffer(0, vertices.slice(..));
    pass.draw(0..points.len() as u32, 0..1);
    drop(pass);
    queue.submit([encoder.finish()]);
}

/// Reads the texture's pixels, row by row. A program that shows the texture does not need this.
fn pixels(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Result<Vec<u8>, Box<dyn Error>> {
    let size = texture.size();
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(4 * size.width * size.height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    // Rows of 1024 bytes, a multiple of the 256 that copies need.
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size.width), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        size,
    );
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| {});
    device.poll(wgpu::PollType::wait_indefinitely())?;
    Ok(buffer.get_mapped_range(..)?.to_vec())
}

fn write(path: &Path, rgba: &[u8]) -> Result<(), Box<dyn Error>> {
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(path)?), SIDE, SIDE);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(rgba)?;
    Ok(())
}
