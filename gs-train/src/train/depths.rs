//! Points on the surfaces of a scene, from depth maps of its views.
//!
//! Depth maps of networks and of other reconstructions are depths or inverse depths, with an
//! unknown scale and shift for each image. Scale and shift are fitted to known points of the scene.
//! Without known points, only maps in world units are used, such as those of sensors. A point is
//! taken where another view's map has the same depth.

use glam::{Vec2, Vec3};
use gs_density::Rng;
use gs_io::dataset::{DepthMap, Point};
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::{
    geometry::{Focus, extent_of},
    sweep::{Found, Plate, evenly, merged, neighbours},
    views::PosedView,
};
use crate::error::Error;

/// Number of pixels that give points, over all views, at most: more first Gaussians make the first
/// steps slow, and growth finds what they lack.
const MOST_PIXELS: usize = 30_000;

/// Side of the cells of an image, px. Only the nearest known point of each cell is used, because
/// points behind a surface are not on the map.
const CELL: u32 = 6;

/// Least number of known points in a view that agree with its map.
const LEAST_AGREEING: f32 = 10.0;

/// Least share of the known points in a view that agree with its map.
const LEAST_SHARE: f32 = 0.3;

/// Largest difference of ln-depth at which a map agrees with a known point.
const SAME_POINT: f32 = 0.05;
/// Largest difference of ln-depth at which two maps agree.
const SAME_SURFACE: f32 = 0.03;

/// Largest variance of the difference of ln-depth between a map and the known points that agree
/// with it, as a share of the variance of the ln-depth of these points.
const MOST_UNEXPLAINED: f64 = 0.25;

/// Number of random pairs of known points from which scale and shift of a map are computed.
const TRIALS: u32 = 400;

/// Steps of least squares over the points that agree.
const REFINEMENTS: u32 = 4;

/// The points on the depth maps that another view confirms, in the order of views and pixels.
///
/// There are none if no two views overlap, if no map fits the `known` points, or if there are no
/// known points and no map is in world units.
///
/// # Errors
/// Those of reading an image or a depth map.
pub(super) fn points(views: &[PosedView], known: &[Point]) -> Result<Vec<Point>, Error> {
    let maps = evenly(views).into_par_iter().map(Relief::read).collect::<Result<Vec<_>, _>>()?;
    let reliefs = fitted(maps.into_iter().flatten().collect(), known);
    let (plates, depths): (Vec<Plate>, Vec<Vec<f32>>) = reliefs.into_iter().map(|r| (r.plate, r.values)).unzip();
    let cameras: Vec<_> = plates.iter().map(|plate| plate.camera).collect();
    let distance = Focus::of(&cameras).map_or_else(|| extent_of(&cameras, None), |focus| focus.distance);
    let pixels: usize = depths.iter().flatten().filter(|depth| **depth > 0.0).count();
    let stride = ((pixels as f32 / MOST_PIXELS as f32).sqrt().ceil() as usize).max(1);
    let found: Vec<Vec<Found>> = (0..plates.len())
        .into_par_iter()
        .map(|index| {
            let others: Vec<(&Plate, &[f32])> = neighbours(&plates, index, distance)
                .into_iter()
                .map(|other| (&plates[other], &depths[other][..]))
                .collect();
            confirmed(&plates[index], &depths[index], &others, stride)
        })
        .collect();
    Ok(merged(found.into_iter().flatten()))
}

/// A view with its map at the size of a [`Plate`].
struct Relief {
    plate: Plate,
    /// Values of the map, row-major; 0 where unknown.
    values: Vec<f32>,
    unit: Option<f32>,
}

impl Relief {
    /// Reads a view; `None` without a map.
    fn read(view: &PosedView) -> Result<Option<Self>, Error> {
        let Some(DepthMap { camera, values, unit }) = view.source.depth()? else { return Ok(None) };
        let plate = Plate::read(view)?;
        // Both cameras have the same pose and axis.
        let scale = camera.focal / plate.camera.focal;
        let value = |x: u32, y: u32| {
            let at = (Vec2::new(x as f32, y as f32) + 0.5 - plate.camera.center) * scale + camera.center;
            let inside = at.cmpge(Vec2::ZERO).all() && at.x < camera.width as f32 && at.y < camera.height as f32;
            if inside { values[at.y as usize * camera.width as usize + at.x as usize] } else { 0.0 }
        };
        let (width, height) = plate.image.size();
        let at = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let values = at.zip(&plate.solid).map(|((x, y), &solid)| if solid { value(x, y) } else { 0.0 }).collect();
        Ok(Some(Self { plate, values, unit }))
    }

    /// The map's values and the depths of the known points in sight.
    fn samples(&self, known: &[Point]) -> Vec<Sample> {
        let (width, height) = self.plate.image.size();
        let columns = width.div_ceil(CELL);
        let mut nearest: Vec<Option<Sample>> = vec![None; (columns * height.div_ceil(CELL)) as usize];
        for point in known {
            let Some((at, depth)) = self.plate.camera.project(point.position) else { continue };
            if !(at.cmpge(Vec2::ZERO).all() && at.x < width as f32 && at.y < height as f32) {
                continue;
            }
            let (x, y) = (at.x as u32, at.y as u32);
            let value = self.values[(y * width + x) as usize];
            let cell = &mut nearest[(y / CELL * columns + x / CELL) as usize];
            if value > 0.0 && cell.is_none_or(|other| depth < other.depth) {
                *cell = Some(Sample { value, depth });
            }
        }
        nearest.into_iter().flatten().collect()
    }

    /// This view with depths in place of the map's values; 0 where the fit gives no valid depth.
    fn with_depths(mut self, fit: Fit) -> Self {
        self.values.iter_mut().filter(|value| **value > 0.0).for_each(|value| {
            *value = Some(fit.depth(*value)).filter(|depth| *depth > 0.0 && depth.is_finite()).unwrap_or(0.0);
        });
        self
    }
}

/// A known point in a view: the map's value and the true depth there.
#[derive(Debug, Clone, Copy)]
struct Sample {
    value: f32,
    depth: f32,
}

/// What the values of a map mean.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Meaning {
    Depth,
    InverseDepth,
}

/// Depths from the values of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fit {
    meaning: Meaning,
    scale: f32,
    shift: f32,
}

impl Fit {
    fn depth(self, value: f32) -> f32 {
        let line = self.scale * value + self.shift;
        match self.meaning {
            Meaning::Depth => line,
            Meaning::InverseDepth => 1.0 / line,
        }
    }

    /// ln-depth of the fit minus the true ln-depth; NaN if the fit's depth is negative.
    fn difference(self, sample: &Sample) -> f32 {
        (self.depth(sample.value) / sample.depth).ln()
    }

    /// How well a sample agrees: 1 for an exact match, 0 for a difference of [`SAME_POINT`] or
    /// more.
    fn agreement(self, sample: &Sample) -> f32 {
        let share = self.difference(sample) / SAME_POINT;
        // `max` also turns NaN into 0.
        (1.0 - share * share).max(0.0)
    }

    /// Whether the depths of the agreeing samples vary much more than their differences from the
    /// fit. Without this check, any map would fit a surface at about one depth.
    fn explains(self, samples: &[Sample]) -> bool {
        let agreeing = || samples.iter().filter(|sample| self.agreement(sample) > 0.0);
        let variance = |of: &dyn Fn(&Sample) -> f32| {
            let (count, sum, squares) = agreeing().map(of).fold((0.0f32, 0.0f64, 0.0f64), |(n, s, q), value| {
                let value = f64::from(value);
                (n + 1.0, s + value, q + value * value)
            });
            let count = f64::from(count);
            squares / count - (sum / count) * (sum / count)
        };
        variance(&|sample| self.difference(sample)) <= MOST_UNEXPLAINED * variance(&|sample| sample.depth.ln())
    }

    /// The line through two samples; `None` unless it rises.
    fn through(meaning: Meaning, a: Sample, b: Sample) -> Option<Self> {
        let [p, q] = [a, b].map(|sample| match meaning {
            Meaning::Depth => sample.depth,
            Meaning::InverseDepth => 1.0 / sample.depth,
        });
        let scale = (p - q) / (a.value - b.value);
        (scale > 0.0 && scale.is_finite()).then_some(Self { meaning, scale, shift: p - scale * a.value })
    }

    /// The fit with the least squared relative differences from these samples.
    fn least_squares<'s>(meaning: Meaning, samples: impl Iterator<Item = &'s Sample>) -> Option<Self> {
        // (s·v + t)/y = 1 for each sample, with y the depth or its inverse.
        let (mut aa, mut ab, mut bb, mut a, mut b) = (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for sample in samples {
            let weight = match meaning {
                Meaning::Depth => 1.0 / f64::from(sample.depth),
                Meaning::InverseDepth => f64::from(sample.depth),
            };
            let value = f64::from(sample.value) * weight;
            aa += value * value;
            ab += value * weight;
            bb += weight * weight;
            a += value;
            b += weight;
        }
        let determinant = aa * bb - ab * ab;
        let (scale, shift) = ((a * bb - b * ab) / determinant, (aa * b - ab * a) / determinant);
        (scale > 0.0 && scale.is_finite()).then_some(Self { meaning, scale: scale as f32, shift: shift as f32 })
    }

    /// The fit with which the samples agree best, and the sum of their agreement. Random pairs are
    /// tried first (RANSAC; Fischler and Bolles 1981; with the score of Torr and Zisserman 2000),
    /// then least squares over the samples that agree.
    fn best(meaning: Meaning, samples: &[Sample]) -> Option<(Self, f32)> {
        let mut rng = Rng::seed_from_u64(samples.len() as u64);
        let mut pick = || samples[rng.random_range(0..samples.len())];
        let mut best: Option<(Self, f32)> = None;
        let keep = |best: &mut Option<(Self, f32)>, fit: Self| {
            let score = samples.iter().map(|sample| fit.agreement(sample)).sum::<f32>();
            if best.is_none_or(|(_, highest)| score > highest) {
                *best = Some((fit, score));
            }
        };
        for _ in 0..TRIALS {
            if let Some(fit) = Self::through(meaning, pick(), pick()) {
                keep(&mut best, fit);
            }
        }
        for _ in 0..REFINEMENTS {
            let (fit, _) = best?;
            let agreeing = samples.iter().filter(|sample| fit.agreement(sample) > 0.0);
            if let Some(refined) = Self::least_squares(meaning, agreeing) {
                keep(&mut best, refined);
            }
        }
        best
    }
}

/// The maps, converted to depths in world units. With known points, these are the maps that fit
/// them; without, the maps that are in world units already. All maps are read as depths or all as
/// inverse depths, whichever agrees better with the points.
fn fitted(maps: Vec<Relief>, known: &[Point]) -> Vec<Relief> {
    if known.is_empty() {
        let metric = |map: Relief| {
            let scale = map.unit?;
            Some(map.with_depths(Fit { meaning: Meaning::Depth, scale, shift: 0.0 }))
        };
        return maps.into_iter().filter_map(metric).collect();
    }
    let samples: Vec<Vec<Sample>> = maps.par_iter().map(|map| map.samples(known)).collect();
    let fit = |meaning: Meaning, samples: &[Sample]| {
        let enough = |score: f32| score >= LEAST_AGREEING && score >= LEAST_SHARE * samples.len() as f32;
        let (fit, score) = if enough(samples.len() as f32) { Fit::best(meaning, samples)? } else { return None };
        (enough(score) && fit.explains(samples)).then_some((fit, score))
    };
    let fits = |meaning: Meaning| -> Vec<_> { samples.par_iter().map(|samples| fit(meaning, samples)).collect() };
    let score = |fits: &[Option<(Fit, f32)>]| fits.iter().flatten().map(|(_, score)| score).sum::<f32>();
    let (depth, inverse) = (fits(Meaning::Depth), fits(Meaning::InverseDepth));
    let fits = if score(&depth) >= score(&inverse) { depth } else { inverse };
    maps.into_iter().zip(fits).filter_map(|(map, fit)| Some(map.with_depths(fit?.0))).collect()
}

/// The points at every `stride`-th pixel that other views confirm: at least one view has the same
/// depth there, and no more views than that see past the point.
fn confirmed(plate: &Plate, depths: &[f32], others: &[(&Plate, &[f32])], stride: usize) -> Vec<Found> {
    let (width, height) = (plate.image.width() as usize, plate.image.height() as usize);
    let cell = 0.5 * stride as f32 / plate.camera.focal.max_element();
    let origin = plate.camera.position();
    let mut found = Vec::new();
    for y in (stride / 2..height).step_by(stride) {
        for x in (stride / 2..width).step_by(stride) {
            let depth = depths[y * width + x];
            if !(depth > 0.0) {
                continue;
            }
            let position = origin + depth * plate.ray(Vec2::new(x as f32, y as f32) + 0.5);
            let differences = others.iter().filter_map(|(other, depths)| difference(position, other, depths));
            let (mut same, mut past) = (0, 0);
            for difference in differences {
                same += usize::from(difference.abs() < SAME_SURFACE);
                past += usize::from(difference < -SAME_SURFACE);
            }
            if same > 0 && same >= past {
                let color = plate.image.pixel(x as u32, y as u32);
                found.push(Found { point: Point { position, color }, cell: cell * depth });
            }
        }
    }
    found
}

/// ln-depth of a point in a view minus the ln-depth of the view's map; `None` if the point is
/// outside the image or the map's value is unknown.
fn difference(position: Vec3, plate: &Plate, depths: &[f32]) -> Option<f32> {
    let (at, depth) = plate.camera.project(position)?;
    let (width, height) = plate.image.size();
    let inside = at.cmpge(Vec2::ZERO).all() && at.x < width as f32 && at.y < height as f32;
    let known = inside.then(|| depths[at.y as usize * width as usize + at.x as usize])?;
    (known > 0.0).then(|| (depth / known).ln())
}

#[cfg(test)]
mod tests {
    use gs_core::{Camera, Image};
    use gs_io::dataset::PosedImage;

    use super::*;
    use crate::train::{Start, geometry::tests::looking_at, views::ImageSource};

    /// An image with a depth map.
    struct Mapped {
        posed: PosedImage,
        map: DepthMap,
    }

    impl ImageSource for Mapped {
        fn read(&self) -> Result<PosedImage, gs_io::Error> {
            Ok(self.posed.clone())
        }

        fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
            Ok(Some(self.map.clone()))
        }
    }

    /// Colour of the plane z = 0 at a position.
    fn color(at: Vec2) -> [f32; 3] {
        [0.5 + 0.3 * at.x.sin(), 0.5 + 0.3 * at.y.cos(), 0.25]
    }

    /// Views of the plane z = 0 from above, with maps of half their size. `value` computes a map's
    /// value from the number of the view, the pixel's column and its depth.
    fn views(unit: Option<f32>, value: impl Fn(usize, u32, f32) -> f32) -> Vec<PosedView> {
        (0..6)
            .map(|number| {
                let angle = number as f32;
                let from = Vec3::new(0.8 * angle.cos(), 0.8 * angle.sin(), 4.0 + 0.1 * angle);
                let camera = looking_at(from, Vec3::new(0.05, 0.02, 0.0), 40);
                let small = looking_at(from, Vec3::new(0.05, 0.02, 0.0), 20);
                let hit = |camera: &Camera, x: u32, y: u32| {
                    let at = Vec2::new(x as f32, y as f32) + 0.5;
                    let ray = camera.rotation.transpose() * ((at - camera.center) / camera.focal).extend(1.0);
                    let depth = -camera.position().z / ray.z;
                    (depth, (camera.position() + depth * ray).truncate())
                };
                let image = Image::from_fn(40, 40, |x, y| color(hit(&camera, x, y).1)).unwrap();
                let pixels = (0..20).flat_map(|y| (0..20).map(move |x| (x, y)));
                let values = pixels.map(|(x, y)| value(number, x, hit(&small, x, y).0)).collect();
                let source = Mapped {
                    posed: PosedImage { image, alpha: None, mask: None },
                    map: DepthMap { camera: small, values, unit },
                };
                PosedView { name: format!("{number}"), camera, source: Box::new(source) }
            })
            .collect()
    }

    /// Points of the plane, and a third as many behind it, which the views do not see.
    fn known() -> Vec<Point> {
        let at = |x: i32, y: i32, z: f32| Point { position: Vec3::new(x as f32, y as f32, z) * 0.15, color: [0.5; 3] };
        let plane = (-9..9).flat_map(|y| (-9..9).map(move |x| at(x, y, 0.0)));
        plane.chain((-9..9).flat_map(|y| (-3..3).map(move |x| at(3 * x, y, -9.0)))).collect()
    }

    /// Share of the points that lie on the plane and have its colour.
    fn right(points: &[Point]) -> f32 {
        let is_right = |point: &&Point| {
            let expected = Vec3::from_array(color(point.position.truncate()));
            point.position.z.abs() < 0.1 && Vec3::from_array(point.color).distance(expected) < 0.1
        };
        points.iter().filter(is_right).count() as f32 / points.len() as f32
    }

    #[test]
    fn maps_up_to_scale_and_shift_are_fitted_to_known_points() {
        let (scale, shift) = (|number: usize| 0.5 + number as f32, |number: usize| 0.1 * number as f32 - 0.2);
        let depths = views(None, |number, _, depth| scale(number) * depth + shift(number));
        let inverses = views(None, |number, _, depth| scale(number) / depth - 0.1 * shift(number));
        for views in [depths, inverses] {
            let found = points(&views, &known()).unwrap();
            assert!(found.len() > 300 && right(&found) > 0.99, "{} of {}", right(&found), found.len());
            assert_eq!(points(&views, &[]).unwrap().len(), 0, "the scale is not known");
        }
    }

    #[test]
    fn maps_in_world_units_need_no_points() {
        let millimetres = views(Some(1e-3), |_, _, depth| 1000.0 * depth);
        let found = points(&millimetres, &[]).unwrap();
        assert!(found.len() > 300 && right(&found) > 0.99, "{} of {}", right(&found), found.len());
        match Start::Depths(Vec::new()).searched(&millimetres).unwrap() {
            Start::Points(points) => assert_eq!(points, found),
            other => panic!("{other:?}"),
        }
        match Start::Depths(known()).searched(&millimetres).unwrap() {
            Start::Points(points) => assert!(points.starts_with(&known()) && points.len() > known().len() + 300),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_no_other_view_confirms_is_left_out() {
        // Half of each map is wrong, in another way in each view.
        let found = points(
            &views(Some(1.0), |number, x, depth| if x < 10 { depth * (0.4 + 0.08 * number as f32) } else { depth }),
            &[],
        );
        let found = found.unwrap();
        assert!(found.len() > 100 && right(&found) > 0.95, "{} of {}", right(&found), found.len());
        let noise = |number: usize, x: u32, _: f32| 1.0 + ((x * 7919 + number as u32 * 31) % 97) as f32;
        assert_eq!(points(&views(None, noise), &known()).unwrap().len(), 0, "it fits no line");
        let mut single = views(Some(1.0), |_, _, depth| depth);
        single.truncate(1);
        assert_eq!(points(&single, &[]).unwrap().len(), 0);
    }
}
