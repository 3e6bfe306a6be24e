//! Gradients of all parameters, compared with central differences of the rendered image.

use glam::Vec3;
use gs_core::Rasterizer as _;
use gs_core::{
    Blend, Camera, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene3d,
    effects::{Antialias, Order},
};
use pollster::FutureExt as _;

use super::scenes::{camera, image, rasterizer, scene, settings};

/// Half the sum of the squared differences, in `f64`. The mean would be too small for differences.
fn loss(r: &impl Optimizer<Scene3d>, s: &Scene3d, view: &Camera, settings: &RenderSettings, target: &Image) -> f64 {
    let found = r.render(s, view, settings).block_on().unwrap();
    let pairs = found.pixels().as_flattened().iter().zip(target.pixels().as_flattened());
    pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum::<f64>() / 2.0
}

fn flat(vectors: &mut [Vec3]) -> Vec<&mut f32> {
    vectors.iter_mut().flat_map(|v| <&mut [f32; 3]>::into_iter(v.as_mut())).collect()
}

/// All numbers of a scene, group by group.
fn groups(scene: &mut Scene3d) -> [(&'static str, Vec<&mut f32>); 5] {
    [
        ("mean", flat(&mut scene.means)),
        ("log-scale", flat(&mut scene.log_scales)),
        ("rotation", scene.rotations.iter_mut().flatten().collect()),
        ("opacity", scene.opacity_logits.iter_mut().collect()),
        ("sh", flat(&mut scene.sh)),
    ]
}

#[test]
fn gradients_are_central_differences() {
    let cpu = rasterizer(2);
    let cpu = cpu.for_3d();
    let view = camera(40, 30);
    let target = image(40, 30);
    let count = (3 * 40 * 30) as f32;
    // Not PerPixel, whose image jumps where two depths cross. The conformance suite compares its
    // gradients with the oracle's.
    for (blend, order, antialias, degree) in [
        (Blend::Over, Order::Global, Antialias::None, 2),
        (Blend::Over, Order::Global, Antialias::Dilate, 0),
        (Blend::Over, Order::Global, Antialias::Mip, 1),
        (Blend::Over, Order::Global, Antialias::Compensated, 1),
        (Blend::Over, Order::Index, Antialias::Mip, 3),
        (Blend::Sum, Order::Index, Antialias::Dilate, 3),
    ] {
        let mut scene = scene(12, 3, 5.0);
        let mut settings = settings(order, degree);
        settings.effects.blend = blend;
        settings.effects.antialias = antialias;
        // The step at the cut is too small for the differences.
        settings.accuracy.alpha_cut = 1e-6;
        let on_backend = cpu.upload_target(&target).unwrap();
        let splats = cpu.upload(&scene, Parameterization::ScaleRotation).unwrap();
        let pass = cpu.forward(&splats, &view, &settings).block_on().unwrap();
        let (_, gradients) = cpu.backward(&splats, pass, &on_backend, &Loss::L2).block_on().unwrap();
        let mut found = cpu.gradients(&splats, &gradients).block_on().unwrap();
        let found = groups(&mut found)
            .map(|(name, values)| (name, values.into_iter().map(|v| *v * count / 2.0).collect::<Vec<_>>()));
        for (group, (name, found)) in found.into_iter().enumerate() {
            let largest = found.iter().fold(0.0f32, |m, v| m.max(v.abs()));
            let unused = blend == Blend::Sum && name == "opacity";
            assert_eq!(largest > 0.0, !unused, "{name}");
            let mut worst = 0.0f32;
            for k in 0..found.len() {
                let mut shifted = |by: f32| {
                    let value = &mut groups(&mut scene)[group].1;
                    let before = *value[k];
                    *value[k] += by;
                    let loss = loss(cpu, &scene, &view, &settings, &target);
                    *groups(&mut scene)[group].1[k] = before;
                    loss
                };
                let h = if name == "sh" { 2e-2 } else { 3e-3 };
                let numeric = (shifted(h) - shifted(-h)) / f64::from(2.0 * h);
                worst = worst.max((f64::from(found[k]) - numeric).abs() as f32);
            }
            assert!(worst <= 4e-3 * largest, "{blend:?} {order:?} {antialias:?} {name}: off by {worst} of {largest}");
        }
    }
}
