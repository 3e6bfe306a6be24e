//! Drawing into a texture of the host program. The image is copied from its buffer to the texture
//! on the device.

use std::sync::PoisonError;

use gs_core::{Culled, Error, RenderSettings};

use crate::{
    WgpuRasterizer,
    dispatch::Commands,
    fault::backend_error,
    gpu::{Gpu, UNIFORM},
    kind::Kind,
    layout::Shown,
    splats::Splats,
    workspace::Workspace,
};

impl WgpuRasterizer {
    /// Draws splats into a texture of this rasterizer's device, and counts the culled Gaussians.
    ///
    /// Use it with [`WgpuRasterizer::from_device`]. The pixels stay on the device; the host only
    /// reads the lengths of the tiles' lists.
    ///
    /// The texture must have the view's size, one sample, a renderable colour format, and
    /// [`TextureUsages::RENDER_ATTACHMENT`](wgpu::TextureUsages::RENDER_ATTACHMENT). Its first mip
    /// level and layer become opaque, with colours clamped to 0..=1. Colours of an image are
    /// encoded as in sRGB. They are decoded for formats with an sRGB encoding of their own, so that
    /// both kinds of formats look the same.
    ///
    /// # Errors
    /// Those of [`Rasterizer::forward`](gs_core::Rasterizer::forward); [`Error::Setting`] for any
    /// other texture.
    pub async fn draw_to_texture<S: Kind>(
        &self,
        splats: &Splats<S>,
        view: &S::View,
        settings: &RenderSettings,
        texture: &wgpu::Texture,
    ) -> Result<Culled, Error> {
        S::check(view, settings)?;
        check_texture(texture, S::size(view))?;
        let gpu = &self.gpu;
        splats.settle(gpu).await?;
        let mut workspace = S::pool(&self.pools).take(gpu)?;
        workspace.set(gpu, splats, view, settings)?;
        let describe = |w: &Workspace<S>| w.describe(gpu, splats, None, None);
        let blend = |w: &mut Workspace<S>, commands: &mut Commands| {
            w.tiles.encode_blend(gpu, commands);
            Ok(())
        };
        let status = workspace.with_lists(gpu, splats, describe, blend).await?;
        gpu.show(&workspace.tiles.image.buffer, texture)?;
        S::pool(&self.pools).give(workspace);
        Ok(status.culled())
    }
}

fn check_texture(texture: &wgpu::Texture, size: [u32; 2]) -> Result<(), Error> {
    let refused = |what, found: String, wanted| Err(Error::setting(what, found, wanted));
    if [texture.width(), texture.height()] != size {
        return refused("the texture's size", format!("{}x{}", texture.width(), texture.height()), "that of the view");
    }
    if !texture.usage().contains(wgpu::TextureUsages::RENDER_ATTACHMENT) {
        return refused("the texture's usage", format!("{:?}", texture.usage()), "with RENDER_ATTACHMENT");
    }
    if texture.sample_count() != 1 || texture.dimension() != wgpu::TextureDimension::D2 {
        let found = format!("{} samples, {:?}", texture.sample_count(), texture.dimension());
        return refused("the texture's kind", found, "one sample and two dimensions");
    }
    let is_color = matches!(texture.format().sample_type(None, None), Some(wgpu::TextureSampleType::Float { .. }));
    if !is_color || texture.format().is_compressed() {
        return refused("the texture's format", format!("{:?}", texture.format()), "a colour format of floats");
    }
    Ok(())
}

impl Gpu {
    /// Copies an image, one `vec4f` per pixel, to a texture of its size.
    fn show(&self, image: &wgpu::Buffer, texture: &wgpu::Texture) -> Result<(), Error> {
        let format = texture.format();
        let pipeline = {
            let mut pipelines = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
            pipelines.entry(format).or_insert_with(|| self.show_pipeline(format)).clone()
        };
        let uniform = self.allocate("a texture", size_of::<Shown>() as u64, UNIFORM)?;
        let shown = Shown { width: texture.width(), encodes: u32::from(format.is_srgb()), unused: [0; 2] };
        self.write(&uniform, bytemuck::bytes_of(&shown));
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("show"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: image.as_entire_binding() },
            ],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            mip_level_count: Some(1),
            array_layer_count: Some(1),
            ..wgpu::TextureViewDescriptor::default()
        });
        let mut commands = Commands::new(self);
        let mut pass = commands.encoder().begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("show"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
        drop(pass);
        commands.submit(self);
        self.check().map_err(|e| backend_error(format!("drawing into the texture: {e}")))
    }

    fn show_pipeline(&self, format: wgpu::TextureFormat) -> wgpu::RenderPipeline {
        let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("show"),
            source: wgpu::ShaderSource::Wgsl(include_str!("../shaders/show.wgsl").into()),
        });
        self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("show"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("color"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{
        Blend, Camera, Canvas, Gaussian2d, Gaussian3d, Parameterization, Rasterizer, Scene, Scene2d, Scene3d,
    };
    use pollster::FutureExt as _;
    use wgpu::{TextureDescriptor, TextureDimension, TextureFormat, TextureUsages};

    use super::*;
    use crate::{WgpuSettings, adapter};

    const SIZE: wgpu::Extent3d = wgpu::Extent3d { width: 64, height: 40, depth_or_array_layers: 1 };

    /// A host program: its device, and a rasterizer that shares it.
    struct Host {
        device: wgpu::Device,
        queue: wgpu::Queue,
        rasterizer: WgpuRasterizer,
    }

    impl Host {
        fn open() -> Self {
            let (adapter, _) = adapter::choose(None).block_on().expect("`cargo xtask test` installs a driver");
            let (device, queue) = adapter.request_device(&wgpu::DeviceDescriptor::default()).block_on().unwrap();
            let settings = WgpuSettings::default();
            let rasterizer = WgpuRasterizer::from_device(device.clone(), queue.clone(), settings).unwrap();
            Self { device, queue, rasterizer }
        }

        /// A texture that fits [`SIZE`], except for what `change` changes.
        fn texture(&self, change: impl FnOnce(&mut TextureDescriptor<'_>)) -> wgpu::Texture {
            let mut descriptor = TextureDescriptor {
                label: None,
                size: SIZE,
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: TextureFormat::Rgba8Unorm,
                usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
                view_formats: &[],
            };
            change(&mut descriptor);
            self.device.create_texture(&descriptor)
        }

        fn bytes_of(&self, texture: &wgpu::Texture, bytes_per_pixel: u32) -> Vec<u8> {
            let bytes_per_row = bytes_per_pixel * SIZE.width;
            let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: u64::from(bytes_per_row * SIZE.height),
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            let layout =
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(bytes_per_row), rows_per_image: None };
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let copy = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
            encoder.copy_texture_to_buffer(texture.as_image_copy(), copy, SIZE);
            self.queue.submit([encoder.finish()]);
            buffer.map_async(wgpu::MapMode::Read, .., |_| {});
            self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
            buffer.get_mapped_range(..).unwrap().to_vec()
        }

        /// Draws a scene into textures of several formats and compares them with the image.
        fn compare<S: Kind>(&self, scene: &S, view: &S::View, settings: &RenderSettings) {
            let splats = self.rasterizer.upload(scene, Parameterization::ScaleRotation).unwrap();
            let drawn = <WgpuRasterizer as Rasterizer<S>>::draw(&self.rasterizer, &splats, view, settings);
            let (image, culled) = drawn.block_on().unwrap();
            let clamped: Vec<[f32; 3]> = image.pixels().iter().map(|color| color.map(|v| v.clamp(0.0, 1.0))).collect();
            assert!(clamped.iter().any(|color| *color != clamped[0]), "an image of one colour tests nothing");
            for format in [
                TextureFormat::Rgba8Unorm,
                TextureFormat::Rgba8UnormSrgb,
                TextureFormat::Bgra8Unorm,
                TextureFormat::Bgra8UnormSrgb,
                TextureFormat::Rgba32Float,
            ] {
                let texture = self.texture(|descriptor| descriptor.format = format);
                let shown = self.rasterizer.draw_to_texture(&splats, view, settings, &texture).block_on().unwrap();
                assert_eq!(shown, culled, "{format:?}");
                let (found, tolerance): (Vec<[f32; 4]>, f32) = match format {
                    TextureFormat::Rgba32Float => (bytemuck::pod_collect_to_vec(&self.bytes_of(&texture, 16)), 1e-6),
                    _ => {
                        let bytes = self.bytes_of(&texture, 4);
                        let pixels = bytes.as_chunks::<4>().0.iter();
                        (pixels.map(|pixel| pixel.map(|byte| f32::from(byte) / 255.0)).collect(), 1.01 / 255.0)
                    }
                };
                assert_eq!(found.len(), clamped.len());
                for (index, (found, &[r, g, b])) in found.iter().zip(&clamped).enumerate() {
                    let is_bgra = matches!(format, TextureFormat::Bgra8Unorm | TextureFormat::Bgra8UnormSrgb);
                    let expected = if is_bgra { [b, g, r, 1.0] } else { [r, g, b, 1.0] };
                    let agrees = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance);
                    assert!(agrees, "{format:?}, pixel {index}: {found:?} instead of {expected:?}");
                }
            }
        }
    }

    fn scene_2d() -> Scene2d {
        let gaussian = |i: u32| Gaussian2d {
            mean: Vec2::new((i * 13 % 64) as f32, (i * 7 % 40) as f32),
            log_scale: Vec2::new(2.0, 1.0),
            rotation: i as f32,
            opacity_logit: 1.0,
            // Some colours are outside 0 to 1.
            color: Vec3::new(0.15 * i as f32, 0.4, 0.5 - 0.1 * i as f32),
        };
        (0..12).map(gaussian).collect()
    }

    fn scene_3d() -> Scene3d {
        let mut scene = Scene3d::default();
        for i in 0..12u32 {
            // The last one is behind the camera.
            let depth = if i == 11 { -3.0 } else { 2.0 + 0.1 * i as f32 };
            scene.push(Gaussian3d {
                mean: Vec3::new((i % 4) as f32 * 0.4 - 0.6, (i / 4) as f32 * 0.4 - 0.4, depth),
                log_scale: Vec3::new(-2.0, -2.5, -1.5),
                rotation: [1.0, 0.1 * i as f32, 0.2, 0.0],
                opacity_logit: 1.0,
                sh: vec![Vec3::new(0.3 * i as f32 - 1.0, 0.5, -0.5)],
            });
        }
        scene
    }

    #[test]
    fn wgpu_fills_textures_of_the_host_in_every_format() {
        let host = Host::open();
        let on_grey = RenderSettings::blended(Blend::Over).on([0.2, 0.5, 0.7]);
        host.compare(&scene_2d(), &Canvas::new(SIZE.width, SIZE.height), &on_grey);
        let camera = Camera::looking_forward(SIZE.width, SIZE.height, 0.9);
        host.compare(&scene_3d(), &camera, &RenderSettings::default().on([0.2, 0.5, 0.7]));
    }

    #[test]
    fn wgpu_refuses_other_textures_with_the_reason() {
        let host = Host::open();
        let splats = host.rasterizer.upload(&scene_2d(), Parameterization::ScaleRotation).unwrap();
        let (view, settings) = (Canvas::new(SIZE.width, SIZE.height), RenderSettings::blended(Blend::Over));
        let refused = |what: &str, change: fn(&mut TextureDescriptor<'_>)| {
            let drawn = host.rasterizer.draw_to_texture(&splats, &view, &settings, &host.texture(change)).block_on();
            let message = drawn.unwrap_err().to_string();
            assert!(message.contains(what), "{what}: {message}");
        };
        refused("64x41", |descriptor| descriptor.size.height = 41);
        refused("RENDER_ATTACHMENT", |descriptor| descriptor.usage = TextureUsages::COPY_SRC);
        refused("4 samples", |descriptor| {
            (descriptor.sample_count, descriptor.usage) = (4, TextureUsages::RENDER_ATTACHMENT);
        });
        refused("D3", |descriptor| descriptor.dimension = TextureDimension::D3);
        refused("Rgba8Uint", |descriptor| descriptor.format = TextureFormat::Rgba8Uint);
        refused("Depth32Float", |descriptor| descriptor.format = TextureFormat::Depth32Float);
    }
}
