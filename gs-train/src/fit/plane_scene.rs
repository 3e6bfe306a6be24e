//! Flat 3D scenes, such as exported 2D scenes, and cameras that show them from the front.

use glam::{Mat3, Vec2, Vec3};
use gs_core::{Camera, Scene, Scene3d, constants::NEAR_WORLD};
use gs_io::{PICTURE_DISTANCE_WORLD, PICTURE_WORLD};

/// Largest thickness of a flat scene, as a share of its shorter side.
const FLAT: f32 = 0.02;

/// Share of the Gaussians at either end of an axis that are ignored as strays.
const STRAYS: f32 = 0.005;

/// Share at either end that may lie outside of a picture: large, faint Gaussians reach far beyond
/// its border.
const OUTSIDE: f32 = 0.1;

/// Extent of a Gaussian, standard deviations.
const REACH: f32 = 2.0;

/// Default pixels of the longer side.
const SIDE_PX: f32 = 800.0;

/// A rectangle in 3D that holds a flat scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flat {
    /// Centre, world units.
    center: Vec3,
    /// Width and height, world units.
    extent: Vec2,
    /// Right, down and forward in a view of the front, as the rows of a rotation.
    axes: Mat3,
    /// Columns and rows of the picture that it shows, where they are known, px.
    picture: Option<(u32, u32)>,
}

impl Flat {
    /// The rectangle of an exported 2D scene of this size ([`gs_io::write_ply`]).
    pub fn picture(size: (u32, u32)) -> Self {
        let sides = Vec2::new(size.0 as f32, size.1 as f32);
        let extent = sides * (PICTURE_WORLD / sides.max_element());
        Self { center: Vec3::ZERO, extent, axes: Mat3::IDENTITY, picture: Some(size) }
    }

    /// The rectangle of a scene; `None` where the scene is not flat along x, y or z.
    ///
    /// Its front is the view along +z with −y up, along +x with −y up, or along +y with +z up.
    /// `picture` is the size in its file, which is used where the scene lies in the rectangle of an
    /// exported 2D scene.
    pub fn of(scene: &Scene3d, picture: Option<(u32, u32)>) -> Option<Self> {
        let known = picture.map(Self::picture);
        if let Some(known) = known.filter(|known| bounds(scene, OUTSIDE).is_some_and(|bounds| known.holds(bounds))) {
            return Some(known);
        }
        let (low, high) = bounds(scene, STRAYS)?;
        let sides = high - low;
        let normal = sides.min_position();
        let axes = match normal {
            0 => [Vec3::NEG_Z, Vec3::Y, Vec3::X],
            1 => [Vec3::X, Vec3::NEG_Z, Vec3::Y],
            _ => [Vec3::X, Vec3::Y, Vec3::Z],
        };
        let extent = Vec2::new(axes[0].abs().dot(sides), axes[1].abs().dot(sides));
        let axes = Mat3::from_cols(axes[0], axes[1], axes[2]).transpose();
        let is_flat = sides[normal] <= FLAT * extent.min_element();
        is_flat.then_some(Self { center: 0.5 * (low + high), extent, axes, picture: None })
    }

    /// Whether bounds are roughly those of the picture.
    fn holds(&self, (low, high): (Vec3, Vec3)) -> bool {
        let (margin, half) = (0.5 * PICTURE_WORLD, 0.5 * self.extent);
        let inside = low.truncate().cmpge(-half - margin).all() && high.truncate().cmple(half + margin).all();
        inside && low.z.abs().max(high.z.abs()) <= 2.0 * FLAT * PICTURE_WORLD
    }

    /// Columns and rows of an image of the flat scene: those of the file, or else 800 px along the
    /// longer side.
    pub fn size(&self) -> (u32, u32) {
        let sides = self.extent * (SIDE_PX / self.extent.max_element());
        self.picture.unwrap_or((sides.x.round().max(1.0) as u32, sides.y.round().max(1.0) as u32))
    }

    /// The camera that shows the front upright and as large as an image of this size can hold.
    pub fn camera(&self, (width, height): (u32, u32)) -> Camera {
        let size = Vec2::new(width as f32, height as f32);
        let distance = PICTURE_DISTANCE_WORLD / PICTURE_WORLD * self.extent.max_element();
        let focal = (size / self.extent).min_element() * distance;
        let position = self.center - distance * self.forward();
        Camera {
            rotation: self.axes,
            translation: -(self.axes * position),
            focal: Vec2::splat(focal),
            center: 0.5 * size,
            width,
            height,
            near: NEAR_WORLD.min(0.01 * distance),
        }
    }

    /// Centre of the scene, world units.
    pub fn center(&self) -> Vec3 {
        self.center
    }

    /// Direction that is up in a view of the front.
    pub fn up(&self) -> Vec3 {
        -self.axes.row(1)
    }

    fn forward(&self) -> Vec3 {
        self.axes.row(2)
    }
}

/// A box that holds all but this share of the Gaussians at either end of each axis; `None` without
/// a Gaussian that can be drawn.
fn bounds(scene: &Scene3d, strays: f32) -> Option<(Vec3, Vec3)> {
    let reach = |index: usize| {
        let g = scene.gaussian(index);
        let covariance = g.covariance().filter(|_| g.mean.is_finite())?;
        let reach = REACH * Vec3::new(covariance.x_axis.x, covariance.y_axis.y, covariance.z_axis.z).map(f32::sqrt);
        reach.is_finite().then_some((g.mean - reach, g.mean + reach))
    };
    let (lows, highs): (Vec<Vec3>, Vec<Vec3>) = (0..scene.len()).filter_map(reach).unzip();
    let quantile = |points: &[Vec3], axis: usize, share: f32| {
        let mut values: Vec<f32> = points.iter().map(|point| point[axis]).collect();
        values.sort_by(f32::total_cmp);
        let last = values.len().checked_sub(1)?;
        Some(values[(share * last as f32).round() as usize])
    };
    let along = |points: &[Vec3], share: f32| {
        Some(Vec3::new(quantile(points, 0, share)?, quantile(points, 1, share)?, quantile(points, 2, share)?))
    };
    Some((along(&lows, strays)?, along(&highs, 1.0 - strays)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_core::Gaussian3d;

    /// Gaussians over a rectangle of 4×2 around (5, 6, 7), `thickness` along `normal`; the first in
    /// the corner that is to be top left.
    fn rectangle(normal: usize, thickness: f32) -> (Scene3d, Vec3) {
        let [right, down] = [[Vec3::NEG_Z, Vec3::Y], [Vec3::X, Vec3::NEG_Z], [Vec3::X, Vec3::Y]][normal];
        let mut scene = Scene3d::default();
        for i in 0..200 {
            let (u, v) = ((i % 20) as f32 / 19.0 - 0.5, (i / 20) as f32 / 9.0 - 0.5);
            let mean = Vec3::new(5.0, 6.0, 7.0) + 4.0 * u * right + 2.0 * v * down;
            let mut log_scale = Vec3::splat(-9.0);
            log_scale[normal] = thickness.ln();
            scene.push(Gaussian3d {
                mean,
                log_scale,
                rotation: [1.0, 0.0, 0.0, 0.0],
                opacity_logit: 2.0,
                sh: vec![Vec3::ONE],
            });
        }
        (scene, Vec3::new(5.0, 6.0, 7.0) - 2.0 * right - down)
    }

    #[test]
    fn a_flat_scene_is_seen_from_its_front_filling_the_frame() {
        for normal in 0..3 {
            let (scene, corner) = rectangle(normal, 1e-4);
            let flat = Flat::of(&scene, None).unwrap();
            assert_eq!(flat.size(), (800, 400));
            let camera = flat.camera((400, 200));
            camera.validate().unwrap();
            assert!((camera.rotation.determinant() - 1.0).abs() < 1e-6, "not mirrored");
            let (at, _) = camera.project(corner).unwrap();
            assert!(at.max_element() < 4.0 && at.min_element() > -1.0, "{normal}: {at}");
            let (middle, _) = camera.project(Vec3::new(5.0, 6.0, 7.0)).unwrap();
            assert!(middle.abs_diff_eq(Vec2::new(200.0, 100.0), 1.0), "{middle}");
            let (at, _) = flat.camera((400, 400)).project(corner).unwrap();
            assert!((at.y - 100.0).abs() < 3.0, "another shape holds all of it: {at}");
        }
    }

    #[test]
    fn a_scene_with_depth_is_not_flat() {
        assert_eq!(Flat::of(&rectangle(2, 0.1).0, None), None);
        assert_eq!(Flat::of(&rectangle(2, 0.1).0, Some((40, 20))), None);
        assert_eq!(Flat::of(&Scene3d::default(), Some((40, 20))), None);
    }

    #[test]
    fn a_picture_is_where_its_file_says_unless_the_scene_is_elsewhere() {
        let (mut scene, _) = rectangle(2, 1e-4);
        assert_eq!(Flat::of(&scene, Some((40, 30))).unwrap().size(), (800, 400), "it is elsewhere");
        scene.means.iter_mut().for_each(|mean| *mean = (*mean - Vec3::new(5.0, 6.0, 7.0)) * 0.4);
        let flat = Flat::of(&scene, Some((40, 30))).unwrap();
        assert_eq!(flat, Flat::picture((40, 30)));
        let camera = flat.camera((40, 30));
        let (corner, depth) = camera.project(Vec3::new(-1.0, -0.75, 0.0)).unwrap();
        assert!(corner.abs_diff_eq(Vec2::ZERO, 1e-4) && depth == PICTURE_DISTANCE_WORLD);
    }
}
