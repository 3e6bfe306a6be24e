//! Images of a scene in different orders.

use gs_core::{Image, Rasterizer, effects::Order};
use pollster::FutureExt as _;

use super::scenes::{camera, rasterizer, scene, settings};

/// The share of pixels that differ by more than rounding explains.
fn flips(a: &Image, b: &Image) -> f64 {
    let apart = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > 5e-5);
    a.pixels().iter().zip(b.pixels()).filter(|&pair| apart(pair)).count() as f64 / a.pixels().len() as f64
}

#[test]
fn the_orders_give_different_images() {
    let scene = scene(400, 1, 6.0);
    let view = camera(75, 140);
    let [index, global, pixel] = [Order::Index, Order::Global, Order::PerPixel]
        .map(|order| rasterizer(1).for_3d().render(&scene, &view, &settings(order, 1)).block_on().unwrap());
    for pair in [(&index, &global), (&global, &pixel), (&index, &pixel)] {
        assert!(flips(pair.0, pair.1) > 0.05);
    }
}
