//! The first Gaussians of a 3D scene: from points of a reconstruction, random points, or another
//! scene.

use glam::{Vec2, Vec3};
use gs_core::{Camera, Error, Gaussian3d, Scene, Scene3d, constants::SH_C0, logit, math::sh};
use gs_density::Rng;
use gs_io::dataset::Point;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::{depths, far_points, neighbours::neighbour_distances, sweep};
use crate::views::{Focus, PosedView, extent_of};

gs_core::impl_with!(PointInit);

/// Half the side of the cube of random points, as a share of the cameras' distance from the focus.
/// In the NeRF-synthetic scenes, where 3DGS uses 1.3 world units, cameras are 4.03 away.
const CUBE_SHARE: f32 = 1.3 / 4.03;

/// Range of depths of random points along the cameras' rays where there is no focus, in units of
/// the extent; even in 1/depth.
const DEPTHS: [f32; 2] = [0.25, 5.0];

/// Largest coordinate of a point, world units; points further out, whose squares would overflow,
/// are dropped.
const FARTHEST: f32 = 1e15;

/// Least number of points found in the images to start from.
const LEAST_FOUND: usize = 100;

/// Settings of the first Gaussians at points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct PointInit {
    /// Opacity, above 0 and below 1. Default 0.1 (3DGS).
    pub opacity: f32,
    /// Scale, in units of the distance to the three nearest neighbours; positive. Default 1 (3DGS).
    pub scale: f32,
    /// Number of random points where a data set has none, at least 1. Default 100,000 (3DGS).
    pub random: u32,
    /// Largest number of points to start from; of more, this many are drawn at random. At least 1;
    /// by default as many as there may be Gaussians. Starts from scenes are not affected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub most_points: Option<u32>,
    /// Whether starts from points also have points far beyond them, along the rays of pixels near
    /// which no point is seen: for sky and far surfaces. By default, where views are faces of wider
    /// images ([`ImageSource::is_face`](crate::train::ImageSource::is_face)), of which most show sky.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub far_points: Option<bool>,
    /// If a data set has fewer points than this share of the largest number of Gaussians (before
    /// points raise it), 0..=1, training starts with [`Start::PointsAndImages`] unless another start
    /// is given. Default 0: never.
    #[serde(skip_serializing_if = "is_zero")]
    pub search_below: f32,
}

impl Default for PointInit {
    fn default() -> Self {
        Self { opacity: 0.1, scale: 1.0, random: 100_000, most_points: None, far_points: None, search_below: 0.0 }
    }
}

impl PointInit {
    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        Error::within("the initial opacity", self.opacity, f32::MIN_POSITIVE..1.0, "above 0 and below 1")?;
        Error::within("the initial scale", self.scale, f32::MIN_POSITIVE..=f32::MAX, "positive and finite")?;
        Error::within("the number of random points", self.random, 1.., "at least 1")?;
        Error::within("search-below", self.search_below, 0.0..=1.0, "0 to 1")?;
        let most = self.most_points.unwrap_or(1);
        Error::within("the largest number of points to start from", most, 1.., "at least 1")
    }
}

/// The first Gaussians of a training.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Start {
    /// A Gaussian at each of these points, such as those of a structure-from-motion.
    Points(Vec<Point>),
    /// A Gaussian at each of these points and at each point that a search in the images finds.
    PointsAndImages(Vec<Point>),
    /// [`PointInit::random`] Gaussians at random where the cameras look.
    Random,
    /// A Gaussian at each point that a search in the images finds, and [`PointInit::random`]
    /// Gaussians at random where it finds hardly any.
    Images,
    /// A Gaussian at each of these points and at each point of the views' depth maps, which are
    /// fitted to these points, or without any to those that a search in the images finds, unless
    /// the depths are in world units. Without depth maps, as [`Self::Points`] or
    /// [`Self::Images`].
    Depths(Vec<Point>),
    /// The Gaussians of a scene, with the SH degree of the settings.
    Scene(Scene3d),
}

impl Start {
    /// Searches the images or their depth maps for points.
    ///
    /// [`Self::Images`], [`Self::PointsAndImages`] and [`Self::Depths`] become [`Self::Points`], with
    /// the known points first. Without known points, they become [`Self::Random`] if fewer than 100
    /// points are found. Other starts stay as they are. A training calls this itself if it has not
    /// been called.
    ///
    /// # Errors
    /// Those of reading an image or a depth map.
    pub fn searched(self, views: &[PosedView]) -> Result<Self, crate::error::Error> {
        let points = match self {
            Self::Images => sweep::points(views)?,
            Self::PointsAndImages(points) if points.is_empty() => sweep::points(views)?,
            Self::PointsAndImages(mut points) => {
                points.extend(sweep::points(views)?);
                return Ok(Self::Points(points));
            }
            Self::Depths(mut points) => {
                let known = points.len();
                let mut found = depths::points(views, &points)?;
                if points.is_empty() && found.len() < LEAST_FOUND {
                    points = sweep::points(views)?;
                    found = depths::points(views, &points)?;
                }
                points.extend(found);
                if known > 0 {
                    return Ok(Self::Points(points));
                }
                points
            }
            other => return Ok(other),
        };
        Ok(if points.len() < LEAST_FOUND { Self::Random } else { Self::Points(points) })
    }

    /// Number of points that a training with these settings starts from, if the number of Gaussians
    /// allows them all; 0 for a start from random points or from a scene.
    pub(crate) fn points(&self, init: &PointInit) -> usize {
        match self {
            Self::Points(points) => points.len().min(init.most_points.map_or(usize::MAX, |most| most as usize)),
            _ => 0,
        }
    }

    /// The start with the points of [`PointInit::far_points`], if it has points.
    ///
    /// # Errors
    /// Those of reading an image.
    pub(crate) fn with_shell(self, views: &[PosedView]) -> Result<Self, crate::error::Error> {
        let Self::Points(mut points) = self else { return Ok(self) };
        points.extend(far_points::points(views, &points)?);
        Ok(Self::Points(points))
    }

    /// The first scene, of at most `budget` Gaussians and SH degree `sh_degree`. Of more points than
    /// that, or than [`PointInit::most_points`], as many are drawn.
    ///
    /// # Errors
    /// [`Error::Setting`] without a Gaussian, or where a given scene has more than `budget`;
    /// [`Error::NotFinite`] or [`Error::Length`] for a scene that is not possible.
    pub(crate) fn scene(
        self,
        cameras: &[Camera],
        init: &PointInit,
        budget: usize,
        sh_degree: u8,
        rng: &mut Rng,
    ) -> Result<Scene3d, Error> {
        let points = match self {
            Self::Scene(scene) => {
                scene.validate()?;
                let allowed = "at least 1 and at most the number of Gaussians allowed";
                Error::within("the number of Gaussians at the start", scene.len(), 1..=budget, allowed)?;
                return Ok(with_degree(&scene, sh_degree));
            }
            Self::Points(points) | Self::PointsAndImages(points) => points,
            Self::Random | Self::Images | Self::Depths(_) => {
                random_points(cameras, (init.random as usize).min(budget), rng)
            }
        };
        let most = init.most_points.map_or(budget, |most| budget.min(most as usize));
        let usable = |point: &&Point| point.position.is_finite() && point.position.abs().max_element() < FARTHEST;
        let mut points: Vec<Point> = points.iter().filter(usable).copied().collect();
        if points.is_empty() {
            return Err(Error::setting("the number of points to start with", 0, "at least 1, or start at random"));
        }
        if points.len() > most {
            let mut chosen = rand::seq::index::sample(rng, points.len(), most).into_vec();
            chosen.sort_unstable();
            points = chosen.into_iter().map(|index| points[index]).collect();
        }
        Ok(gaussians_at(&points, init, sh_degree))
    }
}

fn with_degree(scene: &Scene3d, sh_degree: u8) -> Scene3d {
    let mut other = Scene3d { sh_degree, ..Scene3d::default() };
    (0..scene.len()).for_each(|index| other.push(scene.gaussian(index).with_degree(sh_degree)));
    other
}

/// A round Gaussian at each point, with its colour in every direction, as large as the distance to
/// its three nearest neighbours ([`neighbour_distances`]), or 1 world unit without any. Points must
/// be finite.
fn gaussians_at(points: &[Point], init: &PointInit, sh_degree: u8) -> Scene3d {
    let positions: Vec<Vec3> = points.iter().map(|point| point.position).collect();
    // 3DGS holds squared distances to 1e-7 at least: points may coincide.
    let sigmas = neighbour_distances(&positions).into_iter().map(|d| d.unwrap_or(1.0).max(1e-7f32.sqrt()) * init.scale);
    let mut scene = Scene3d { sh_degree, ..Scene3d::default() };
    scene.sh.reserve(points.len() * sh::coefficients(sh_degree));
    for (point, sigma) in points.iter().zip(sigmas) {
        let gaussian = Gaussian3d {
            mean: point.position,
            log_scale: Vec3::splat(sigma.ln()),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: logit(init.opacity),
            sh: vec![(Vec3::from_array(point.color) - 0.5) / SH_C0],
        };
        scene.push(gaussian.with_degree(sh_degree));
    }
    scene
}

/// Points of random colours where the cameras look: in a cube around the [`Focus`], where there is
/// one (*source:* 3DGS for scenes without points), otherwise along rays through random pixels of
/// random cameras.
fn random_points(cameras: &[Camera], count: usize, rng: &mut Rng) -> Vec<Point> {
    let focus = Focus::of(cameras);
    let extent = extent_of(cameras, &[]);
    (0..count)
        .map(|_| {
            let position = match focus {
                Some(Focus { point, distance }) => {
                    let offset = Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0f32..1.0)));
                    point + offset * (CUBE_SHARE * distance)
                }
                None if cameras.is_empty() => Vec3::ZERO,
                None => along_a_ray(&cameras[rng.random_range(0..cameras.len())], extent, rng),
            };
            Point { position, color: std::array::from_fn(|_| rng.random_range(0.0f32..1.0)) }
        })
        .collect()
}

fn along_a_ray(camera: &Camera, extent: f32, rng: &mut Rng) -> Vec3 {
    let pixel = Vec2::new(rng.random_range(0.0..camera.width as f32), rng.random_range(0.0..camera.height as f32));
    let [nearest, farthest] = DEPTHS.map(|depth| (depth * extent).max(camera.near));
    let share = rng.random_range(0.0f32..1.0);
    let depth = 1.0 / ((1.0 - share) / nearest + share / farthest);
    let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
    camera.rotation.transpose() * (ray * depth - camera.translation)
}

/// Settings files leave out numbers that are 0 by default.
pub(crate) fn is_zero(value: &f32) -> bool {
    *value == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::geometry::tests::looking_at;

    fn rng() -> Rng {
        Rng::new(5, 6)
    }

    fn around(object: Vec3) -> Vec<Camera> {
        let from = |i: usize| {
            let angle = 0.7 * i as f32;
            looking_at(object + 4.03 * Vec3::new(angle.cos(), angle.sin(), 0.5).normalize(), object, 40)
        };
        (0..9).map(from).collect()
    }

    #[test]
    fn points_become_gaussians_of_their_colour_and_distance() {
        let at = |x: f32| Point { position: Vec3::new(x, 0.0, 0.0), color: [1.0, 0.5, 0.0] };
        let points = [at(0.0), at(1.0), at(2.0), at(4.0)];
        let init = PointInit { scale: 0.5, ..PointInit::default() };
        let scene = gaussians_at(&points, &init, 2);
        scene.validate().unwrap();
        assert_eq!((scene.len(), scene.sh_len()), (4, 9));
        let sigma = 0.5 * ((1.0f32 + 4.0 + 16.0) / 3.0).sqrt();
        assert!((scene.log_scales[0] - sigma.ln()).abs().max_element() < 1e-5);
        let seen = sh::color(2, Vec3::new(0.6, 0.0, 0.8), &scene.gaussian(3).sh);
        assert!((Vec3::from_array(seen) - Vec3::new(1.0, 0.5, 0.0)).abs().max_element() < 1e-5, "{seen:?}");
        assert!((gs_core::sigmoid(scene.opacity_logits[1]) - 0.1).abs() < 1e-6);
    }

    #[test]
    fn random_points_fill_what_the_cameras_look_at() {
        let object = Vec3::new(2.0, 3.0, -1.0);
        let points = random_points(&around(object), 2000, &mut rng());
        let reach = |p: &Point| (p.position - object).abs().max_element();
        assert!(points.iter().all(|p| reach(p) < 1.31), "within the cube of 3DGS");
        assert!(points.iter().filter(|p| reach(p) > 1.0).count() > 800, "and filling it");
        assert_eq!(points, random_points(&around(object), 2000, &mut rng()));
    }

    #[test]
    fn cameras_without_a_focus_see_their_random_points() {
        let outward = |i: usize| {
            let direction = Vec3::new((i as f32).cos(), (i as f32).sin(), 0.1);
            looking_at(direction, 3.0 * direction, 40)
        };
        let cameras: Vec<Camera> = (0..6).map(outward).collect();
        for point in random_points(&cameras, 500, &mut rng()) {
            let inside = |camera: &Camera| {
                camera.project(point.position).is_some_and(|(at, _)| (at - 20.0).abs().max_element() < 20.1)
            };
            assert!(cameras.iter().any(inside), "{point:?}");
        }
        let alone = [Camera::looking_forward(8, 8, 1.0)];
        assert!(random_points(&alone, 9, &mut rng()).iter().all(|p| p.position.is_finite() && p.position.z > 0.0));
    }

    #[test]
    fn a_start_keeps_to_the_budget_and_refuses_nothing_and_too_much() {
        let cameras = around(Vec3::ZERO);
        let points = random_points(&cameras, 50, &mut rng());
        let init = PointInit::default();
        let start = |start: Start, budget| start.scene(&cameras, &init, budget, 1, &mut rng());
        let thinned = start(Start::Points(points.clone()), 20).unwrap();
        assert_eq!(thinned.len(), 20);
        assert!(thinned.means.iter().all(|mean| points.iter().any(|p| p.position == *mean)));
        assert_eq!(start(Start::Random, 30).unwrap().len(), 30);
        let fewer = PointInit { most_points: Some(7), ..init };
        let of_seven = Start::Points(points.clone()).scene(&cameras, &fewer, 20, 1, &mut rng()).unwrap();
        assert_eq!(of_seven.len(), 7);
        assert!(PointInit { most_points: Some(0), ..init }.validate().is_err());
        let far = Point { position: Vec3::new(0.0, 1e30, 0.0), color: [0.0; 3] };
        let lost = Point { position: Vec3::new(0.0, f32::NAN, 0.0), color: [0.0; 3] };
        assert_eq!(start(Start::Points(vec![points[0], far, lost]), 9).unwrap().len(), 1);
        for empty in [Start::Points(vec![far, lost]), Start::Points(Vec::new()), Start::Scene(Scene3d::default())] {
            assert!(matches!(start(empty, 9), Err(Error::Setting { .. })));
        }
        assert!(start(Start::Scene(thinned.clone()), 19).is_err());
        let same = start(Start::Scene(thinned.clone()), 20).unwrap();
        assert_eq!(same, thinned);
    }
}
