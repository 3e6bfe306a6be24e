//! Drawing into a texture of the host program: the image goes from the buffer that it is blended into to the texture, on the device.

use std::sync::PoisonError;

use gs_core::{Error, RenderSettings, statistics::Culled};

use crate::{
    WgpuRasterizer,
    dispatch::Commands,
    gpu::{Gpu, backend_error},
    kind::SceneKind,
    layout::Shown,
    splats::{Splats, UNIFORM},
    workspace::Workspace,
};

impl WgpuRasterizer {
    /// Draws splats into a texture of the device that this rasterizer is on ([`WgpuRasterizer::from_device`]); how many Gaussians the image
    /// leaves out. No pixel crosses to the host, which only learns how long the tiles' lists are.
    ///
    /// The texture has the view's size, one sample, a colour format that can be rendered to, and
    /// [`TextureUsages::RENDER_ATTACHMENT`](wgpu::TextureUsages::RENDER_ATTACHMENT). Its first mip level and layer are written, values
    /// held to 0..=1 and opaque. Images hold values that are encoded as in sRGB: a format that encodes them itself gets them
    /// decoded, so that both kinds look the same.
    ///
    /// # Errors
    /// Those of [`Rasterizer::forward`](gs_core::Rasterizer::forward); [`Error::Setting`] where the texture is of another kind.
    pub async fn draw_to_texture<S: SceneKind>(
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
        let mut workspace = S::pool(self).take(gpu)?;
        workspace.set(gpu, splats, view, settings)?;
        let describe = |w: &Workspace<S>| w.describe(gpu, splats, None, None);
        let blend = |w: &mut Workspace<S>, commands: &mut Commands| {
            w.tiles.encode_blend(gpu, commands);
            Ok(())
        };
        let status = self.with_lists(&mut workspace, splats, describe, blend).await?;
        gpu.show(&workspace.tiles.image.buffer, texture)?;
        S::pool(self).give(workspace);
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
    /// Sends an image, one `vec4f` a pixel, to a texture of its size.
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
