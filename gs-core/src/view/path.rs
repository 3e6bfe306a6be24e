//! Moving cameras: orbits, and paths through key positions.

use glam::{Mat3, Quat, Vec3};
use serde::{Deserialize, Serialize};

use crate::{
    constants::NEAR_WORLD,
    error::Error,
    scene::{Bounds, LodNode, Scene, Scene3d, sigmoid},
    view::Camera,
};

/// Largest number of frames of a path; a mistyped number is refused before anything is rendered.
const MOST_FRAMES: u32 = 100_000;

/// Factor of the bulk's radius that an overview shows: room for the tenth of the Gaussians outside
/// it and for perspective.
const AROUND: f32 = 1.35;

/// Extent of a Gaussian in standard deviations: beyond two, an opaque one covers less than an
/// eighth.
const REACH: f32 = 2.0;

/// An orbit: camera positions on a circle around a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Centre of the circle, world units.
    pub center: Vec3,
    /// Axis of the circle; any length but 0.
    pub axis: Vec3,
    /// Number of positions.
    pub frames: u32,
}

impl Orbit {
    /// Cameras of one turn around the axis in equal steps, beginning with the camera itself;
    /// counter-clockwise as seen from the tip of the axis.
    pub fn cameras(&self, first: &Camera) -> Vec<Camera> {
        let angle = |frame: u32| std::f32::consts::TAU * frame as f32 / self.frames as f32;
        (0..self.frames).map(|frame| self.turned(first, angle(frame))).collect()
    }

    /// The camera turned around the axis by `angle`, rad.
    pub fn turned(&self, camera: &Camera, angle: f32) -> Camera {
        let turn = Mat3::from_quat(Quat::from_axis_angle(self.axis.normalize_or(Vec3::NEG_Y), angle));
        let rotation = camera.rotation * turn.transpose();
        let position = self.center + turn * (camera.position() - self.center);
        Camera { rotation, translation: -(rotation * position), ..*camera }
    }
}

/// Place and size of the bulk of a scene, without strays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bulk {
    /// Median of the means, axis by axis, world units.
    pub center: Vec3,
    /// Distance from the centre within which nine tenths of the Gaussians are, each out to two
    /// standard deviations, world units.
    pub radius: f32,
}

impl Bulk {
    /// Usual horizontal field of view of an [`overview`](Self::overview), rad.
    pub const FIELD_OF_VIEW: f32 = 0.9;

    /// The bulk of the Gaussians with more than a tenth of opacity, or of all if there are none.
    /// `None` where no mean is finite.
    pub fn of(scene: &Scene3d) -> Option<Self> {
        let finite = |index: &usize| scene.means[*index].is_finite();
        let mut seen: Vec<usize> = (0..scene.len()).filter(finite).collect();
        let opaque = |index: &usize| sigmoid(scene.opacity_logits[*index]) > 0.1;
        if seen.iter().any(&opaque) {
            seen.retain(opaque);
        }
        let extent = |index: &usize| REACH * scene.log_scales[*index].max_element().exp();
        Self::around(&seen.iter().map(|index| (scene.means[*index], extent(index))).collect::<Vec<_>>())
    }

    /// Estimates the bulk of a scene from its cells, as if each were filled evenly. `None` if there is no cell.
    pub fn of_cells(tree: &LodNode) -> Option<Self> {
        // The root of the mean squared distance of points in a box from its centre is its diagonal over √12.
        let spread =
            |bounds: &Bounds| (bounds.min.midpoint(bounds.max), bounds.min.distance(bounds.max) / 12f32.sqrt());
        Self::around(&tree.cells().iter().map(|(bounds, _)| spread(bounds)).collect::<Vec<_>>())
    }

    /// The bulk of things with a position and an extent.
    fn around(things: &[(Vec3, f32)]) -> Option<Self> {
        let quantile = |mut values: Vec<f32>, share: f32| {
            values.sort_by(f32::total_cmp);
            values.get(((values.len() as f32 * share) as usize).min(values.len().saturating_sub(1))).copied()
        };
        let median = |axis: usize| quantile(things.iter().map(|(position, _)| position[axis]).collect(), 0.5);
        let center = Vec3::new(median(0)?, median(1)?, median(2)?);
        let radius =
            quantile(things.iter().map(|(position, extent)| position.distance(center) + extent).collect(), 0.9)?;
        Some(Self { center, radius: if radius > 0.0 { radius } else { 1.0 } })
    }

    /// A camera of this image size that has the bulk in view from a little above; `fov_x` in rad,
    /// `up` as for [`Camera::looking_at`].
    pub fn overview(&self, width: u32, height: u32, fov_x: f32, up: Vec3) -> Option<Camera> {
        let camera = Camera::looking_forward(width, height, fov_x);
        let half_side = 0.5 * width.min(height) as f32 / camera.focal.x;
        let up = up.try_normalize()?;
        let back = up.any_orthonormal_vector();
        let away = (back + 0.35 * up).normalize() * (self.radius * AROUND / half_side);
        let near = NEAR_WORLD.min(0.01 * self.radius);
        Camera { near, ..camera }.looking_at(self.center + away, self.center, up)
    }
}

/// Whether a path returns to its first key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ends {
    /// The path ends at its last key.
    #[default]
    Open,
    /// The path goes from its last key to its first.
    Closed,
}

/// A key position of a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Key {
    /// Position of the camera, world units.
    pub position: Vec3,
    /// Point that the camera looks at, world units.
    pub target: Vec3,
}

/// A smooth path of a camera through key positions; `gs render --path` reads it as JSON.
///
/// ```
/// let text = r#"{ "width": 800, "height": 600, "fov": 60, "up": [0, -1, 0], "frames": 90,
///                 "keys": [{ "position": [0, 0, -4], "target": [0, 0, 0] },
///                          { "position": [4, 0, 0], "target": [0, 0, 0] }] }"#;
/// let path: gs_core::view::CameraPath = serde_json::from_str(text).unwrap();
/// assert_eq!(path.cameras().unwrap().len(), 90);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct CameraPath {
    /// Columns of the images.
    pub width: u32,
    /// Rows of the images.
    pub height: u32,
    /// Horizontal field of view, degrees, above 0 and below 180.
    pub fov: f32,
    /// Direction that is up in the image; (0, −1, 0) in data sets of COLMAP, where y points down.
    pub up: Vec3,
    /// Number of frames, 1 to 100,000.
    pub frames: u32,
    /// Whether the path returns to its first key.
    #[serde(default)]
    pub ends: Ends,
    /// Key positions, at least one.
    pub keys: Vec<Key>,
}

impl CameraPath {
    /// The cameras of all frames, evenly spread between the keys. *Source of the interpolation:*
    /// Catmull & Rom 1974.
    ///
    /// # Errors
    /// [`Error::Setting`] or [`Error::Size`] where a number is not possible, or a frame has no
    /// viewing direction.
    pub fn cameras(&self) -> Result<Vec<Camera>, Error> {
        self.validate()?;
        let lens = Camera::looking_forward(self.width, self.height, self.fov.to_radians());
        lens.validate()?;
        let stretches = match self.ends {
            Ends::Open => self.keys.len() - 1,
            Ends::Closed => self.keys.len(),
        } as f32;
        let steps = match self.ends {
            Ends::Open => self.frames.saturating_sub(1).max(1),
            Ends::Closed => self.frames,
        } as f32;
        (0..self.frames)
            .map(|frame| {
                let (position, target) = self.at(frame as f32 / steps * stretches);
                lens.looking_at(position, target, self.up).ok_or_else(|| {
                    let value = format!("from {position} to {target} at frame {frame}");
                    Error::setting(
                        "a view of the path",
                        value,
                        "to another place than its own, and not straight up or down",
                    )
                })
            })
            .collect()
    }

    /// Position and target at `along` stretches from the first key.
    fn at(&self, along: f32) -> (Vec3, Vec3) {
        let count = self.keys.len() as i64;
        let key = |index: i64| match self.ends {
            Ends::Open => self.keys[index.clamp(0, count - 1) as usize],
            Ends::Closed => self.keys[index.rem_euclid(count) as usize],
        };
        let start = along.floor();
        let (index, t) = (start as i64, along - start);
        let keys = [index - 1, index, index + 1, index + 2].map(key);
        let spline = |of: fn(&Key) -> Vec3| {
            let [a, b, c, d] = [of(&keys[0]), of(&keys[1]), of(&keys[2]), of(&keys[3])];
            let (linear, square) = (c - a, 2.0 * a - 5.0 * b + 4.0 * c - d);
            let cube = 3.0 * (b - c) + d - a;
            b + 0.5 * t * (linear + t * (square + t * cube))
        };
        (spline(|k| k.position), spline(|k| k.target))
    }

    fn validate(&self) -> Result<(), Error> {
        Error::within("the number of frames", self.frames, 1..=MOST_FRAMES, "1 to 100,000")?;
        Error::within("the field of view", self.fov, f32::MIN_POSITIVE..180.0, "above 0 and below 180 degrees")?;
        if self.keys.is_empty() {
            return Err(Error::setting("the number of keys", 0, "at least 1"));
        }
        let finite = |key: &Key| key.position.is_finite() && key.target.is_finite();
        match self.keys.iter().position(|key| !finite(key)) {
            Some(index) => Err(Error::setting("a key of the path", format!("the {index}th"), "finite")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use crate::scene::Gaussian3d;

    use super::*;

    fn middle(camera: &Camera, point: Vec3) -> f32 {
        let (at, _) = camera.project(point).unwrap();
        (at - camera.center).length()
    }

    #[test]
    fn the_bulk_of_cells_is_about_that_of_their_gaussians() {
        let at =
            |k: usize| Vec3::new((k as f32 * 0.618_034).fract() * 40.0, 3.0, (k as f32 * 0.754_877_7).fract() * 40.0);
        let scene: Scene3d = (0..6400)
            .map(|k| Gaussian3d {
                mean: at(k),
                log_scale: Vec3::splat(-6.0),
                rotation: [1.0, 0.0, 0.0, 0.0],
                opacity_logit: 2.0,
                sh: vec![Vec3::ZERO],
            })
            .collect();
        let all = Bulk::of(&scene).unwrap();
        for cells in [1, 4, 16] {
            let side = 40.0 / cells as f32;
            let corner = |k: usize| Vec3::new((k % cells) as f32 * side, 3.0, (k / cells) as f32 * side);
            let cell = |k: usize| LodNode::Leaf {
                bounds: Bounds { min: corner(k), max: corner(k) + Vec3::new(side, 0.0, side) },
                levels: Vec::new(),
            };
            let bounds = Bounds { min: Vec3::new(0.0, 3.0, 0.0), max: Vec3::new(40.0, 3.0, 40.0) };
            let tree = LodNode::Inner { bounds, children: (0..cells * cells).map(cell).collect() };
            let bulk = Bulk::of_cells(&tree).unwrap();
            assert!(bulk.center.distance(all.center) < 8.0, "{bulk:?} {all:?}");
            let ratio = bulk.radius / all.radius;
            assert!((0.7..1.3).contains(&ratio), "{cells}: {bulk:?} {all:?}");
        }
    }

    #[test]
    fn a_camera_turned_to_a_target_has_it_in_the_middle_and_up_above() {
        let lens = Camera::looking_forward(40, 30, 1.0);
        let (position, target) = (Vec3::new(3.0, -1.0, 2.0), Vec3::new(0.5, 0.5, 0.0));
        let camera = lens.looking_at(position, target, Vec3::Z).unwrap();
        camera.validate().unwrap();
        assert!((camera.position() - position).length() < 1e-5);
        assert!(middle(&camera, target) < 1e-3);
        let (above, _) = camera.project(target + 0.1 * Vec3::Z).unwrap();
        assert!(above.y < 15.0, "y points down in pictures: {above}");
    }

    #[test]
    fn an_orbit_keeps_its_centre_in_place_and_its_distance() {
        let lens = Camera::looking_forward(40, 40, 1.0);
        let center = Vec3::new(1.0, 2.0, 3.0);
        let first = lens.looking_at(Vec3::new(4.0, 2.0, 3.5), center, Vec3::Y).unwrap();
        let cameras = Orbit { center, axis: Vec3::Y * 3.0, frames: 8 }.cameras(&first);
        assert_eq!(cameras.len(), 8);
        for camera in &cameras {
            camera.validate().unwrap();
            assert!(middle(camera, center) < 1e-2);
            assert!((camera.position().distance(center) - first.position().distance(center)).abs() < 1e-4);
        }
        assert!((cameras[0].position() - first.position()).length() < 1e-5);
        assert!((cameras[2].position() - Vec3::new(1.5, 2.0, 0.0)).length() < 1e-4, "{}", cameras[2].position());
    }

    #[test]
    fn the_bulk_knows_no_strays_and_its_overview_shows_it() {
        let mut scene = Scene3d::default();
        let at = |mean: Vec3| Gaussian3d {
            mean,
            log_scale: Vec3::splat(-7.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 2.0,
            sh: vec![Vec3::ZERO],
        };
        for i in 0..95 {
            let angle = i as f32;
            scene.push(at(Vec3::new(5.0 + angle.cos(), angle.sin(), 1.0)));
        }
        (0..5).for_each(|i| scene.push(at(Vec3::splat(1e4 * i as f32))));
        let bulk = Bulk::of(&scene).unwrap();
        assert!((bulk.center - Vec3::new(5.0, 0.0, 1.0)).length() < 0.3, "{bulk:?}");
        assert!((0.8..1.4).contains(&bulk.radius), "{bulk:?}");
        let camera = bulk.overview(64, 48, 0.9, Vec3::NEG_Y).unwrap();
        let inside = |mean: &&Vec3| {
            camera
                .project(**mean)
                .is_some_and(|(at, _)| at.cmpge(Vec2::ZERO).all() && at.cmple(Vec2::new(64.0, 48.0)).all())
        };
        assert!(scene.means.iter().filter(inside).count() >= 95);
        assert_eq!(Bulk::of(&Scene3d::default()), None);
    }

    #[test]
    fn an_overview_shows_gaussians_whole_where_all_are_in_one_place() {
        let gaussian = |scale: f32| Gaussian3d {
            mean: Vec3::ONE,
            log_scale: Vec3::new(scale, 0.1, 0.1).map(f32::ln),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 2.0,
            sh: vec![Vec3::ZERO],
        };
        let mut scene = Scene3d::default();
        (0..20).for_each(|i| scene.push(gaussian(if i < 10 { 1.0 } else { 50.0 })));
        let bulk = Bulk::of(&scene).unwrap();
        assert!((bulk.radius - 100.0).abs() < 1e-3, "{bulk:?}");
        let camera = bulk.overview(64, 48, 0.9, Vec3::NEG_Y).unwrap();
        for end in [-100.0, 100.0] {
            let (at, _) = camera.project(Vec3::ONE + end * Vec3::X).unwrap();
            assert!(at.cmpge(Vec2::ZERO).all() && at.cmple(Vec2::new(64.0, 48.0)).all(), "{at}");
        }
    }

    #[test]
    fn a_path_goes_through_its_keys() {
        let key = |x: f32, z: f32| Key { position: Vec3::new(x, 0.0, z), target: Vec3::ZERO };
        let keys = vec![key(0.0, -4.0), key(4.0, 0.0), key(0.0, 4.0)];
        let path = CameraPath { width: 8, height: 6, fov: 60.0, up: Vec3::NEG_Y, frames: 5, ends: Ends::Open, keys };
        let positions: Vec<Vec3> = path.cameras().unwrap().iter().map(Camera::position).collect();
        for (frame, key) in [(0, 0), (2, 1), (4, 2)] {
            assert!((positions[frame] - path.keys[key].position).length() < 1e-5, "{positions:?}");
        }
        let closed = CameraPath { ends: Ends::Closed, frames: 6, ..path.clone() };
        let positions: Vec<Vec3> = closed.cameras().unwrap().iter().map(Camera::position).collect();
        assert!((positions[4] - path.keys[2].position).length() < 1e-5);
        assert_ne!(positions[5], positions[4]);
        for bad in [
            CameraPath { frames: 0, ..path.clone() },
            CameraPath { fov: 180.0, ..path.clone() },
            CameraPath { keys: Vec::new(), ..path.clone() },
            CameraPath { width: 0, ..path.clone() },
            CameraPath { up: Vec3::ZERO, ..path.clone() },
            CameraPath { keys: vec![Key { position: Vec3::ZERO, target: Vec3::ZERO }], ..path.clone() },
            CameraPath { keys: vec![Key { position: Vec3::NAN, target: Vec3::ZERO }], ..path },
        ] {
            assert!(bad.cameras().is_err(), "{bad:?}");
        }
    }
}
