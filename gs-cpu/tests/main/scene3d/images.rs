//! Images compared with a dense rendering by gs-core's functions for one Gaussian at one pixel.

use glam::Vec2;
use gs_core::{
    Blend, Camera, Image, Rasterizer, RenderSettings, Scene, Scene3d,
    effects::{Antialias, Order},
    math::{
        perspective::{Ellipsoid, Perspective, Projection},
        sh,
        splat::{Conic, cut, over, weight},
    },
};
use pollster::FutureExt as _;

use super::scenes::{camera, rasterizer, scene, settings};

fn dense(scene: &Scene3d, camera: &Camera, settings: &RenderSettings) -> Image {
    let perspective = Perspective::new(camera, settings);
    let degree = settings.effects.sh_degree.min(scene.sh_degree);
    let drawn: Vec<(Projection, Conic, [f32; 3])> = (0..scene.len())
        .filter_map(|i| {
            let g = scene.gaussian(i);
            let (mean, log_scale) = (g.mean, g.log_scale);
            let ellipsoid = Ellipsoid { mean, log_scale, rotation: g.rotation, opacity_logit: g.opacity_logit };
            let p = perspective.project(&ellipsoid).ok()?;
            let [xx, xy, yy] = p.covariance.map(|c| c / p.determinant);
            Some((p, Conic { a: yy, b: -xy, c: xx }, sh::color(degree, perspective.direction(mean), &g.sh)))
        })
        .collect();
    Image::from_fn(camera.width, camera.height, |x, y| {
        let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let mut order: Vec<(f32, usize)> = (0..drawn.len())
            .map(|i| {
                let p = &drawn[i].0;
                let at_pixel = p.depth + p.depth_slope.dot(centre - p.mean);
                let depth = match settings.effects.order {
                    Order::Index => 0.0,
                    Order::Global => p.depth,
                    Order::PerPixel => at_pixel,
                };
                (depth, i)
            })
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut pixel = over::Forward::default();
        for (_, i) in order {
            let (p, conic, color) = &drawn[i];
            let uncut = cut(p.opacity * weight(conic, centre - p.mean), &settings.accuracy);
            match settings.effects.blend {
                Blend::Over => {
                    over::blend_fwd(&mut pixel, over::alpha(uncut, &settings.accuracy), *color, &settings.accuracy);
                }
                Blend::Sum => (0..3).for_each(|k| pixel.color[k] += uncut * color[k]),
            }
        }
        let left = if settings.effects.blend == Blend::Sum { 1.0 } else { pixel.transmittance };
        [0, 1, 2].map(|k| pixel.color[k] + left * settings.background_color()[k])
    })
    .unwrap()
}

/// The share of pixels that differ by more than rounding explains.
fn flips(a: &Image, b: &Image) -> f64 {
    let apart = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > 5e-5);
    a.pixels().iter().zip(b.pixels()).filter(|&pair| apart(pair)).count() as f64 / a.pixels().len() as f64
}

#[test]
fn images_match_a_dense_rendering() {
    let cpu = rasterizer(2);
    // With 400 Gaussians, some pixels are full before the last one.
    for (count, size) in [(400, 6.0), (60, 12.0), (1, 3.0)] {
        let scene = scene(count, 3, size);
        let view = camera(75, 140);
        for (blend, order) in [
            (Blend::Over, Order::Index),
            (Blend::Over, Order::Global),
            (Blend::Over, Order::PerPixel),
            (Blend::Sum, Order::Index),
        ] {
            // Many Gaussians are for full pixels and orders, which do not depend on antialiasing.
            let antialiases = if count == 400 { &Antialias::ALL[..1] } else { &Antialias::ALL[..] };
            for &antialias in antialiases {
                let mut settings = settings(order, 3);
                settings.effects.blend = blend;
                settings.effects.antialias = antialias;
                let expected = dense(&scene, &view, &settings);
                let found = cpu.for_3d().render(&scene, &view, &settings).block_on().unwrap();
                // Rounding decides at the cut, and for Gaussians of equal depths.
                let share = flips(&found, &expected);
                assert!(share < 2e-3, "{count} {blend:?} {order:?} {antialias:?}: {share} of the pixels differ");
            }
        }
    }
}

#[test]
fn the_comparison_distinguishes_the_orders() {
    let scene = scene(400, 1, 6.0);
    let view = camera(75, 140);
    let [index, global, pixel] = [Order::Index, Order::Global, Order::PerPixel]
        .map(|order| rasterizer(1).for_3d().render(&scene, &view, &settings(order, 1)).block_on().unwrap());
    for pair in [(&index, &global), (&global, &pixel), (&index, &pixel)] {
        assert!(flips(pair.0, pair.1) > 0.05);
    }
}
