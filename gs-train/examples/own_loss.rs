//! A training with a loss and an optimizer loop of your own: the Charbonnier loss, Adam of the
//! backend, then gradient descent on the host. It works in the same way with 3D scenes and cameras.
//!
//! `cargo run --release -p gs-train --example own_loss`
#![allow(clippy::print_stdout)]

use std::error::Error;

use gs_core::{
    Adam, Blend, Canvas, Gaussian2d, Image, Optimizer, Parameterization, Rasterizer, RenderSettings, Scene, Scene2d,
    metrics,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::paper_target;
use pollster::FutureExt as _;

/// The mean of √(d² + ε²) over all values d = C − Y, and its derivative by each pixel of `image`.
fn charbonnier(image: &Image, target: &Image) -> Result<(f32, Image), gs_core::Error> {
    const EPSILON: f32 = 1e-3;
    image.same_size(target)?;
    let per_value = 1.0 / (3 * image.pixels().len()) as f32;
    let mut loss = 0.0;
    let v_image = Image::from_fn(image.width(), image.height(), |x, y| {
        let (color, wanted) = (image.pixel(x, y), target.pixel(x, y));
        std::array::from_fn(|channel| {
            let difference = color[channel] - wanted[channel];
            let root = difference.hypot(EPSILON);
            loss += per_value * root;
            per_value * difference / root
        })
    })?;
    Ok((loss, v_image))
}

/// Round Gaussians on a grid, in the colours of the image.
fn first_gaussians(target: &Image, spacing: u32) -> Scene2d {
    let at = |x: u32, y: u32| Gaussian2d {
        mean: [x as f32 + 0.5, y as f32 + 0.5].into(),
        log_scale: [(0.5 * spacing as f32).ln(); 2].into(),
        rotation: 0.0,
        opacity_logit: f32::INFINITY,
        color: target.pixel(x, y).map(|value| 0.5 * value).into(),
    };
    let along = |side: u32| (spacing / 2..side).step_by(spacing as usize);
    along(target.height()).flat_map(|y| along(target.width()).map(move |x| at(x, y))).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    const STEPS: u32 = 300;
    let target = paper_target();
    let (width, height) = target.size();
    let view = Canvas::new(width, height);
    let settings = RenderSettings::blended(Blend::Sum);
    let on = CpuRasterizer::new(CpuSettings::default())?; // or gs_backend::open(…), which may be a GPU
    let on = on.for_2d(); // for_3d() with a Scene3d and a Camera

    let mut splats = on.upload(&first_gaussians(&target, 6), Parameterization::ScaleRotation)?;
    for step in 0..STEPS {
        let pass = on.forward(&splats, &view, &settings).block_on()?;
        let (loss, v_image) = charbonnier(&on.image(&pass).block_on()?, &target)?;
        let gradients = on.image_vjp(&splats, pass, &v_image).block_on()?; // uses up the pass
        let rates = Adam::default().at(step as f32 / STEPS as f32);
        on.step(&mut splats, &gradients, &rates).block_on()?;
        if step % 100 == 0 {
            println!("step {step}: loss {loss:.4}");
        }
    }

    // An optimizer of your own: derivatives come as a scene, under the names of the parameters.
    let mut scene = on.download(&splats).block_on()?;
    for _ in 0..20 {
        let splats = on.upload(&scene, Parameterization::ScaleRotation)?;
        let pass = on.forward(&splats, &view, &settings).block_on()?;
        let (_, v_image) = charbonnier(&on.image(&pass).block_on()?, &target)?;
        let gradients = on.image_vjp(&splats, pass, &v_image).block_on()?;
        let derivatives = on.gradients(&splats, &gradients).block_on()?;
        for (color, derivative) in scene.colors.iter_mut().zip(&derivatives.colors) {
            *color -= 1.0 * *derivative;
        }
    }

    let image = on.render(&scene, &view, &settings).block_on()?;
    let psnr = metrics::psnr(&image, &target)?;
    println!("{} Gaussians: {psnr:.2} dB", scene.len());
    Ok(())
}
