//! Tests of the plane sweep: what it finds on a plane, seen from six sides.

use super::*;
use crate::{start::init::Start, views::geometry::tests::looking_at};

/// Views of the plane z = 0, whose colour is a function of the place, from six sides above it.
fn views_of_plane(color: impl Fn(Vec2) -> [f32; 3]) -> Vec<PosedView> {
    (0..6)
        .map(|number| {
            let angle = number as f32;
            let from = Vec3::new(0.8 * angle.cos(), 0.8 * angle.sin(), 4.0);
            let camera = looking_at(from, Vec3::new(0.05, 0.02, 0.0), 32);
            let image = Image::from_fn(32, 32, |x, y| {
                let at = Vec2::new(x as f32, y as f32) + 0.5;
                let ray = camera.rotation.transpose() * ((at - camera.center) / camera.focal).extend(1.0);
                let hit = camera.position() - ray * (camera.position().z / ray.z);
                color(hit.truncate())
            });
            PosedView::of_image(format!("{number}"), camera, image.unwrap())
        })
        .collect()
}

/// Waves of several lengths and directions, which no shift repeats within an image.
fn waves(at: Vec2) -> [f32; 3] {
    let wave = |x: f32, y: f32| (at.dot(Vec2::new(x, y))).sin();
    let value = wave(4.5, 1.0) + wave(-2.1, 5.7) + wave(9.0, -3.4) + wave(1.7, 11.6);
    [0.5 + 0.12 * value, 0.5 + 0.1 * wave(3.0, 1.0), 0.25]
}

#[test]
fn points_lie_on_the_surface_and_have_its_colour() {
    let found = points(&views_of_plane(waves)).unwrap();
    assert!(found.len() > 300, "{}", found.len());
    let on_plane = |point: &&Point| point.position.z.abs() < 0.1;
    let right = found.iter().filter(on_plane).count();
    assert!(right as f32 > 0.9 * found.len() as f32, "{right} of {}", found.len());
    let differs = |point: &&Point| {
        let expected = waves(point.position.truncate());
        on_plane(point) && (0..3).any(|k| (point.color[k] - expected[k]).abs() > 0.12)
    };
    let wrong = found.iter().filter(differs).count();
    assert!(wrong < found.len() / 50, "{wrong} of {}", found.len());
}

#[test]
fn pixels_without_contrast_take_the_depth_of_those_around_them() {
    let color = |at: Vec2| if at.length() < 0.4 { [0.5; 3] } else { waves(at) };
    let found = points(&views_of_plane(color)).unwrap();
    let inside = found.iter().filter(|point| point.position.truncate().length() < 0.2).count();
    assert!(inside > 0);
}

#[test]
fn pixels_without_contrast_beside_a_surface_have_no_depth() {
    let color = |at: Vec2| if at.x > 0.1 { [0.5; 3] } else { waves(at) };
    let found = points(&views_of_plane(color)).unwrap();
    let beside = found.iter().filter(|point| point.position.x > 0.5).count();
    assert!(found.len() > 1000 && beside < 5, "{beside} of {}", found.len());
}

#[test]
fn a_single_neighbour_is_enough() {
    let mut two = views_of_plane(waves);
    two.truncate(2);
    let found = points(&two).unwrap();
    let right = found.iter().filter(|point| point.position.z.abs() < 0.1).count();
    assert!(right > 100 && right as f32 > 0.8 * found.len() as f32, "{right} of {}", found.len());
}

#[test]
fn depths_that_enough_neighbours_see_are_preferred() {
    let image = SearchedImage::read(&views_of_plane(waves)[0]).unwrap();
    let patch = image.patch(16, 16).unwrap();
    // Without neighbours, no depth between these is better.
    let pixel = Pixel { image: &image, neighbours: &[], rays: [Vec3::Z; 3], patch };
    let depths = Depths { count: 64, inverse: [0.05, 1.0] };
    let mut scores = vec![Score { seeing: 3, mean: 0.0 }; 64];
    scores[10].mean = 0.85;
    scores[40] = Score { seeing: 1, mean: 0.99 };
    let found = [3, 2, 1].map(|least| pixel.single_depth(depths, &scores, least));
    assert_eq!(found, [Some(depths.at(10.0)), Some(depths.at(10.0)), Some(depths.at(40.0))]);
    scores[20].mean = 0.83;
    assert_eq!(pixel.single_depth(depths, &scores, 3), None, "two depths");
    scores[10].mean = 0.5;
    scores[20].mean = 0.79;
    assert_eq!(pixel.single_depth(depths, &scores, 3), None, "a low score");
}

#[test]
fn points_that_a_single_view_finds_do_not_count() {
    let images: Vec<SearchedImage> =
        views_of_plane(waves).iter().map(|view| SearchedImage::read(view).unwrap()).collect();
    let cameras: Vec<Camera> = images.iter().map(|image| image.camera).collect();
    let distance = Focus::of(&cameras).unwrap().distance;
    let mut swept: Vec<Swept> = (0..6).map(|index| sweep(&images, index, (distance, NEAREST_AROUND), 1)).collect();
    let (known, seen) = (swept[0].known.len(), seen_twice(&images, &swept, 0, 1.5).len());
    assert!(known > 50 && seen as f32 > 0.9 * known as f32, "{seen} of {known}");
    // Other views do not find points at other depths.
    swept[0].known.iter_mut().for_each(|(_, depth)| *depth *= 1.2);
    let seen = seen_twice(&images, &swept, 0, 1.5).len();
    assert!(seen < known / 20, "{seen} of {known}");
}

#[test]
fn known_points_are_joined_by_those_of_the_images() {
    let known = vec![Point { position: Vec3::Y, color: [0.5; 3] }];
    let views = views_of_plane(waves);
    let Start::Points(both) = Start::PointsAndImages(known.clone()).searched(&views).unwrap() else {
        panic!("no points")
    };
    assert_eq!((both[0], both.len()), (known[0], 1 + points(&views).unwrap().len()));
}

#[test]
fn nothing_is_found_without_contrast_or_neighbours() {
    assert_eq!(points(&views_of_plane(|_| [0.5; 3])).unwrap().len(), 0);
    let mut single = views_of_plane(waves);
    single.truncate(1);
    assert_eq!(points(&single).unwrap().len(), 0);
    assert_eq!(Start::Images.searched(&single).unwrap(), Start::Random);
    assert!(matches!(Start::Images.searched(&views_of_plane(waves)).unwrap(), Start::Points(_)));
}
