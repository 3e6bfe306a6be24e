//! The lens of the photographs: COLMAP's SIMPLE_RADIAL.

use glam::{UVec2, Vec2, vec2};
use gs_core::{Camera, Image};
use rayon::prelude::*;

/// A lens with d = p · (1 + k |p|²), where p and d are the points without and with distortion, in
/// focal lengths from the middle of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RadialLens {
    /// Size of the photograph, px.
    pub(super) size: UVec2,
    /// Focal length, px.
    pub(super) focal: f32,
    /// Distortion k.
    pub(super) k: f32,
}

impl RadialLens {
    /// A lens with a field of view of about `fov_x` rad, and a drone's slight distortion.
    pub(super) fn wide(size: UVec2, fov_x: f32) -> Self {
        Self { size, focal: 0.5 * size.x as f32 / (0.5 * fov_x).tan(), k: -0.03 }
    }

    /// The point without distortion, by Newton's method.
    fn undistorted(&self, d: Vec2) -> Vec2 {
        let wanted = d.length();
        let mut r = wanted;
        for _ in 0..6 {
            r -= (r + self.k * r.powi(3) - wanted) / (1.0 + 3.0 * self.k * r * r);
        }
        if wanted > 0.0 { d * (r / wanted) } else { d }
    }

    /// The pinhole camera at the origin that sees all that the lens sees, as sharply.
    pub(super) fn pinhole(&self) -> Camera {
        let half = 0.5 * self.size.as_vec2();
        let size = (self.undistorted(half / self.focal) * self.focal * 2.0).ceil().as_uvec2() + 2;
        let camera = Camera::looking_forward(size.x, size.y, 1.0);
        Camera { focal: Vec2::splat(self.focal), ..camera }
    }

    /// The photograph, from the picture of [`Self::pinhole`].
    pub(super) fn photograph(&self, seen: &Image) -> Image {
        let middle = 0.5 * self.size.as_vec2();
        let from = 0.5 * vec2(seen.width() as f32, seen.height() as f32);
        let mut pixels = vec![[0.0; 3]; (self.size.x * self.size.y) as usize];
        pixels.par_chunks_mut(self.size.x as usize).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let d = (vec2(x as f32, y as f32) + 0.5 - middle) / self.focal;
                *pixel = between(seen, from + self.undistorted(d) * self.focal - 0.5);
            }
        });
        Image::from_pixels(self.size.x, self.size.y, pixels).expect("as many pixels as the size says")
    }
}

/// Interpolates between the four pixels around a point that is given in pixels from the middle of
/// the first.
fn between(image: &Image, place: Vec2) -> [f32; 3] {
    let last = UVec2::new(image.width(), image.height()) - 1;
    let corner = place.floor().max(Vec2::ZERO).as_uvec2().min(last);
    let next = (corner + 1).min(last);
    let t = (place - corner.as_vec2()).clamp(Vec2::ZERO, Vec2::ONE);
    let [a, b] = [corner.y, next.y].map(|y| [image.pixel(corner.x, y), image.pixel(next.x, y)]);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    std::array::from_fn(|c| mix(mix(a[0][c], a[1][c], t.x), mix(b[0][c], b[1][c], t.x), t.y))
}

#[cfg(test)]
mod tests {
    #[test]
    fn distortion_is_undone() {
        use super::*;

        let lens = RadialLens::wide(UVec2::new(400, 300), 1.27);
        for p in [Vec2::ZERO, vec2(0.3, -0.2), vec2(0.74, 0.55)] {
            let d = p * (1.0 + lens.k * p.length_squared());
            assert!(lens.undistorted(d).abs_diff_eq(p, 1e-5), "{p}");
        }
    }

    #[test]
    fn without_distortion_the_photograph_is_the_middle_of_the_picture() {
        use super::*;

        let lens = RadialLens { k: 0.0, ..RadialLens::wide(UVec2::new(8, 6), 1.0) };
        let camera = lens.pinhole();
        let seen = Image::from_fn(camera.width, camera.height, |x, y| [x as f32, y as f32, 1.0]).unwrap();
        let photograph = lens.photograph(&seen);
        let border = 0.5 * vec2((camera.width - 8) as f32, (camera.height - 6) as f32);
        for (x, y) in [(0, 0), (7, 5), (3, 2)] {
            let [red, green, _] = photograph.pixel(x, y);
            assert!((vec2(red, green) - vec2(x as f32, y as f32) - border).abs().max_element() < 1e-3);
        }
    }
}
