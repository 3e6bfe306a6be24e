//! A program that shares its device with the rasterizer, which draws into a texture of the program.
//! The program then writes the texture to a file: `cargo run --example host_device -- drawn.png`.

#![allow(clippy::print_stdout)]

use std::{error::Error, fs::File, io::BufWriter, path::Path};

use glam::{Vec2, Vec3};
use gs_core::{Blend, Canvas, Gaussian2d, Parameterization, Rasterizer, RenderSettings, Scene2d};
use gs_wgpu::{WgpuRasterizer, WgpuSettings, wgpu};

const SIDE: u32 = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).unwrap_or_else(|| "drawn.png".into());
    pollster::block_on(draw(Path::new(&path)))?;
    println!("{}", Path::new(&path).display());
    Ok(())
}

async fn draw(path: &Path) -> Result<(), Box<dyn Error>> {
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
    let (view, settings) = (Canvas::new(SIDE, SIDE), RenderSettings::blended(Blend::Over).on([1.0; 3]));
    rasterizer.draw_to_texture(&splats, &view, &settings, &texture).await?;

    write(path, &pixels(&device, &queue, &texture)?)
}

/// Twelve Gaussians in a ring, each in front of the next.
fn ring() -> Scene2d {
    let gaussian = |i: u32| {
        let turn = i as f32 / 12.0;
        let direction = Vec2::from_angle(turn * std::f32::consts::TAU);
        Gaussian2d {
            mean: Vec2::splat(SIDE as f32 / 2.0) + 75.0 * direction,
            log_scale: Vec2::new(3.4, 2.4),
            rotation: turn * std::f32::consts::TAU,
            opacity_logit: 2.0,
            color: Vec3::new(turn, 0.4, 1.0 - turn),
        }
    };
    (0..12).map(gaussian).collect()
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
