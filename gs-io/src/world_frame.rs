//! Coordinates of scenes relative to the world of their data set.
//!
//! Data sets are read in `f64`; scenes and cameras are `f32`, which have seven digits. A capture in
//! UTM or ECEF coordinates, or one in micrometres, is therefore moved and scaled before anything is
//! rounded, into a frame in which its cameras stand about one unit apart.

use std::fmt;

use glam::{DAffine3, DMat3, DVec3};
use gs_core::constants::{NEAREST_POINTS, ONE_PLACE};
use serde::{Deserialize, Serialize};

/// A frame: world = origin + unit · frame, with the axes of the world.
///
/// ```
/// use glam::{DVec3, dvec3};
/// use gs_io::WorldFrame;
///
/// // Four drone positions 100 m apart, in UTM coordinates.
/// let drone = [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0), (100.0, 100.0)];
/// let cameras = drone.map(|(x, y)| dvec3(451_230.0 + x, 5_411_870.0 + y, 420.0));
/// let frame = WorldFrame::of(&cameras, &[]);
/// assert_eq!((frame.origin, frame.unit), (dvec3(451_000.0, 5_412_000.0, 0.0), 100.0));
/// assert!(frame.to_world(dvec3(2.3, -1.3, 4.2)).abs_diff_eq(cameras[0], 1e-6));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldFrame {
    /// The frame's origin, world units; finite.
    pub origin: DVec3,
    /// World units of one unit of the frame: finite and above 0.
    pub unit: f64,
}

impl Default for WorldFrame {
    fn default() -> Self {
        Self::WORLD
    }
}

/// Spread of the cameras, in the middle of the range that [`WorldFrame::of`] allows, frame units.
/// COLMAP scales what it reconstructs to about 3.5, NeRF-synthetic has 3 to 4, and Nerfstudio 1.
const USUAL_SPREAD: f64 = 2.2;

/// Distance of the cameras from the world's origin, in spreads, up to which the origin stays: `f32`
/// rounds positions to 2e-6 spreads there, which is 1/500 px in an image of 1,000 px.
const MAX_DISTANCE: f64 = 32.0;

/// Share of the points' distance that stands for the spread of cameras in one place.
const SHARE_OF_DISTANCE: f64 = 0.2;

/// The origin's coordinates are multiples of this many units, which are easy to read and usually
/// exact in text.
const ORIGIN_STEP: f64 = 10.0;

impl WorldFrame {
    /// The world itself.
    pub const WORLD: Self = Self { origin: DVec3::ZERO, unit: 1.0 };

    /// The frame for cameras at these positions and for these points, world units.
    ///
    /// The unit is a power of ten such that the cameras' spread, which is their median distance from
    /// their median position, is between 0.7 and 7 units. So the same capture in metres and in
    /// millimetres gives the same numbers. The origin stays that of the world, unless the cameras are
    /// farther than 32 spreads from it.
    pub fn of(cameras: &[DVec3], points: &[DVec3]) -> Self {
        let center = DVec3::from([0, 1, 2].map(|axis| median(cameras.iter().map(|c| c[axis])).unwrap_or(0.0)));
        let distance = |positions: &[DVec3]| median(positions.iter().map(|p| p.distance(center))).unwrap_or(0.0);
        let (of_cameras, of_points) = (distance(cameras), distance(points));
        let nearest = quantile(points.iter().map(|p| p.distance(center)), NEAREST_POINTS).unwrap_or(0.0);
        let in_one_place = of_cameras <= ONE_PLACE * nearest;
        let spread = if in_one_place { SHARE_OF_DISTANCE * of_points } else { of_cameras };
        // Rounding of f64 leaves that much of cameras in one place.
        if !(spread > 1e-9 * center.length() && spread > 1e-30 && spread.is_finite()) {
            return Self { origin: if center.length() > 1e3 { center.round() } else { DVec3::ZERO }, unit: 1.0 };
        }
        let unit = 10f64.powi((spread / USUAL_SPREAD).log10().round() as i32);
        let step = ORIGIN_STEP * unit;
        let far = center.length() > MAX_DISTANCE * spread;
        // Adding 0 makes 0 of -0.
        Self { origin: if far { (center / step).round() * step + DVec3::ZERO } else { DVec3::ZERO }, unit }
    }

    /// The frame for places whose unit suits, world units: its origin stays unless `f32` could not
    /// resolve the places around it.
    pub(crate) fn around(places: &[DVec3]) -> Self {
        Self { unit: 1.0, ..Self::of(places, &[]) }
    }

    /// Whether this is the world itself.
    pub fn is_world(&self) -> bool {
        *self == Self::WORLD
    }

    /// Whether origin and unit are possible.
    pub(crate) fn is_valid(&self) -> bool {
        self.origin.is_finite() && self.unit > 0.0 && self.unit.is_finite()
    }

    /// The frame's coordinates of a place in the world.
    pub(crate) fn to_frame(self, world: DVec3) -> DVec3 {
        (world - self.origin) / self.unit
    }

    /// The world's coordinates of a place in the frame.
    pub fn to_world(&self, place: DVec3) -> DVec3 {
        self.origin + self.unit * place
    }

    /// The map from coordinates of this frame to those of another.
    pub(crate) fn to(&self, other: &Self) -> DAffine3 {
        let scale = self.unit / other.unit;
        let shift = (self.origin - other.origin) / other.unit;
        DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(scale)), shift)
    }

    /// The frame of a TOML text, as checkpoints store it.
    ///
    /// # Errors
    /// What is wrong, for a text that [`Self::to_toml`] did not write.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let frame: Self = toml::from_str(text).map_err(|error| error.message().to_owned())?;
        if frame.is_valid() {
            Ok(frame)
        } else {
            Err("origin and unit must be finite, and the unit above 0".to_owned())
        }
    }

    /// The frame as TOML.
    pub fn to_toml(&self) -> String {
        let Self { origin: DVec3 { x, y, z }, unit } = self;
        format!("origin = [{x:?}, {y:?}, {z:?}]\nunit = {unit:?}\n")
    }

    /// The frame in words of a file: `origin X Y Z unit U`.
    pub(crate) fn to_words(self) -> String {
        let Self { origin: DVec3 { x, y, z }, unit } = self;
        format!("origin {x:?} {y:?} {z:?} unit {unit:?}")
    }

    /// Reads [`Self::to_words`]; `None` for other words, and for a frame that is not possible.
    pub(crate) fn of_words(words: &[&str]) -> Option<Self> {
        let ["origin", x, y, z, "unit", unit] = words else { return None };
        let origin = DVec3::new(x.parse().ok()?, y.parse().ok()?, z.parse().ok()?);
        Some(Self { origin, unit: unit.parse().ok()? }).filter(Self::is_valid)
    }
}

impl fmt::Display for WorldFrame {
    /// `1 unit is 100 of the world's; origin at (451300, 5411900, 400)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { origin: DVec3 { x, y, z }, unit } = self;
        let moved = self.origin != DVec3::ZERO;
        match (*unit == 1.0, moved) {
            (true, false) => f.write_str("the world's own coordinates"),
            (true, true) => write!(f, "the world's unit; origin at ({x}, {y}, {z})"),
            (false, false) => write!(f, "1 unit is {unit} of the world's"),
            (false, true) => write!(f, "1 unit is {unit} of the world's; origin at ({x}, {y}, {z})"),
        }
    }
}

/// The median of the finite values: the upper one of an even number.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    quantile(values, 0.5)
}

/// The first of the finite values that this share, below 1, is smaller than.
fn quantile(values: impl Iterator<Item = f64>, share: f64) -> Option<f64> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    let place = (share * values.len() as f64) as usize;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(place, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(radius: f64, center: DVec3) -> Vec<DVec3> {
        (0..12).map(|i| f64::from(i) * 0.5).map(|a| center + radius * DVec3::new(a.cos(), a.sin(), 0.2)).collect()
    }

    #[test]
    fn usual_captures_keep_the_world() {
        for radius in [0.75, 1.0, 3.2, 4.0, 6.5] {
            assert_eq!(WorldFrame::of(&ring(radius, DVec3::new(2.0, -5.0, 1.0)), &[]), WorldFrame::WORLD, "{radius}");
        }
        assert_eq!(WorldFrame::of(&[], &[]), WorldFrame::WORLD);
        assert_eq!(WorldFrame::of(&[DVec3::ONE], &[]), WorldFrame::WORLD);
    }

    #[test]
    fn the_unit_of_the_world_does_not_change_the_frames_numbers() {
        let cameras = ring(3.2, DVec3::new(1.0, 2.0, 0.5));
        for exponent in [-9, -5, -3, -1, 1, 3, 5, 12] {
            let unit = 10f64.powi(exponent);
            let scaled: Vec<DVec3> = cameras.iter().map(|c| *c * unit).collect();
            let frame = WorldFrame::of(&scaled, &[]);
            assert_eq!((frame.unit, frame.origin), (unit, DVec3::ZERO));
            let differing = scaled.iter().zip(&cameras).filter(|(s, c)| frame.to_frame(**s).as_vec3() != c.as_vec3());
            assert_eq!(differing.count(), 0, "10^{exponent}");
        }
    }

    #[test]
    fn a_far_origin_is_moved_near_the_cameras() {
        let offset = DVec3::new(4.5e6, -450_120.0, 130.0);
        let frame = WorldFrame::of(&ring(3.2, offset), &[]);
        assert_eq!(frame, WorldFrame { origin: offset, unit: 1.0 });
        let drone = WorldFrame::of(&ring(80.0, offset), &[]);
        assert!(drone.unit == 100.0 && (drone.origin - offset).length() <= 1000.0, "{drone:?}");
    }

    #[test]
    fn outliers_and_points_far_away_do_not_count() {
        let mut cameras = ring(3.2, DVec3::ZERO);
        cameras[0] = DVec3::splat(1e12);
        cameras[1] = DVec3::NAN;
        let mut points = vec![DVec3::ONE; 20];
        points[3] = DVec3::splat(1e15);
        assert_eq!(WorldFrame::of(&cameras, &points), WorldFrame::WORLD);
        let with_sky = [ring(1e5, DVec3::ZERO), ring(5.0, DVec3::ZERO)].concat();
        assert_eq!(WorldFrame::of(&ring(3.2, DVec3::ZERO), &with_sky), WorldFrame::WORLD, "a sky");
    }

    #[test]
    fn cameras_in_one_place_take_the_unit_from_the_points() {
        let place = DVec3::new(5e6, 0.0, 0.0);
        let points: Vec<DVec3> = ring(2000.0, place);
        assert_eq!(WorldFrame::of(&[place; 5], &points), WorldFrame { origin: place, unit: 100.0 });
        assert_eq!(WorldFrame::of(&[place; 5], &[]), WorldFrame { origin: place, unit: 1.0 });
        // A head that pans.
        assert_eq!(WorldFrame::of(&ring(1.0, place), &points), WorldFrame { origin: place, unit: 100.0 });
        assert_eq!(WorldFrame::of(&ring(100.0, place), &points).unit, 100.0);
        let close = ring(200.0, place);
        assert_eq!(WorldFrame::of(&ring(1.0, place), &close).unit, 1.0);
    }

    #[test]
    fn words_and_maps_go_there_and_back() {
        let frame = WorldFrame { origin: DVec3::new(0.1 + 0.2, -4.5e6, 1e-30), unit: 1e-3 };
        let words = frame.to_words();
        assert_eq!(WorldFrame::of_words(&words.split(' ').collect::<Vec<_>>()), Some(frame));
        for bad in ["origin 0 0 0 unit 0", "origin 0 0 0 unit NaN", "origin 0 inf 0 unit 1", "origin 0 0 unit 1"] {
            assert_eq!(WorldFrame::of_words(&bad.split(' ').collect::<Vec<_>>()), None, "{bad}");
        }
        assert_eq!(WorldFrame::from_toml(&frame.to_toml()), Ok(frame));
        assert!(WorldFrame::from_toml("origin = [0.0, 0.0, 0.0]\nunit = 0.0").is_err());
        let other = WorldFrame { origin: DVec3::new(1.0, -4.4e6, 0.0), unit: 10.0 };
        let place = DVec3::new(3.0, 4.0, 5.0);
        let there = frame.to(&other).transform_point3(place);
        assert!(other.to_world(there).abs_diff_eq(frame.to_world(place), 1e-8));
    }
}
