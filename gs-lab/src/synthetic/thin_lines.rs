//! Lines thinner than the minimum scales of some guards allow, to measure what such a minimum
//! costs.

use glam::Vec2;
use gs_core::Image;

/// Direction of each line's normal, rad, and the line's position along it as a share of the image's
/// side.
const LINES: [(f32, f32); 5] = [(0.13, 0.3), (0.71, 0.45), (1.22, 0.6), (1.9, 0.38), (2.6, 0.55)];

/// Dark lines of one pixel's width on white, in several directions.
pub(super) fn thin_lines(side_px: u32) -> Result<Image, gs_core::Error> {
    let side = side_px as f32;
    Image::from_fn(side_px, side_px, |x, y| {
        let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let distance = |&(angle, at): &(f32, f32)| {
            let normal = Vec2::from_angle(angle);
            (normal.dot(place - 0.5 * side) - (at - 0.45) * side).abs()
        };
        let nearest = LINES.iter().map(distance).fold(f32::INFINITY, f32::min);
        [1.0 - 0.9 * (1.0 - nearest).clamp(0.0, 1.0); 3]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_thin() {
        let lines = thin_lines(64).unwrap();
        let dark = lines.pixels().iter().filter(|p| p[0] < 0.5).count();
        assert!((64..640).contains(&dark), "{dark}");
    }
}
