//! Differences between the colours of neighbouring images, in which the colours of a scene have no part.
//!
//! A pixel of a view is taken to the nearest other views by the depths of the scene, and compared with their
//! images there. What a scene has learned about colours therefore does not matter, and corrections neither.
//! Near views differ little in what changes along the path of a camera: reflections, shade, and an exposure that
//! follows the light slowly. A scene shows such changes by its SH, as views between those of the training do,
//! and a correction would take them out.

use glam::{Vec2, Vec3};
use gs_core::Camera;
use rayon::prelude::*;

use crate::views::ColorPair;

/// Number of other views that a pixel is compared with: the nearest that show its place, of the nearest at all.
const NEAREST: usize = 4;
const AT_MOST_FROM: usize = 128;

/// Largest difference of ln-depth at which two views show the same place.
const SAME_PLACE: f32 = 0.02;

/// Approximate number of pixels of a view that are compared.
const COMPARED: usize = 2_500;

/// A view at a small size.
#[derive(Debug)]
pub(super) struct SmallView {
    pub(super) camera: Camera,
    /// The divisor of the view's sides.
    pub(super) factor: u32,
    /// Colours of the pixels, row-major; NaN where a pixel is masked, not opaque, or clipped.
    pub(super) colors: Vec<[f32; 3]>,
}

/// Pairs of colours in the left and the right half of a view.
pub(super) type Halves = [Vec<ColorPair>; 2];

impl SmallView {
    /// The pixels of both halves that tell, with other colours at the same places where there are any.
    pub(super) fn pairs(&self, other: impl Fn(usize) -> Option<[f32; 3]>) -> Halves {
        let width = self.camera.width as usize;
        let mut halves = Halves::default();
        for (index, &color) in self.colors.iter().enumerate().filter(|(_, color)| !color[0].is_nan()) {
            if let Some(other) = other(index) {
                halves[usize::from(index % width >= width / 2)].push((other, color));
            }
        }
        halves
    }

    /// The world position at this depth in a pixel.
    fn position(&self, index: usize, depth: f32) -> Vec3 {
        let (Camera { focal, center, rotation, translation, width, .. }, index) = (&self.camera, index as u32);
        let at = Vec2::new((index % width) as f32, (index / width) as f32) + 0.5;
        rotation.transpose() * (depth * ((at - center) / focal).extend(1.0) - translation)
    }

    /// The colour of a world position, between the centres of four pixels; `None` where another place is in
    /// front by the `depths` of the scene, or where one of the pixels does not tell.
    fn color_of(&self, position: Vec3, depths: &[f32]) -> Option<[f32; 3]> {
        let (at, depth) = self.camera.project(position)?;
        let (width, corner) = (self.camera.width as usize, at - 0.5);
        let last = Vec2::new(self.camera.width as f32, self.camera.height as f32) - 1.0;
        if !(corner.cmpge(Vec2::ZERO).all() && corner.cmplt(last).all()) {
            return None;
        }
        // Also `None` where the depth is unknown.
        let is_same = (depths[at.y as usize * width + at.x as usize] / depth).ln().abs() <= SAME_PLACE;
        let first = corner.y as usize * width + corner.x as usize;
        let color = |index: usize| Vec3::from_array(self.colors[index]);
        let row = |first: usize| color(first).lerp(color(first + 1), corner.x.fract());
        let color = row(first).lerp(row(first + width), corner.y.fract());
        (is_same && color.is_finite()).then(|| color.to_array())
    }
}

/// For each view, its colours with the mean colours of the nearest other views at the same places. `depths` are
/// those of the scene in each view, row-major, 0 where unknown.
pub(super) fn pairs(views: &[SmallView], depths: &[Vec<f32>]) -> Vec<Halves> {
    let of_view = |(view, own): (&SmallView, &Vec<f32>)| {
        let from = view.camera.position();
        let distance = |other: &SmallView| other.camera.position().distance_squared(from);
        let mut others: Vec<_> = views.iter().zip(depths).filter(|(other, _)| !std::ptr::eq(*other, view)).collect();
        others.sort_by(|(a, _), (b, _)| distance(a).total_cmp(&distance(b)));
        others.truncate(AT_MOST_FROM);
        let every = (own.len() / COMPARED).max(1);
        view.pairs(|index| {
            let is_compared = index % every == 0 && own[index] > 0.0;
            let position = is_compared.then(|| view.position(index, own[index]))?;
            let colors = others.iter().filter_map(|(other, depths)| other.color_of(position, depths)).take(NEAREST);
            let (sum, count) =
                colors.fold((Vec3::ZERO, 0.0), |(sum, count), color| (sum + Vec3::from_array(color), count + 1.0));
            (count > 0.0).then(|| (sum / count).to_array())
        })
    };
    views.par_iter().zip(depths).map(of_view).collect()
}
