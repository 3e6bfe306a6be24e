//! The views that verify a search for the frontier.

use glam::Vec2;
use gs_core::{Camera, Canvas};

/// The canvas at half the size, and two parts of it at twice the size: other grids of pixels.
pub(super) fn unseen_canvases(canvas: Canvas) -> Vec<Canvas> {
    let Canvas { width, height, origin, extent } = canvas;
    let part = |at: Vec2| canvas.showing(origin + at * extent, 0.5 * extent);
    let half = canvas.resized(width.div_ceil(2), height.div_ceil(2));
    vec![half, part(Vec2::splat(0.25)), part(Vec2::new(0.47, 0.03))]
}

/// Every second camera, beginning with the first, for the search, and the others to verify its
/// results. A single camera is verified at half its size, which has other pixels.
pub(super) fn unseen_cameras(all: &[Camera]) -> (Vec<Camera>, Vec<Camera>) {
    let every_second = |first: usize| all.iter().copied().skip(first).step_by(2).collect::<Vec<_>>();
    let (views, mut unseen) = (every_second(0), every_second(1));
    if let (Some(only), true) = (views.first(), unseen.is_empty()) {
        unseen.push(only.resized(only.width.div_ceil(2), only.height.div_ceil(2)));
    }
    (views, unseen)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_view_is_for_both_the_search_and_its_verification() {
        let camera = |width| Camera::looking_forward(width, 9, 1.0);
        let widths = |cameras: &[Camera]| cameras.iter().map(|camera| camera.width).collect::<Vec<_>>();
        let split = |all: &[Camera]| {
            let (views, unseen) = unseen_cameras(all);
            (widths(&views), widths(&unseen))
        };
        assert_eq!(split(&[camera(8), camera(10), camera(12)]), (vec![8, 12], vec![10]));
        assert_eq!(split(&[camera(8)]), (vec![8], vec![4]));
        assert_eq!(split(&[]), (vec![], vec![]));
        let canvas = Canvas::new(9, 7);
        assert!(unseen_canvases(canvas).iter().all(|other| *other != canvas && other.validate().is_ok()));
    }
}
