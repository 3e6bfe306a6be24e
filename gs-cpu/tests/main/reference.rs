//! The kernels at every SIMD level, compared with gs-core's functions for one Gaussian at one
//! pixel.

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Canvas, Gaussian2d, Image, Rasterizer, RenderSettings, Scene2d,
    math::splat::{Conic, cut, over, sum, weight},
    sigmoid,
};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use pollster::FutureExt as _;

/// Gaussians made from hashes of their indices: needles, large and small ones.
fn scene(count: u32, size: (u32, u32), translucent: bool) -> Scene2d {
    let unit = |i: u32, k: u32| {
        let x = (i * 9 + k + 1).wrapping_mul(0x9E37_79B9);
        ((x ^ (x >> 15)).wrapping_mul(0x85EB_CA6B) >> 8) as f32 / (1u32 << 24) as f32
    };
    (0..count)
        .map(|i| Gaussian2d {
            mean: Vec2::new(unit(i, 0) * 1.2 - 0.1, unit(i, 1) * 1.2 - 0.1) * Vec2::new(size.0 as f32, size.1 as f32),
            log_scale: Vec2::new(unit(i, 2) * 4.0 - 0.7, unit(i, 3) * 2.5 - 1.0),
            rotation: unit(i, 4) * 6.0,
            opacity_logit: if translucent { unit(i, 5) * 8.0 - 3.0 } else { f32::INFINITY },
            color: Vec3::new(unit(i, 6), unit(i, 7), unit(i, 8)),
        })
        .collect()
}

fn dense(scene: &Scene2d, size: (u32, u32), settings: &RenderSettings) -> Image {
    let gaussians: Vec<_> = scene
        .iter()
        .map(|g| (g, Conic::of_factor(g.factor()).expect("no Gaussian here is degenerate"), sigmoid(g.opacity_logit)))
        .collect();
    Image::from_fn(size.0, size.1, |x, y| {
        let mut pixel = over::Forward::default();
        for (g, conic, opacity) in &gaussians {
            let w = weight(conic, Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - g.mean);
            match settings.effects.blend {
                Blend::Sum => {
                    sum::blend_fwd(&mut pixel.color, cut(w, &settings.accuracy), g.color.to_array());
                }
                Blend::Over => {
                    let alpha = over::alpha(cut(opacity * w, &settings.accuracy), &settings.accuracy);
                    over::blend_fwd(&mut pixel, alpha, g.color.to_array(), &settings.accuracy);
                }
            }
        }
        let left = match settings.effects.blend {
            Blend::Sum => 1.0,
            Blend::Over => pixel.transmittance,
        };
        [0, 1, 2].map(|k| pixel.color[k] + left * settings.background_color()[k])
    })
    .unwrap()
}

#[test]
fn kernels_match_a_dense_rendering() {
    for size in [(40, 33), (16, 16), (1, 1), (17, 130)] {
        for blend in [Blend::Sum, Blend::Over] {
            let scene = scene(60, size, blend == Blend::Over);
            let settings = RenderSettings::blended(blend).on([0.2, 0.5, 0.9]);
            let expected = dense(&scene, size, &settings);
            for level in SimdLevel::available() {
                let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| {
                    s.level = Some(level);
                    s.threads = Some(2);
                }))
                .unwrap();
                let got = cpu.render(&scene, &Canvas::new(size.0, size.1), &settings).block_on().unwrap();
                let apart = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > 2e-5);
                // Rounding decides for pixels at the cut.
                let flips = got.pixels().iter().zip(expected.pixels()).filter(|&(a, b)| apart((a, b))).count();
                assert!(flips * 1000 <= got.pixels().len(), "{level} {blend:?} {size:?}: {flips} pixels differ");
            }
        }
    }
}

#[test]
fn the_comparison_detects_a_moved_gaussian() {
    let size = (40, 33);
    let settings = RenderSettings::blended(Blend::Sum);
    let scene = scene(60, size, false);
    let mut moved = scene.clone();
    moved.means[7].x += 0.01;
    let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let got = cpu.render(&moved, &Canvas::new(size.0, size.1), &settings).block_on().unwrap();
    let expected = dense(&scene, size, &settings);
    let off = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > 2e-5);
    let differing = got.pixels().iter().zip(expected.pixels()).filter(|&(a, b)| off((a, b))).count();
    assert!(differing * 1000 > got.pixels().len());
}
