//! Points on the surfaces of a scene, found in its images: a plane sweep for data sets with few
//! points of a reconstruction, or none.
//!
//! A pixel of a view is projected at many depths into neighbouring views. At the right depth its
//! surroundings look the same there. *Source:* Collins 1996, A space-sweep approach to true
//! multi-image matching; the score is the normalized cross-correlation of patches.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use glam::{IVec3, Vec2, Vec3};
use gs_core::{Camera, Image};
use gs_io::dataset::{Point, PosedImage};
use rayon::prelude::*;

use crate::error::Error;
use crate::views::{Focus, PosedView, extent_of, possible, reduced, reduced_camera};

/// Largest number of views that are searched, evenly spread; they are kept in memory.
const MOST_VIEWS: usize = 128;

/// Longest side of the images that are searched, px.
const SIDE: u32 = 320;

/// Number of pixels that are swept, over all views, at most.
const MOST_PIXELS: usize = 100_000;

/// Least and largest number of depths of a sweep, even in 1/depth: those that are a pixel apart in
/// the neighbours, as far as possible.
const DEPTHS: [f32; 2] = [64.0, 256.0];

/// Farthest depth of a sweep, in units of the distance to the scene.
const FARTHEST: f32 = 20.0;

/// Nearest depth of a sweep of cameras around an object, in the same unit.
const NEAREST_AROUND: f32 = 0.4;

/// Nearest depth of a sweep of other cameras, in the same unit.
const NEAREST_WITHIN: f32 = 0.2;

/// Number of neighbouring views that a view is compared with.
const NEIGHBOURS: usize = 6;

/// The score is the mean correlation with the neighbours that agree best, at most this many. The
/// others may not see the surface.
const AGREEING: usize = 3;

/// The best angle between the rays of two views, rad: large enough for a precise depth, small
/// enough for surfaces to look the same.
const BEST_ANGLE: f32 = 0.17;

/// Least cosine of the angle between the axes of neighbours.
const LEAST_COSINE: f32 = 0.7;

/// Pixels from the centre to the edge of a patch.
const RADIUS: i32 = 2;

/// Pixels of a row or column of a patch.
const PATCH_SIDE: usize = 2 * RADIUS as usize + 1;

/// Pixels of a patch.
const PATCH: usize = PATCH_SIDE * PATCH_SIDE;

/// The rows or columns of a patch, from its centre.
const STEPS: [i32; PATCH_SIDE] = [-2, -1, 0, 1, 2];

/// Least standard deviation of luma in a patch that can be recognized.
const LEAST_CONTRAST: f32 = 0.02;

/// Least correlation of a surface.
const LEAST_SCORE: f32 = 0.8;

/// The least by which the score of a surface exceeds that at other depths.
const LEAST_LEAD: f32 = 0.04;

/// Depths on each side of the best that are not other depths.
const SAME_DEPTHS: usize = 4;

/// Least number of other swept pixels, at most two away, that lie on the same surface.
const LEAST_CONFIRMING: usize = 1;

/// Largest difference between ln-depths on one surface.
const SAME_SURFACE: f32 = 0.1;

/// Largest difference between the ln-depths of a pixel's point and of what another view shows there.
const SAME_POINT: f32 = 0.05;

/// Radius, as a share of the image's longer side, within which a pixel without contrast takes its
/// depth from pixels with a known one.
const FILL_RADIUS: f32 = 0.12;

/// Largest difference between the ln-depths of the four pixels from which a pixel without contrast
/// takes its depth. Background pixels next to a silhouette must not take the depth of the object.
const LEVEL: f32 = 0.15;

/// The points found, in the order of views and pixels; none where no two views overlap.
///
/// # Errors
/// Those of reading an image.
pub(crate) fn points(views: &[PosedView]) -> Result<Vec<Point>, Error> {
    let images = evenly(views).into_par_iter().map(SearchedImage::read).collect::<Result<Vec<_>, _>>()?;
    let count = images.len();
    let cameras: Vec<Camera> = images.iter().map(|image| image.camera).collect();
    let (distance, nearest) = match Focus::of(&cameras) {
        Some(focus) => (focus.distance, NEAREST_AROUND),
        None => (extent_of(&cameras, &[]), NEAREST_WITHIN),
    };
    let pixels: usize = images.iter().map(|image| image.solid.iter().filter(|&&solid| solid).count()).sum();
    let stride = ((pixels as f32 / MOST_PIXELS as f32).sqrt().ceil() as u32).max(1);
    let swept: Vec<Swept> =
        (0..count).into_par_iter().map(|index| sweep(&images, index, (distance, nearest), stride)).collect();
    let seen_twice = |index: usize| seen_twice(&images, &swept, index, 1.5 * stride as f32);
    let found: Vec<Vec<Found>> = (0..count)
        .into_par_iter()
        .map(|index| images[index].found(seen_twice(index), &swept[index].flat, stride))
        .collect();
    Ok(merged(found.into_iter().flatten()))
}

/// At most [`MOST_VIEWS`] of these views, evenly spread.
pub(crate) fn evenly(views: &[PosedView]) -> Vec<&PosedView> {
    let count = views.len().min(MOST_VIEWS);
    (0..count).map(|number| &views[number * views.len() / count]).collect()
}

/// Divisor of the sides of a camera's image for a search.
fn searched_factor(camera: &Camera) -> u32 {
    possible(camera, camera.width.max(camera.height).div_ceil(SIDE))
}

/// A view as it is searched.
pub(crate) struct SearchedImage {
    pub(crate) camera: Camera,
    pub(crate) pixels: Image,
    luma: Vec<f32>,
    /// Whether a pixel counts and is more opaque than not.
    pub(crate) solid: Vec<bool>,
}

/// A point, and half the distance between swept pixels at its depth, world units.
pub(crate) struct Found {
    pub(crate) point: Point,
    pub(crate) cell: f32,
}

impl SearchedImage {
    pub(crate) fn read(view: &PosedView) -> Result<Self, Error> {
        let camera = &view.camera;
        let factor = searched_factor(camera);
        let PosedImage { image, alpha, mask } = reduced(&view.image()?, factor)?;
        let luma = image.pixels().iter().map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect();
        let solid = (0..image.pixels().len())
            .map(|index| {
                alpha.as_ref().is_none_or(|alpha| alpha[index] > 0.5) && mask.as_ref().is_none_or(|mask| mask[index])
            })
            .collect();
        Ok(Self { camera: reduced_camera(camera, factor), pixels: image, luma, solid })
    }

    /// The direction of the pixel at `at`, px, as long as one unit of depth, world axes.
    pub(crate) fn ray(&self, at: Vec2) -> Vec3 {
        self.camera.rotation.transpose() * ((at - self.camera.center) / self.camera.focal).extend(1.0)
    }

    /// The patch around the pixel in column `x` and row `y`: luma minus its mean, divided by its
    /// norm. `None` where it leaves the image or has no contrast.
    fn patch(&self, x: u32, y: u32) -> Option<[f32; PATCH]> {
        let (width, height) = (self.camera.width as i32, self.camera.height as i32);
        let (x, y) = (x as i32, y as i32);
        let inside = |at: i32, size: i32| at >= RADIUS && at + RADIUS < size;
        if !inside(x, width) || !inside(y, height) {
            return None;
        }
        let mut patch = [0.0; PATCH];
        for (value, (dx, dy)) in patch.iter_mut().zip(offsets()) {
            *value = self.luma[((y + dy) * width + x + dx) as usize];
        }
        let mean = patch.iter().sum::<f32>() / PATCH as f32;
        patch.iter_mut().for_each(|value| *value -= mean);
        let norm = patch.iter().map(|value| value * value).sum::<f32>().sqrt();
        if norm < LEAST_CONTRAST * (PATCH as f32).sqrt() {
            return None;
        }
        patch.iter_mut().for_each(|value| *value /= norm);
        Some(patch)
    }

    /// The points at pixels with a known depth, and at those without contrast that such pixels surround.
    fn found(&self, known: Vec<(Vec2, f32)>, flat: &[Vec2], stride: u32) -> Vec<Found> {
        let reach = FILL_RADIUS * self.camera.width.max(self.camera.height) as f32;
        let filled: Vec<(Vec2, f32)> =
            flat.iter().filter_map(|&at| Some((at, depth_around(&known, at, reach)?))).collect();
        let cell = 0.5 * stride as f32 / self.camera.focal.max_element();
        let origin = self.camera.position();
        let found = |(at, depth): (Vec2, f32)| Found {
            point: Point {
                position: origin + depth * self.ray(at),
                color: self.pixels.pixel(at.x as u32, at.y as u32),
            },
            cell: cell * depth,
        };
        known.into_iter().chain(filled).map(found).collect()
    }

    /// Correlation of a patch with this image around `at`, where a pixel to the right is `right`
    /// and one below is `down`, px. `None` where it leaves the image.
    fn correlation(&self, patch: &[f32; PATCH], at: Vec2, right: Vec2, down: Vec2) -> Option<f32> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        // Pixel centres are at j + ½.
        let at = at - 0.5;
        let reach = RADIUS as f32 * (right.abs() + down.abs());
        let last = Vec2::new(width as f32 - 1.001, height as f32 - 1.001);
        if !((at - reach).cmpge(Vec2::ZERO).all() && (at + reach).cmple(last).all()) {
            return None;
        }
        let columns = STEPS.map(|dx| at + dx as f32 * right);
        let (mut sum, mut squares, mut product) = (0.0f32, 0.0f32, 0.0f32);
        for (references, dy) in patch.as_chunks::<PATCH_SIDE>().0.iter().zip(STEPS) {
            let below = dy as f32 * down;
            for (&reference, column) in references.iter().zip(columns) {
                let place = column + below;
                // i32 suffices for any image and converts fastest.
                let (x, y) = (place.x as i32, place.y as i32);
                let (u, v) = (place.x - x as f32, place.y - y as f32);
                let start = y as usize * width + x as usize;
                let rows = &self.luma[start..start + width + 2];
                let (top, bottom) =
                    (rows[0] + u * (rows[1] - rows[0]), rows[width] + u * (rows[width + 1] - rows[width]));
                let value = top + v * (bottom - top);
                sum += value;
                squares += value * value;
                product += reference * value;
            }
        }
        let variance = squares - sum * sum / PATCH as f32;
        let least = LEAST_CONTRAST * LEAST_CONTRAST * PATCH as f32;
        Some(if variance > 0.25 * least { product / variance.sqrt() } else { 0.0 })
    }
}

fn offsets() -> impl Iterator<Item = (i32, i32)> {
    STEPS.into_iter().flat_map(|dy| STEPS.into_iter().map(move |dx| (dx, dy)))
}

/// The views to compare view `index` with: those whose rays meet its own at about [`BEST_ANGLE`] in
/// this distance, among those that look in a similar direction.
pub(crate) fn neighbours(images: &[SearchedImage], index: usize, distance: f32) -> Vec<usize> {
    let camera = &images[index].camera;
    let axis = |camera: &Camera| camera.rotation.row(2);
    let mut others: Vec<(f32, usize)> = (0..images.len())
        .filter(|&other| other != index && axis(&images[other].camera).dot(axis(camera)) > LEAST_COSINE)
        .map(|other| (images[other].camera.position().distance(camera.position()) / distance, other))
        .filter(|&(angle, _)| angle > 0.02)
        .map(|(angle, other)| ((angle / BEST_ANGLE).ln().abs(), other))
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    others.into_iter().take(NEIGHBOURS).map(|(_, other)| other).collect()
}

/// The depths of a sweep, from far to near.
#[derive(Debug, Clone, Copy)]
struct Depths {
    count: usize,
    /// 1/depth of the first and the last.
    inverse: [f32; 2],
}

impl Depths {
    fn of(camera: &Camera, distance: f32, nearest: f32) -> Self {
        let inverse = [FARTHEST, nearest].map(|share| 1.0 / (share * distance).max(camera.near));
        // The disparity in a neighbour at the best angle, px.
        let disparity = camera.focal.max_element() * BEST_ANGLE * distance * (inverse[1] - inverse[0]);
        Self { count: disparity.clamp(DEPTHS[0], DEPTHS[1]) as usize, inverse }
    }

    fn at(self, step: f32) -> f32 {
        let share = step / (self.count - 1) as f32;
        1.0 / ((1.0 - share) * self.inverse[0] + share * self.inverse[1])
    }
}

/// A sweep for one pixel.
struct Pixel<'a> {
    image: &'a SearchedImage,
    neighbours: &'a [&'a SearchedImage],
    /// The directions of the pixel, of the one to its right and of the one below, as long as one
    /// unit of depth, world axes.
    rays: [Vec3; 3],
    patch: [f32; PATCH],
}

impl Pixel<'_> {
    /// How well the neighbours that see the point at this depth agree.
    fn score(&self, depth: f32) -> Score {
        let origin = self.image.camera.position();
        let [centre, right, below] = self.rays.map(|ray| origin + depth * ray);
        let mut best = [-1.0f32; AGREEING];
        let mut seeing = 0;
        for image in self.neighbours {
            let project = |world| image.camera.project(world).map(|(at, _)| at);
            let (Some(at), Some(right), Some(below)) = (project(centre), project(right), project(below)) else {
                continue;
            };
            let Some(mut score) = image.correlation(&self.patch, at, right - at, below - at) else { continue };
            seeing += 1;
            for kept in &mut best {
                if score > *kept {
                    std::mem::swap(kept, &mut score);
                }
            }
        }
        let agreeing = seeing.clamp(1, AGREEING);
        Score { seeing, mean: best[..agreeing].iter().sum::<f32>() / agreeing as f32 }
    }

    /// The depth at which the pixel looks the same in its neighbours, if there is a single one.
    ///
    /// Depths that at least [`AGREEING`] neighbours see are tried first. If none of them counts, those
    /// that fewer neighbours see are tried: few other views see a surface near the border of an image.
    fn depth(&self, depths: Depths) -> Option<f32> {
        let scores: Vec<Score> = (0..depths.count).map(|step| self.score(depths.at(step as f32))).collect();
        (1..=AGREEING).rev().find_map(|least| self.single_depth(depths, &scores, least))
    }

    /// The depth at which the pixel looks the same in its neighbours, among those that at least `least`
    /// of them see; `None` if there is no single one.
    fn single_depth(&self, depths: Depths, scores: &[Score], least: usize) -> Option<f32> {
        let best =
            (0..depths.count).max_by(|&a, &b| scores[a].if_seen_by(least).total_cmp(&scores[b].if_seen_by(least)))?;
        // Half steps and quarters around the best depth.
        let (mut place, mut score) = (best as f32, scores[best].if_seen_by(least));
        for width in [0.5, 0.25, 0.125] {
            for other in [place - width, place + width] {
                let found = self.score(depths.at(other)).if_seen_by(least);
                if found > score {
                    (place, score) = (other, found);
                }
            }
        }
        let elsewhere = (0..depths.count).filter(|step| step.abs_diff(best) > SAME_DEPTHS);
        let unique = score - elsewhere.map(|step| scores[step].if_seen_by(least)).fold(-1.0, f32::max) >= LEAST_LEAD;
        (score >= LEAST_SCORE && unique && place > 0.0).then(|| depths.at(place))
    }
}

/// How well the surroundings of a pixel agree with its neighbours at one depth.
#[derive(Debug, Clone, Copy)]
struct Score {
    /// Number of neighbours whose image contains the patch at this depth.
    seeing: usize,
    /// Mean correlation with those that agree best, at most [`AGREEING`]; −1 without any.
    mean: f32,
}

impl Score {
    /// The mean, or −1 if fewer than `least` neighbours see the point.
    fn if_seen_by(self, least: usize) -> f32 {
        if self.seeing < least { -1.0 } else { self.mean }
    }
}

/// The swept pixels of one view, ordered by rows.
struct Swept {
    /// The views that it was compared with.
    neighbours: Vec<usize>,
    /// Pixels whose depth was found, and their depths.
    known: Vec<(Vec2, f32)>,
    /// Pixels without contrast.
    flat: Vec<Vec2>,
}

/// Sweeps every `stride`-th pixel of one view.
fn sweep(images: &[SearchedImage], index: usize, (distance, nearest): (f32, f32), stride: u32) -> Swept {
    let image = &images[index];
    let chosen = neighbours(images, index, distance);
    let neighbours: Vec<&SearchedImage> = chosen.iter().map(|&other| &images[other]).collect();
    let depths = Depths::of(&image.camera, distance, nearest);
    let (width, height) = image.pixels.size();
    let (mut known, mut flat): (Vec<(Vec2, f32)>, Vec<Vec2>) = (Vec::new(), Vec::new());
    let first = stride / 2;
    for y in (first..height).step_by(stride as usize) {
        for x in (first..width).step_by(stride as usize) {
            if !image.solid[(y * width + x) as usize] {
                continue;
            }
            let at = Vec2::new(x as f32, y as f32) + 0.5;
            match image.patch(x, y) {
                Some(patch) => {
                    let rays = [Vec2::ZERO, Vec2::X, Vec2::Y].map(|offset| image.ray(at + offset));
                    let pixel = Pixel { image, neighbours: &neighbours, rays, patch };
                    known.extend(pixel.depth(depths).map(|depth| (at, depth)));
                }
                None => flat.push(at),
            }
        }
    }
    Swept { known: confirmed(&known, 2.0 * stride as f32), flat, neighbours: chosen }
}

/// The pixels of one view whose points a neighbouring view also finds: a pixel within `reach` px of
/// the projected point has about the same depth.
fn seen_twice(images: &[SearchedImage], swept: &[Swept], index: usize, reach: f32) -> Vec<(Vec2, f32)> {
    let image = &images[index];
    let is_seen = |&(at, depth): &(Vec2, f32)| {
        let point = image.camera.position() + depth * image.ray(at);
        swept[index].neighbours.iter().any(|&other| {
            let Some((place, expected)) = images[other].camera.project(point) else { return false };
            around(&swept[other].known, place, reach).any(|(_, found)| (found / expected).ln().abs() < SAME_POINT)
        })
    };
    swept[index].known.iter().copied().filter(is_seen).collect()
}

/// The pixels whose depth at least [`LEAST_CONFIRMING`] others within `reach`, px, have, too. The
/// pixels are ordered by rows.
fn confirmed(known: &[(Vec2, f32)], reach: f32) -> Vec<(Vec2, f32)> {
    let agree = |&(at, depth): &(Vec2, f32)| {
        let others = around(known, at, reach).filter(|(_, other)| (other / depth).ln().abs() < SAME_SURFACE);
        others.count() > LEAST_CONFIRMING
    };
    known.iter().copied().filter(agree).collect()
}

/// The pixels, ordered by rows, that are within `reach` of `at` in both directions, px.
fn around(known: &[(Vec2, f32)], at: Vec2, reach: f32) -> impl Iterator<Item = &(Vec2, f32)> {
    let first = known.partition_point(|(place, _)| place.y < at.y - reach);
    let end = known.partition_point(|(place, _)| place.y <= at.y + reach);
    known[first..end].iter().filter(move |(place, _)| (place.x - at.x).abs() <= reach)
}

/// The depth of a pixel without contrast, from the nearest pixel with a known depth in each of the
/// four 90-degree sectors around it (above, below, left, right). `None` unless all four are within
/// `reach`, px, and their depths agree: the larger of the two middle ones.
fn depth_around(known: &[(Vec2, f32)], at: Vec2, reach: f32) -> Option<f32> {
    let mut nearest = [(f32::INFINITY, 0.0); 4];
    for &(place, depth) in around(known, at, reach) {
        let offset = place - at;
        let sector = match offset.x.abs() > offset.y.abs() {
            true => usize::from(offset.x > 0.0),
            false => 2 + usize::from(offset.y > 0.0),
        };
        if offset.length_squared() < nearest[sector].0 {
            nearest[sector] = (offset.length_squared(), depth);
        }
    }
    if nearest.iter().any(|&(distance, _)| distance > reach * reach) {
        return None;
    }
    let mut depths = nearest.map(|(_, depth)| depth);
    depths.sort_by(f32::total_cmp);
    ((depths[3] / depths[0]).ln() < LEVEL).then(|| depths[2])
}

/// The points, of which those of one cell of a grid become one: views overlap.
pub(crate) fn merged(found: impl Iterator<Item = Found>) -> Vec<Point> {
    let found: Vec<Found> = found.collect();
    let mut cells: Vec<f32> = found.iter().map(|found| found.cell).collect();
    cells.sort_by(f32::total_cmp);
    let Some(&middle) = cells.get(cells.len() / 2) else { return Vec::new() };
    // Coarser cells where points are far away, by powers of two.
    averaged(found.into_iter().map(|Found { point, cell }| {
        let level = (cell / middle).log2().round() as i32;
        let place: IVec3 = (point.position / (middle * (level as f32).exp2())).floor().as_ivec3();
        ((level, place.to_array()), point)
    }))
}

/// The mean position and colour of the points of each cell, in the order of the cells.
pub(crate) fn averaged<C: Ord>(points: impl IntoIterator<Item = (C, Point)>) -> Vec<Point> {
    let mut cells: BTreeMap<C, (Vec3, Vec3, f32)> = BTreeMap::new();
    for (cell, point) in points {
        let sums = cells.entry(cell).or_insert((Vec3::ZERO, Vec3::ZERO, 0.0));
        sums.0 += point.position;
        sums.1 += Vec3::from_array(point.color);
        sums.2 += 1.0;
    }
    let mean = |(position, color, count): (Vec3, Vec3, f32)| Point {
        position: position / count,
        color: (color / count).to_array(),
    };
    cells.into_values().map(mean).collect()
}
