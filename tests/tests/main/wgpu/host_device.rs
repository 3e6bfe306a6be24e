//! A program that has its own device, draws a scene into its own texture, and draws over it.

use gs_core::{Rasterizer as _, to_8_bits};
use pollster::FutureExt as _;

use super::rasterizer;

#[path = "../../../../gs-wgpu/examples/host_device.rs"]
#[expect(dead_code, reason = "an example is a program; its picture alone is tested")]
mod example;

#[test]
fn a_programs_texture_has_the_scene_and_what_the_program_draws_over_it() {
    let camera = example::camera();
    let scene = rasterizer().render(&example::ring(), &camera, &example::settings()).block_on().unwrap();
    let drawn = example::draw().block_on().unwrap();
    let (mut colored, mut differing, mut black) = (0, 0, 0);
    for (pixel, expected) in drawn.as_chunks::<4>().0.iter().zip(scene.pixels()) {
        let expected = expected.map(to_8_bits);
        colored += usize::from(expected != [255; 3]);
        if pixel[..3] == [0; 3] {
            black += 1;
        } else {
            differing += usize::from(pixel[..3].iter().zip(expected).any(|(&a, b)| a.abs_diff(b) > 1));
        }
    }
    assert!(colored > 5_000, "{colored} pixels of the scene");
    assert_eq!(differing, 0, "pixels that are neither the scene's nor the program's");
    // Twelve edges, of which the shortest is longer than 30 px.
    assert!((500..3_000).contains(&black), "{black} pixels of the box");
    for ends in example::edges() {
        let (middle, _) = camera.project(0.5 * (ends[0] + ends[1])).unwrap();
        let is_black = |x: f32, y: f32| drawn[4 * (y as usize * camera.width as usize + x as usize)..][..3] == [0; 3];
        let near = |d: f32| is_black(middle.x + d, middle.y) || is_black(middle.x, middle.y + d);
        assert!([-1.0, 0.0, 1.0].into_iter().any(near), "no edge at {middle}");
    }
}
