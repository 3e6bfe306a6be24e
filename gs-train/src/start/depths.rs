//! Points on the surfaces of a scene, from depth maps of its views.
//!
//! Depth maps of networks and of other reconstructions are depths or inverse depths, with an
//! unknown scale and shift for each image. Scale and shift are fitted to known points of the scene.
//! Without known points, only maps in world units are used, such as those of sensors. A point is
//! taken where another view's map has the same depth.

use glam::{Vec2, Vec3};
use gs_io::dataset::Point;
use rayon::prelude::*;

use super::sweep::{Found, SearchedImage, evenly, merged, neighbours};
use crate::error::Error;
use crate::views::{Fit, Focus, PosedView, Sample, extent_of, fits, samples, values_at};

/// Number of pixels that give points, over all views, at most: more first Gaussians make the first
/// steps slow, and growth finds what they lack.
const MOST_PIXELS: usize = 30_000;

/// Side of the cells of an image for [`samples`], px.
const CELL: u32 = 6;

/// Largest difference of ln-depth at which two maps agree.
const SAME_SURFACE: f32 = 0.03;

/// The points on the depth maps that another view confirms, in the order of views and pixels.
///
/// There are none if no two views overlap, if no map fits the `known` points, or if there are no
/// known points and no map is in world units.
///
/// # Errors
/// Those of reading an image or a depth map.
pub(crate) fn points(views: &[PosedView], known: &[Point]) -> Result<Vec<Point>, Error> {
    let maps = evenly(views).into_par_iter().map(Relief::read).collect::<Result<Vec<_>, _>>()?;
    let reliefs = fitted(maps.into_iter().flatten().collect(), known);
    let (images, depths): (Vec<SearchedImage>, Vec<Vec<f32>>) =
        reliefs.into_iter().map(|r| (r.image, r.values)).unzip();
    let cameras: Vec<_> = images.iter().map(|image| image.camera).collect();
    let distance = Focus::of(&cameras).map_or_else(|| extent_of(&cameras, &[]), |focus| focus.distance);
    let pixels: usize = depths.iter().flatten().filter(|depth| **depth > 0.0).count();
    let stride = ((pixels as f32 / MOST_PIXELS as f32).sqrt().ceil() as usize).max(1);
    let found: Vec<Vec<Found>> = (0..images.len())
        .into_par_iter()
        .map(|index| {
            let others: Vec<(&SearchedImage, &[f32])> = neighbours(&images, index, distance)
                .into_iter()
                .map(|other| (&images[other], &depths[other][..]))
                .collect();
            confirmed(&images[index], &depths[index], &others, stride)
        })
        .collect();
    Ok(merged(found.into_iter().flatten()))
}

/// A view with its map at the size of a [`SearchedImage`].
struct Relief {
    image: SearchedImage,
    /// Values of the map, row-major; 0 where unknown.
    values: Vec<f32>,
    unit: Option<f32>,
}

impl Relief {
    /// Reads a view; `None` without a map.
    fn read(view: &PosedView) -> Result<Option<Self>, Error> {
        let Some(map) = view.source.depth()? else { return Ok(None) };
        let image = SearchedImage::read(view)?;
        let at_pixels = values_at(&map, &image.camera).into_iter().zip(&image.solid);
        let values = at_pixels.map(|(value, &solid)| if solid { value } else { 0.0 }).collect();
        Ok(Some(Self { image, values, unit: map.unit }))
    }

    /// The map's values and the depths of the known points in sight.
    fn samples(&self, known: &[Point]) -> Vec<Sample> {
        samples(&self.image.camera, &self.values, CELL, known.iter().map(|point| point.position))
    }

    /// This view with depths in place of the map's values; 0 where the fit gives no valid depth.
    fn with_depths(mut self, fit: Fit) -> Self {
        self.values.iter_mut().filter(|value| **value > 0.0).for_each(|value| {
            *value = fit.known_depth(*value).unwrap_or(0.0);
        });
        self
    }
}

/// The maps, converted to depths in world units. With known points, these are the maps that fit
/// them; without, the maps that are in world units already.
fn fitted(maps: Vec<Relief>, known: &[Point]) -> Vec<Relief> {
    let fits = match known {
        [] => maps.iter().map(|map| map.unit.map(Fit::in_units)).collect(),
        known => fits(&maps.par_iter().map(|map| map.samples(known)).collect::<Vec<_>>()),
    };
    maps.into_iter().zip(fits).filter_map(|(map, fit)| Some(map.with_depths(fit?))).collect()
}

/// The points at every `stride`-th pixel that other views confirm: at least one view has the same
/// depth there, and no more views than that see past the point.
fn confirmed(image: &SearchedImage, depths: &[f32], others: &[(&SearchedImage, &[f32])], stride: usize) -> Vec<Found> {
    let (width, height) = (image.pixels.width() as usize, image.pixels.height() as usize);
    let cell = 0.5 * stride as f32 / image.camera.focal.max_element();
    let origin = image.camera.position();
    let mut found = Vec::new();
    for y in (stride / 2..height).step_by(stride) {
        for x in (stride / 2..width).step_by(stride) {
            let depth = depths[y * width + x];
            if !(depth > 0.0) {
                continue;
            }
            let position = origin + depth * image.ray(Vec2::new(x as f32, y as f32) + 0.5);
            let differences = others.iter().filter_map(|(other, depths)| difference(position, other, depths));
            let (mut same, mut past) = (0, 0);
            for difference in differences {
                same += usize::from(difference.abs() < SAME_SURFACE);
                past += usize::from(difference < -SAME_SURFACE);
            }
            if same > 0 && same >= past {
                let color = image.pixels.pixel(x as u32, y as u32);
                found.push(Found { point: Point { position, color }, cell: cell * depth });
            }
        }
    }
    found
}

/// ln-depth of a point in a view minus the ln-depth of the view's map; `None` if the point is
/// outside the image or the map's value is unknown.
fn difference(position: Vec3, image: &SearchedImage, depths: &[f32]) -> Option<f32> {
    let (at, depth) = image.camera.project(position)?;
    let (width, height) = image.pixels.size();
    let inside = at.cmpge(Vec2::ZERO).all() && at.x < width as f32 && at.y < height as f32;
    let known = inside.then(|| depths[at.y as usize * width as usize + at.x as usize])?;
    (known > 0.0).then(|| (depth / known).ln())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gs_core::{Camera, Image};
    use gs_io::dataset::{DepthMap, PosedImage};

    use super::*;
    use crate::{
        start::init::Start,
        views::{ImageSource, geometry::tests::looking_at},
    };

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
                PosedView { name: format!("{number}"), camera, source: Arc::new(source) }
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
    fn depths_unconfirmed_by_another_view_are_left_out() {
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
