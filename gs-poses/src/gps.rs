//! Scale and directions by the GPS positions of photographs.

use glam::{DMat3, DQuat, DVec3, dvec3};
use gs_core::{math::similarity::Similarity, metrics::median};
use serde::{Deserialize, Serialize};

use crate::model::Registered;

/// Likely error of a position, m.
const ERROR: f64 = 5.0;

/// Positions within this many times [`ERROR`] fit.
const FITS: f64 = 3.0;

/// Steps from a tolerance that takes all positions to one of [`ERROR`].
const STEPS: i32 = 20;

/// Radius of the Earth at the equator, m, and the square of its eccentricity (WGS 84).
const EARTH: (f64, f64) = (6_378_137.0, 0.006_694_379_990_14);

/// A position: latitude and longitude, billionths of a degree, and altitude, mm.
pub(crate) type Position = [i64; 3];

/// What GPS positions say about a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gps {
    /// Number of photographs with a pose and a position.
    pub positions: usize,
    /// Number of those whose position fits the others.
    pub fitting: usize,
    /// Median distance of these positions from the cameras, m.
    pub residual_m: f64,
}

/// How a model is turned and scaled: afterwards, a unit is a metre, x is east, −y is up and z is north.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Alignment {
    pub(crate) rotation: DQuat,
    pub(crate) scale: f64,
    pub(crate) gps: Gps,
}

/// A camera's centre in the model, its position on Earth (east, down, north, m), and how far that is trusted.
#[derive(Debug, Clone, Copy)]
struct Pair {
    camera: DVec3,
    position: DVec3,
    weight: f64,
}

/// The alignment of a model whose −y is up with the positions; `None` where these are too few, too close to each
/// other for their error, or contradict each other.
pub(crate) fn align(images: &[Registered], position: impl Fn(&str) -> Option<Position>) -> Option<Alignment> {
    let of = |image: &Registered| Some((-(image.rotation.inverse() * image.translation), position(&image.name)?));
    let found: Vec<(DVec3, Position)> = images.iter().filter_map(of).collect();
    let middle = median(found.iter().map(|(_, [latitude, ..])| *latitude as f64));
    let first = found.first()?.1;
    let pair = |(camera, place): &(DVec3, Position)| Pair {
        camera: *camera,
        position: metres(*place, first, middle),
        weight: 1.0,
    };
    let mut pairs: Vec<Pair> = found.iter().map(pair).collect();
    let widest = pairs.iter().map(|pair| pair.position.distance(pairs[0].position)).fold(ERROR, f64::max);
    let mut similarity = fit(&pairs)?;
    for step in 0..=STEPS {
        let tolerance = ERROR * (widest / ERROR).powf(1.0 - f64::from(step) / f64::from(STEPS));
        for pair in &mut pairs {
            let ratio = residual(&similarity, pair) / tolerance;
            pair.weight = (1.0 + ratio * ratio).powi(-2);
        }
        similarity = fit(&pairs)?;
    }
    let residuals: Vec<f64> =
        pairs.iter().map(|pair| residual(&similarity, pair)).filter(|metres| *metres < FITS * ERROR).collect();
    let fitting = residuals.len();
    let residual_m = median(residuals);
    let spread = spread(&pairs, |pair| pair.position);
    let is_possible = fitting >= 3 && fitting * 2 > pairs.len() && spread > ERROR && spread > 2.0 * residual_m;
    let gps = Gps { positions: pairs.len(), fitting, residual_m };
    is_possible.then_some(Alignment { rotation: similarity.rotation, scale: similarity.scale, gps })
}

/// Metres east, down and north of another position, near a latitude.
fn metres(position: Position, from: Position, latitude: f64) -> DVec3 {
    let sine = (latitude * 1e-9).to_radians().sin();
    let flattened = 1.0 - EARTH.1 * sine * sine;
    let across = EARTH.0 / flattened.sqrt();
    let along = across * (1.0 - EARTH.1) / flattened;
    let angle = |axis: usize| ((position[axis] - from[axis]) as f64 * 1e-9).to_radians();
    let down = (from[2] - position[2]) as f64 * 1e-3;
    dvec3(angle(1) * across * (1.0 - sine * sine).sqrt(), down, angle(0) * along)
}

/// The similarity from cameras to positions, by least squares. The model's up direction counts as one more
/// observation, weighted by the error of a position.
fn fit(pairs: &[Pair]) -> Option<Similarity> {
    let (size, spread) = (spread(pairs, |pair| pair.camera), spread(pairs, |pair| pair.position));
    let total: f64 = pairs.iter().map(|pair| pair.weight).sum();
    let up = DMat3::from_diagonal(DVec3::Y) * (total * ERROR * size * (ERROR / spread));
    let pairs: Vec<_> = pairs.iter().map(|pair| (pair.camera, pair.position, pair.weight)).collect();
    Similarity::between(&pairs, up).filter(|fit| size > 0.0 && fit.scale > 0.0)
}

/// Root mean square distance of points from their mean, weighted.
fn spread(pairs: &[Pair], of: fn(&Pair) -> DVec3) -> f64 {
    let total: f64 = pairs.iter().map(|pair| pair.weight).sum();
    let mean = pairs.iter().map(|pair| of(pair) * pair.weight).sum::<DVec3>() / total;
    (pairs.iter().map(|pair| pair.weight * of(pair).distance_squared(mean)).sum::<f64>() / total).sqrt()
}

/// Distance of a position from the camera, m.
fn residual(fit: &Similarity, pair: &Pair) -> f64 {
    fit.apply(pair.camera).distance(pair.position)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error of the positions, m: a fixed pattern within 3 m.
    fn noise(i: usize) -> DVec3 {
        let angle = i as f64 * 2.4;
        dvec3(3.0 * angle.sin(), 2.0 * (angle * 1.7).cos(), 3.0 * (angle * 2.3).cos())
    }

    /// Cameras on a path in metres (east, down, north), in a model that is turned about the vertical and smaller.
    fn model(path: impl Fn(usize) -> DVec3, count: usize) -> (DQuat, Vec<Registered>) {
        let turn = DQuat::from_rotation_y(1.9);
        let camera = |i: usize| {
            let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3 * i as f64, 0.1, 0.2);
            let translation = -(rotation * (turn.inverse() * path(i) / 40.0 + DVec3::splat(7.0)));
            Registered { name: i.to_string(), rotation, translation, observations: 0, focal: 1.0 }
        };
        (turn, (0..count).map(camera).collect())
    }

    /// The position on Earth at these metres from a place on the equator, 1e-5° at a time.
    fn place(metres: DVec3) -> Position {
        let degrees = |metres: f64, of_degree: f64| (metres / of_degree * 1e9).round() as i64;
        [degrees(metres.z, 110_574.3), degrees(metres.x, 111_319.5) + 12_000_000_000, 80_000 - (metres.y * 1e3) as i64]
    }

    fn flight(i: usize) -> DVec3 {
        dvec3(20.0 * (i % 5) as f64, -30.0, 15.0 * (i / 5) as f64)
    }

    fn aligned(path: fn(usize) -> DVec3, count: usize, moved: impl Fn(usize) -> DVec3) -> Option<(DQuat, Alignment)> {
        let (turn, images) = model(path, count);
        let position = |name: &str| {
            let i: usize = name.parse().unwrap();
            Some(place(path(i) + moved(i)))
        };
        align(&images, position).map(|found| (turn, found))
    }

    #[test]
    fn scale_and_directions_are_found_despite_outliers() {
        for outliers in [0, 3] {
            let moved = |i: usize| if i % 6 == 1 && i / 6 < outliers { dvec3(900.0, 0.0, -2000.0) } else { noise(i) };
            let (turn, found) = aligned(flight, 20, moved).unwrap();
            assert!((found.scale / 40.0 - 1.0).abs() < 0.04, "{found:?}");
            assert!(found.rotation.angle_between(turn).to_degrees() < 3.0, "{found:?}");
            let Gps { positions, fitting, residual_m } = found.gps;
            assert_eq!((positions, fitting), (20, 20 - outliers));
            assert!((1.0..4.5).contains(&residual_m), "{residual_m}");
        }
    }

    #[test]
    fn a_straight_path_keeps_the_direction_up() {
        let (turn, found) = aligned(|i| dvec3(8.0 * i as f64, 0.0, 0.0), 12, noise).unwrap();
        assert!((found.rotation * DVec3::Y).angle_between(DVec3::Y).to_degrees() < 8.0, "{found:?}");
        assert!(found.rotation.angle_between(turn).to_degrees() < 10.0, "{found:?}");
        assert!((found.scale / 40.0 - 1.0).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn positions_that_say_nothing_change_nothing() {
        let near = |i: usize| dvec3((i % 3) as f64, 0.0, (i / 3) as f64);
        assert_eq!(aligned(near, 9, noise), None, "closer than their error");
        assert_eq!(aligned(flight, 2, |_| DVec3::ZERO), None, "too few");
        assert_eq!(aligned(flight, 20, |i| flight(i * i * 7 % 20) * 9.0), None, "contradictions");
        assert_eq!(aligned(|_| DVec3::ZERO, 9, |_| DVec3::ZERO), None, "all at one place");
        let (_, images) = model(flight, 5);
        assert_eq!(align(&images, |_| None), None);
    }

    #[test]
    fn a_degree_has_its_length_by_the_latitude() {
        // WGS 84: 1° of latitude and of longitude at 0° and at 60°, m.
        for (latitude, north, east) in [(0, 110_574.3, 111_319.5), (60, 111_412.2, 55_800.0)] {
            let from = [latitude * 1_000_000_000, 5_000_000_000, 100_000];
            let to = [from[0] + 1_000_000, from[1] + 1_000_000, 99_000];
            let found = metres(to, from, from[0] as f64);
            assert!((found - dvec3(east * 1e-3, 1.0, north * 1e-3)).abs().max_element() < 1e-3, "{found}");
        }
    }
}
