//! Pictures of all directions: the faces of a cube, drawn in perspective, as one equirectangular image.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec2, Vec3};
use gs_core::{Camera, Image};

/// Side of a face in widths of the picture: the faces have at least 1.5 times the picture's resolution.
const SIDE: f32 = 1.5 / PI;

/// Half of a face's field of view as a tangent: a little more than 45°, so that faces overlap.
const HALF: f32 = 1.02;

/// The right, down and forward axes of each face, in those of the camera.
const FACES: [[Vec3; 3]; 6] = [
    [Vec3::X, Vec3::Y, Vec3::Z],
    [Vec3::NEG_Z, Vec3::Y, Vec3::X],
    [Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z],
    [Vec3::Z, Vec3::Y, Vec3::NEG_X],
    [Vec3::X, Vec3::Z, Vec3::NEG_Y],
    [Vec3::X, Vec3::NEG_Z, Vec3::Y],
];

/// The cameras of the faces for a picture of this width around a camera.
pub(super) fn cameras(camera: &Camera, width: u32) -> [Camera; 6] {
    let side = (width as f32 * SIDE).ceil();
    FACES.map(|[right, down, forward]| {
        let turn = Mat3::from_cols(right, down, forward).transpose();
        Camera {
            rotation: turn * camera.rotation,
            translation: turn * camera.translation,
            focal: Vec2::splat(0.5 * side / HALF),
            center: Vec2::splat(0.5 * side),
            width: side as u32,
            height: side as u32,
            near: camera.near,
        }
    })
}

/// The picture of these faces: longitudes −π to π from left to right, latitudes π/2 to −π/2 from top to bottom.
pub(super) fn join(faces: &[Image], width: u32, height: u32) -> Result<Image, gs_core::Error> {
    Image::from_fn(width, height, |x, y| {
        let longitude = ((x as f32 + 0.5) / width as f32 - 0.5) * TAU;
        let latitude = ((y as f32 + 0.5) / height as f32 - 0.5) * PI;
        let ray = Vec3::new(longitude.sin() * latitude.cos(), latitude.sin(), longitude.cos() * latitude.cos());
        let ahead = |face: &usize| ray.dot(FACES[*face][2]);
        let face = (0..6).max_by(|a, b| ahead(a).total_cmp(&ahead(b))).unwrap_or(0);
        let [right, down, forward] = FACES[face].map(|axis| ray.dot(axis));
        let half = 0.5 * faces[face].width() as f32;
        sample(&faces[face], Vec2::new(right, down) / forward * (half / HALF) + half)
    })
}

/// The bilinear interpolation of an image at a place inside, px.
fn sample(image: &Image, at: Vec2) -> [f32; 3] {
    let last = Vec2::new(image.width() as f32 - 1.0, image.height() as f32 - 1.0);
    let at = (at - 0.5).clamp(Vec2::ZERO, last);
    let (low, share) = (at.floor().as_uvec2(), at.fract());
    let high = (low + 1).min(last.as_uvec2());
    let pixel = |x, y| Vec3::from(image.pixel(x, y));
    let row = |y| pixel(low.x, y).lerp(pixel(high.x, y), share.x);
    row(low.y).lerp(row(high.y), share.y).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Faces that show the direction of each pixel join into a picture that does.
    #[test]
    fn faces_join_without_seams() {
        let camera = Camera::looking_forward(8, 8, 1.0);
        let cameras = cameras(&camera, 128);
        let face = |camera: &Camera| {
            Image::from_fn(camera.width, camera.height, |x, y| {
                let ray = (Vec2::new(x as f32, y as f32) + 0.5 - camera.center) / camera.focal;
                (camera.rotation.transpose() * ray.extend(1.0)).normalize().to_array()
            })
        };
        let faces: Vec<Image> = cameras.iter().map(|camera| face(camera).unwrap()).collect();
        let picture = join(&faces, 128, 64).unwrap();
        for (x, y, expected) in [(64, 32, Vec3::Z), (96, 32, Vec3::X), (0, 32, Vec3::NEG_Z), (64, 0, Vec3::NEG_Y)] {
            let found = Vec3::from(picture.pixel(x, y));
            assert!(found.distance(expected) < 0.04, "{x}, {y}: {found}");
        }
        for (x, y) in (0..64).flat_map(|y| (0..128).map(move |x| (x, y))) {
            // Neighbours are 0.05 apart at most, across the edges of faces, too.
            let of = |x, y| Vec3::from(picture.pixel(x, y));
            assert!((of(x, y).length() - 1.0).abs() < 1e-3);
            assert!(of(x, y).distance(of((x + 1) % 128, y)) < 0.052, "{x}, {y}");
            assert!(y == 63 || of(x, y).distance(of(x, y + 1)) < 0.052, "{x}, {y}");
        }
    }
}
