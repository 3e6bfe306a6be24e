//! Compact targets give the bits of other targets.

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Canvas, Gaussian2d, Image, Loss, Parameterization, Rasterizer, RenderSettings, Scene2d, TargetImage,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use pollster::FutureExt as _;

#[test]
fn compact_targets_give_the_bits_of_others() {
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let scene: Scene2d = (0..20)
        .map(|i| Gaussian2d {
            mean: Vec2::new((i * 7 % 37) as f32, (i * 11 % 25) as f32),
            log_scale: Vec2::new(1.5, 1.0),
            rotation: i as f32,
            opacity_logit: 1.0,
            color: Vec3::new(0.9, 0.5, 0.05 * i as f32),
        })
        .collect();
    let splats = cpu.upload(&scene, Parameterization::ScaleRotation).unwrap();
    let (canvas, settings) = (Canvas::new(37, 25), RenderSettings::blended(Blend::Over));
    let floats = Image::from_fn(37, 25, |x, y| [(x as f32 * 0.3).sin().abs(), y as f32 / 25.0, 0.3]).unwrap();
    let levels = floats.rounded_to_8_bits();
    let mask: Vec<bool> = (0..37 * 25).map(|i| i % 7 != 3).collect();
    for (image, mask) in [(&floats, None), (&levels, None), (&levels, Some(&mask[..])), (&floats, Some(&mask[..]))] {
        for loss in [Loss::L1, Loss::L2, Loss::PAPER] {
            let bits = |compact: bool| {
                let target = TargetImage { mask, compact, ..image.into() };
                let target = Rasterizer::<Scene2d>::upload_target(&cpu, target).unwrap();
                // Twice, because a target may keep what the first pass computes.
                [0, 1].map(|_| {
                    let pass = cpu.forward(&splats, &canvas, &settings).block_on().unwrap();
                    let (value, gradients) = cpu.backward(&splats, pass, &target, &loss).block_on().unwrap();
                    let gradients: Scene2d = cpu.gradients(&splats, &gradients).block_on().unwrap();
                    let numbers = gradients.iter().flat_map(|g| [g.mean.x, g.log_scale.y, g.color.z, g.opacity_logit]);
                    numbers.chain([value]).map(f32::to_bits).collect::<Vec<_>>()
                })
            };
            let found = bits(true);
            assert!(found[0].iter().filter(|bits| **bits << 1 != 0).count() > 40, "there are gradients");
            assert!(found == bits(false), "{loss:?}, with a mask: {}", mask.is_some());
        }
    }
}
