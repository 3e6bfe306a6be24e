//! A warm training step allocates nothing that grows with the scene or the image.
//!
//! This test counts with an allocator of its own, so it needs a process of its own. The thread
//! pool's queue allocates a block of memory for every few dozen jobs that come from outside the
//! pool.

#![allow(unsafe_code, reason = "an allocator that counts has to be an allocator")]

use pollster::FutureExt as _;
use std::{
    alloc::{GlobalAlloc, Layout, System},
    sync::atomic::{AtomicUsize, Ordering},
};

use glam::{Vec2, Vec3};
use gs_core::{
    Adam, Binning, Blend, Camera, Canvas, Gaussian2d, Gaussian3d, Image, Loss, MomentFormat, Optimizer,
    Parameterization, RenderSettings, Scene as _, Scene2d, Scene3d, TargetImage, TrainStep, Wait, profile::still,
};
use gs_cpu::{CpuRasterizer, CpuSettings};

struct Counting;

static BYTES: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        BYTES.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps `GlobalAlloc`'s contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps `GlobalAlloc`'s contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Whether a target has a mask.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mask {
    None,
    LeftHalf,
}

/// Bytes that `steps` warm training steps allocate.
fn bytes_of_warm_steps(cpu: &impl Optimizer<Scene2d>, blend: Blend, loss: Loss, mask: Mask, steps: usize) -> usize {
    let (width, height) = (160, 120);
    let scene: Scene2d = (0..2000u32)
        .map(|i| Gaussian2d {
            mean: Vec2::new((i * 37 % width) as f32 + 0.3, (i * 53 % height) as f32 + 0.7),
            log_scale: Vec2::new(1.0, 0.3),
            rotation: i as f32,
            opacity_logit: if blend == Blend::Over { 0.0 } else { f32::INFINITY },
            color: Vec3::new(0.2, 0.1, 0.3),
        })
        .collect();
    let image = Image::from_fn(width, height, |x, y| [x as f32 / 160.0, y as f32 / 120.0, 0.5]).unwrap();
    let counted: Vec<bool> = (0..width * height).map(|i| i % width < width / 2).collect();
    let mut target = TargetImage::from(&image);
    if mask == Mask::LeftHalf {
        target.mask = Some(&counted);
    }
    let target = cpu.upload_target(target).unwrap();
    let mut splats = cpu.upload(&scene, Parameterization::CovarianceFactor).unwrap();
    let settings = RenderSettings::blended(blend);
    // Rates of 0 keep the length of the lists, whose growth would be counted.
    let mut adam = Adam::default();
    for group in [&mut adam.mean, &mut adam.scale, &mut adam.rotation, &mut adam.opacity, &mut adam.color] {
        group.learning_rate = 0.0;
    }
    let rates = adam.at(0.0);
    let step = TrainStep { settings: &settings, loss, rates: &rates, binning: Binning::Fresh };
    let mut losses = Vec::new();
    let mut run = |steps| {
        for _ in 0..steps {
            cpu.train_step(&mut splats, &Canvas::new(width, height), &target, &step).block_on().unwrap();
            losses.clear();
            cpu.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap();
            assert_eq!(losses.len(), 1);
        }
    };
    // The table of bias corrections has one entry per step count. Its capacity is 256 entries after
    // 140 steps, so it does not grow in the next 100.
    run(140);
    let before = BYTES.load(Ordering::Relaxed);
    run(steps);
    BYTES.load(Ordering::Relaxed) - before
}

/// The bytes of warm steps in 3D, whose moments of SH above degree 0 are in 16 bits.
fn bytes_of_warm_steps_3d(cpu: &impl Optimizer<Scene3d>, steps: usize) -> usize {
    let (width, height) = (160, 120);
    let mut scene = Scene3d { sh_degree: 3, ..Scene3d::default() };
    for i in 0..2000 {
        let (x, y) = ((i % 50) as f32 / 50.0 - 0.5, (i / 50) as f32 / 40.0 - 0.5);
        let gaussian = Gaussian3d {
            mean: Vec3::new(2.0 * x, 2.0 * y, 3.0 + x * y),
            log_scale: Vec3::splat(-4.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 0.5,
            sh: vec![Vec3::splat(0.3)],
        };
        scene.push(gaussian.with_degree(3));
    }
    let image = Image::from_fn(width, height, |x, y| [x as f32 / 160.0, y as f32 / 120.0, 0.5]).unwrap();
    let target = cpu.upload_target(&image).unwrap();
    let mut splats = cpu.upload(&scene, Parameterization::ScaleRotation).unwrap();
    let mut settings = RenderSettings::blended(Blend::Over);
    settings.effects.sh_degree = 3;
    settings.camera_gradient = true;
    // Gaussians that do not move keep the length of the lists, whose growth would be counted.
    let mut rates = still();
    rates.color_rest_moments = MomentFormat::Bf16;
    let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
    let camera = Camera::looking_forward(width, height, 1.0);
    let (mut losses, mut by_camera) = (Vec::new(), Vec::new());
    let mut run = |steps| {
        for _ in 0..steps {
            cpu.train_step(&mut splats, &camera, &target, &step).block_on().unwrap();
            losses.clear();
            cpu.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap();
            by_camera.clear();
            cpu.camera_gradients(&mut splats, Wait::All, &mut by_camera).block_on().unwrap();
            assert_eq!(by_camera.len(), 1);
        }
    };
    // As in 2D, the table of bias corrections does not grow after 140 steps.
    run(140);
    let before = BYTES.load(Ordering::Relaxed);
    run(steps);
    BYTES.load(Ordering::Relaxed) - before
}

#[test]
fn only_the_thread_pools_queue_allocates_in_warm_steps() {
    let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(2);
        s.level = None;
    }))
    .unwrap();
    for (blend, loss, mask) in [
        (Blend::Sum, Loss::L2, Mask::None),
        (Blend::Over, Loss::L1, Mask::None),
        (Blend::Over, Loss::PAPER, Mask::None),
        (Blend::Over, Loss::PAPER, Mask::LeftHalf),
    ] {
        let bytes = bytes_of_warm_steps(cpu.for_2d(), blend, loss, mask, 100);
        // The buffers of 2000 Gaussians on 160x120 px take megabytes.
        assert!(bytes < 100 * 512, "{blend:?} {loss:?} {mask:?}: {bytes} bytes in 100 steps");
    }
    let bytes = bytes_of_warm_steps_3d(cpu.for_3d(), 100);
    assert!(bytes < 100 * 512, "3D: {bytes} bytes in 100 steps");
}
