//! Points far outside a scene, for sky and distant surfaces, in directions without known points.

use glam::{IVec3, Vec2, Vec3};
use gs_core::Camera;
use gs_io::dataset::Point;
use rayon::prelude::*;

use super::sweep::{SearchedImage, averaged, evenly};
use crate::error::Error;
use crate::views::PosedView;

/// Side of the cells of an image that are searched for points, as a share of its longer side.
const CELL: f32 = 0.06;

/// Radius of the shell, in units of the distance from the cameras' middle within which all cameras
/// and 95 % of the points lie.
const FAR: f32 = 2.0;

/// Largest distance of a point, world units, so that squares do not overflow.
const FARTHEST: f32 = 1e15;

/// Points on a sphere around the views, with the colours of the images.
///
/// They lie along the rays of those cells of the images that show no known point, neither in the
/// cell nor in the cells next to it. Points of several views in the same cell of directions are
/// averaged to one. Without known points there are none.
///
/// # Errors
/// Those of reading an image.
pub(crate) fn points(views: &[PosedView], known: &[Point]) -> Result<Vec<Point>, Error> {
    let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
    let middle = cameras.iter().map(|camera| camera.position()).sum::<Vec3>() / cameras.len().max(1) as f32;
    let mut distances: Vec<f32> = known.iter().map(|point| point.position.distance(middle)).collect();
    distances.retain(|distance| *distance < FARTHEST);
    distances.sort_by(f32::total_cmp);
    let Some(&most) = distances.get(distances.len() * 95 / 100) else { return Ok(Vec::new()) };
    let farthest = cameras.iter().map(|camera| camera.position().distance(middle)).fold(most, f32::max);
    let radius = FAR * farthest;
    let seen = evenly(views)
        .into_par_iter()
        .map(|view| Ok(beyond(&SearchedImage::read(view)?, known, middle, radius)))
        .collect::<Result<Vec<_>, Error>>()?;
    Ok(averaged(seen.into_iter().flatten().map(|(cell, point)| (cell.to_array(), point))))
}

/// The points of one view on the shell around `middle`, each with its cell of directions from
/// there.
fn beyond(image: &SearchedImage, known: &[Point], middle: Vec3, radius: f32) -> Vec<(IVec3, Point)> {
    let camera = &image.camera;
    let side = CELL * camera.width.max(camera.height) as f32;
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let (columns, rows) = ((size.x / side).ceil() as i32, (size.y / side).ceil() as i32);
    let inside = |x: i32, y: i32| (0..columns).contains(&x) && (0..rows).contains(&y);
    let mut empty = vec![true; (columns * rows) as usize];
    for (at, _) in known.iter().filter_map(|point| camera.project(point.position)) {
        let (column, row) = ((at.x / side).floor() as i32, (at.y / side).floor() as i32);
        let around =
            (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (column.saturating_add(dx), row.saturating_add(dy))));
        around.filter(|&(x, y)| inside(x, y)).for_each(|(x, y)| empty[(y * columns + x) as usize] = false);
    }
    let origin = camera.position() - middle;
    let step = side / camera.focal.max_element();
    let point = |(x, y): (i32, i32)| {
        let at = ((Vec2::new(x as f32, y as f32) + 0.5) * side).min(size - 0.5);
        let (column, row) = (at.x as u32, at.y as u32);
        let is_empty = empty[(y * columns + x) as usize] && image.solid[(row * camera.width + column) as usize];
        // Where the ray leaves the sphere, in which all cameras are.
        let ray = image.ray(at).normalize();
        let along = origin.dot(ray);
        let way = (along * along - origin.length_squared() + radius * radius).sqrt() - along;
        let offset = origin + way * ray;
        let usable = is_empty && offset.is_finite();
        let cell = (offset / (radius * step)).floor().as_ivec3();
        usable.then(|| (cell, Point { position: middle + offset, color: image.pixels.pixel(column, row) }))
    };
    (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).filter_map(point).collect()
}

#[cfg(test)]
mod tests {
    use gs_core::Image;

    use super::*;

    /// A view along z whose upper half is blue, and points on a plane at depth 4 in the lower half.
    fn scene() -> (PosedView, Vec<Point>) {
        let camera = Camera::looking_forward(100, 100, 1.0);
        let blue = |_, y: u32| if y < 50 { [0.1, 0.2, 0.9] } else { [0.5; 3] };
        let image = Image::from_fn(100, 100, blue).unwrap();
        let at = |x: i32, y: i32| Point { position: Vec3::new(x as f32, y as f32, 20.0) * 0.2, color: [0.5; 3] };
        let points = (0..30).flat_map(|y| (-30..30).map(move |x| at(x, y))).collect();
        (PosedView::of_image("only", camera, image), points)
    }

    #[test]
    fn cells_without_points_give_points_far_away() {
        let (view, known) = scene();
        let camera = view.camera;
        let mut distances: Vec<f32> = known.iter().map(|point| point.position.length()).collect();
        distances.sort_by(f32::total_cmp);
        let radius = FAR * distances[distances.len() * 95 / 100];
        let found = points(&[view], &known).unwrap();
        // 17 columns and 7 rows, up to that beside the points; some share a cell of directions.
        assert!((80..=17 * 7).contains(&found.len()), "{}", found.len());
        for point in &found {
            let (at, _) = camera.project(point.position).unwrap();
            let is_blue = Vec3::from_array(point.color).distance(Vec3::new(0.1, 0.2, 0.9)) < 1e-5;
            assert!(at.y < 50.0 && is_blue, "{at} {point:?}");
            assert!((point.position.length() / radius - 1.0).abs() < 0.02, "{point:?}");
        }
    }

    #[test]
    fn nothing_is_beyond_what_is_covered_or_unknown() {
        let (view, mut known) = scene();
        let mirrored = |point: &Point| Point { position: point.position * Vec3::new(1.0, -1.0, 1.0), ..*point };
        known.extend(known.clone().iter().map(mirrored));
        assert_eq!(points(&[view], &known).unwrap().len(), 0);
        assert_eq!(points(&[scene().0], &[]).unwrap().len(), 0);
    }
}
