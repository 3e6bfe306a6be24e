//! Photographs of a room that is made up, with cameras that are known exactly: rays meet boxes with a pattern.

use std::{f32::consts::TAU, path::Path};

use glam::{Mat3, Vec3, vec3};
use gs_core::{Camera, Image};

/// A box with a pattern on its faces.
struct Block {
    from: Vec3,
    to: Vec3,
    color: Vec3,
}

/// The room is seen from within; y points down.
fn blocks() -> Vec<Block> {
    let block = |from: [f32; 3], to: [f32; 3], color: [f32; 3]| Block {
        from: Vec3::from_array(from),
        to: Vec3::from_array(to),
        color: Vec3::from_array(color),
    };
    vec![
        block([-3.0, -2.4, -3.0], [3.0, 0.0, 3.0], [0.85, 0.8, 0.7]),
        block([-0.7, -0.8, -0.4], [0.6, -0.7, 0.5], [0.7, 0.45, 0.3]),
        block([-0.2, -1.1, -0.2], [0.15, -0.8, 0.2], [0.3, 0.5, 0.75]),
        block([0.9, -1.5, 0.3], [1.5, 0.0, 1.2], [0.4, 0.65, 0.4]),
        block([-2.0, -0.6, 0.6], [-1.1, 0.0, 1.6], [0.8, 0.4, 0.45]),
    ]
}

/// Random but fixed, from 0 to 1.
fn noise(cell: [i32; 3], salt: u32) -> f32 {
    let mut bits = salt.wrapping_mul(0x9E37_79B9);
    for value in cell {
        bits = (bits ^ value as u32).wrapping_mul(0x85EB_CA6B);
        bits ^= bits >> 15;
    }
    (bits >> 8) as f32 / (1 << 24) as f32
}

/// The brightness at a point: patches of several sizes.
fn pattern(at: Vec3, salt: u32) -> f32 {
    let sizes = [0.5, 0.23, 0.11];
    let sum: f32 =
        sizes.iter().zip(0..).map(|(size, k)| noise((at / size).floor().as_ivec3().to_array(), salt + k)).sum();
    0.25 + 0.75 * sum / sizes.len() as f32
}

/// The color that a ray meets.
fn color(blocks: &[Block], from: Vec3, along: Vec3) -> Vec3 {
    let hit = |(index, block): (usize, &Block)| {
        let (a, b) = ((block.from - from) / along, (block.to - from) / along);
        let (enters, leaves) = (a.min(b).max_element(), a.max(b).min_element());
        // The room is left, and the others are entered.
        let at = if index == 0 { leaves } else { enters };
        (enters <= leaves && at > 0.0).then_some((at, index))
    };
    let nearest = blocks.iter().enumerate().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0));
    let (at, index) = nearest.expect("the room is closed");
    let point = from + at * along;
    // Inside of the surface, so that rounding does not change a cell.
    blocks[index].color * pattern(point + 1e-3 * along, 16 * index as u32)
}

/// The cameras of so many photographs, on an arc around the table.
pub(crate) fn cameras(count: u32, [width, height]: [u32; 2]) -> Vec<Camera> {
    let lens = Camera::looking_forward(width, height, 1.1);
    let camera = |i: u32| {
        let angle = (i as f32 / count as f32 - 0.5) * 0.5 * TAU;
        let from = vec3(1.9 * angle.sin(), -1.5 + 0.25 * (3.0 * angle).sin(), -1.9 * angle.cos());
        lens.looking_at(from, vec3(0.0, -0.8, 0.3), -Vec3::Y).expect("a direction")
    };
    (0..count).map(camera).collect()
}

/// Writes the photograph of each camera, named by its number, into a folder.
pub(crate) fn write(cameras: &[Camera], folder: &Path) {
    let blocks = blocks();
    for (index, camera) in cameras.iter().enumerate() {
        let (from, to_world): (Vec3, Mat3) = (camera.position(), camera.rotation.transpose());
        let pixel = |x: u32, y: u32| {
            let sample = |dx: f32, dy: f32| {
                let at = (glam::vec2(x as f32 + dx, y as f32 + dy) - camera.center) / camera.focal;
                color(&blocks, from, to_world * at.extend(1.0))
            };
            let mean = 0.25 * (sample(0.25, 0.25) + sample(0.75, 0.25) + sample(0.25, 0.75) + sample(0.75, 0.75));
            mean.to_array()
        };
        let picture = Image::from_fn(camera.width, camera.height, pixel).unwrap();
        gs_io::write_png(folder.join(format!("{index:02}.png")), &picture).unwrap();
    }
}
