//! `gs render --ortho`: the scene from straight above, and the places of its pixels in the world.

use std::path::Path;

use glam::{DVec2, DVec3, Vec2, Vec3};
use gs_core::{Camera, Scene3d, constants::MAX_SIDE_PX, view::Bulk};
use gs_io::{GeoReference, WorldFrame};

use super::CameraArgs;
use crate::{failure::Failure, flags::values::Size};

/// Distance of the camera of an orthographic picture in radii of the scene. A point that is a radius above or below the
/// centre moves by a 4000th of its distance from the middle of the picture: by 1/8 px at the border of 1000 px.
const FAR: f32 = 4000.0;

/// Whether a picture of this name is a TIFF.
pub(super) fn is_tiff(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("tif") || ending.eq_ignore_ascii_case("tiff"))
}

/// The up direction of a plan. Without `--up`, it is z if the frame of the scene moves the origin, as for UTM
/// coordinates, or if `--epsg` names a coordinate system.
pub(super) fn up(args: &CameraArgs, frame: &WorldFrame) -> Vec3 {
    let is_map = frame.origin != DVec3::ZERO || args.epsg.is_some();
    args.up.unwrap_or(if is_map { Vec3::Z } else { Vec3::NEG_Y })
}

/// A camera so far above the scene that its rays are parallel, with this many pixels a unit. In its picture, if `up` is
/// z, x is to the right and y is up; if `up` is -z, x is to the left.
pub(super) fn camera(scene: &Scene3d, scale: f64, size: Option<Size>, up: Vec3) -> Result<Camera, Failure> {
    let bulk = Bulk::of(scene).ok_or_else(|| Failure::failed("the scene has no Gaussian that could be seen"))?;
    let scale = scale as f32;
    let side = (2.0 * bulk.radius * scale).ceil().clamp(1.0, MAX_SIDE_PX as f32) as u32;
    let Size { width, height } = size.unwrap_or(Size { width: side, height: side });
    let distance = FAR * bulk.radius;
    let ahead = if up.z == 0.0 { Vec3::Z } else { Vec3::Y };
    let lens = Camera { focal: Vec2::splat(scale * distance), ..Camera::looking_forward(width, height, 1.0) };
    lens.looking_at(bulk.center + up * distance, bulk.center, ahead)
        .ok_or_else(|| Failure::failed("the scene is too large to be seen from outside; gs info shows its extent"))
}

/// The size and place of the pixels of a plan in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plan {
    /// Side of a pixel, world units.
    pixel: f64,
    frame: WorldFrame,
    /// The place on a map, if the scene has a frame or `--epsg` is given, and the picture shows the world's x and y
    /// axes.
    pub(super) place: Option<GeoReference>,
}

impl Plan {
    /// The plan that a camera of [`camera`] draws.
    pub(super) fn of(camera: &Camera, scale: f64, frame: WorldFrame, epsg: Option<u16>) -> Result<Self, Failure> {
        let pixel = frame.unit / scale;
        // The axes of the picture are axes of the world, up to rounding.
        let [right, down] = [0, 1].map(|row| camera.rotation.row(row).as_dvec3().round());
        let is_level = right.z == 0.0 && down.z == 0.0;
        if epsg.is_some() && !is_level {
            let failure = Failure::usage("only a plan along the z axis shows the x and y axes of a map").at("--epsg");
            return Err(failure.hint("use --up z"));
        }
        let place = (is_level && (epsg.is_some() || !frame.is_world())).then(|| {
            let (column, row) = (pixel * right.truncate(), pixel * down.truncate());
            let middle = frame.to_world(camera.position().as_dvec3()).truncate();
            let DVec2 { x: columns, y: rows } = 0.5 * DVec2::new(camera.width.into(), camera.height.into());
            GeoReference { corner: middle - columns * column - rows * row, column, row, epsg }
        });
        Ok(Self { pixel, frame, place })
    }

    /// The size of a pixel: `0.05 world units each`.
    pub(super) fn describe(&self) -> String {
        let digits = 10f64.powi(5 - self.pixel.log10().floor() as i32);
        let unit = if self.frame.is_world() { "scene" } else { "world" };
        format!("{} {unit} units each", (self.pixel * digits).round() / digits)
    }

    /// Why the plan has no place on a map, if it has none.
    pub(super) fn why_unplaced(&self) -> Option<&'static str> {
        let why = match self.frame.is_world() {
            true => "the scene has no world frame; --epsg says that its x and y are map coordinates",
            false => "only --up z shows the x and y axes of the world",
        };
        self.place.is_none().then_some(why)
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec3;

    use super::*;

    fn scene() -> Scene3d {
        let gaussian = |x: f32, y: f32, z: f32| gs_core::Gaussian3d {
            mean: Vec3::new(x, y, z),
            log_scale: Vec3::splat(-5.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 2.0,
            sh: vec![Vec3::ZERO],
        };
        (0..20).map(|i| gaussian((i % 5) as f32 - 2.0, (i % 3) as f32 - 1.0, (i / 5) as f32)).collect()
    }

    #[test]
    fn a_picture_from_above_has_one_scale() {
        let camera = camera(&scene(), 100.0, None, Vec3::NEG_Y).unwrap();
        camera.validate().unwrap();
        let at = |x, y, z| camera.project(Vec3::new(x, y, z)).unwrap().0;
        for height in [-1.0, 1.0] {
            let right = at(1.0, height, 2.0) - at(0.0, height, 2.0);
            let ahead = at(0.0, height, 3.0) - at(0.0, height, 2.0);
            assert!(right.distance(Vec2::new(100.0, 0.0)) < 0.1, "{right}");
            assert!(ahead.distance(Vec2::new(0.0, -100.0)) < 0.1, "{ahead}");
        }
        assert!(at(2.0, 1.0, 2.0).distance(at(2.0, -1.0, 2.0)) < 0.2);
    }

    #[test]
    fn places_on_the_map_are_where_the_camera_draws_them() {
        let frame = WorldFrame { origin: dvec3(512_000.0, 5_412_000.0, 300.0), unit: 100.0 };
        let size = Some(Size { width: 640, height: 480 });
        for up in [Vec3::Z, Vec3::NEG_Z] {
            let camera = camera(&scene(), 30.0, size, up).unwrap();
            let plan = Plan::of(&camera, 30.0, frame, None).unwrap();
            assert_eq!(plan.describe(), "3.33333 world units each");
            let GeoReference { corner, column, row, .. } = plan.place.unwrap();
            assert!(row == DVec2::new(0.0, -10.0 / 3.0) || up == Vec3::NEG_Z, "north is up");
            for place in [Vec3::ZERO, Vec3::new(3.4525, 3.455, 1.0), Vec3::new(-2.5, 1.5, 2.0)] {
                let pixel = camera.project(place).unwrap().0.as_dvec2();
                let on_map = corner + pixel.x * column + pixel.y * row;
                let world = frame.to_world(place.as_dvec3()).truncate();
                assert!(on_map.distance(world) < 0.05 * plan.pixel, "{on_map} and not {world}");
            }
        }
    }

    #[test]
    fn a_plan_without_frame_or_along_another_axis_has_no_place() {
        let (above, ahead) =
            (camera(&scene(), 8.0, None, Vec3::Z).unwrap(), camera(&scene(), 8.0, None, Vec3::NEG_Y).unwrap());
        let frame = WorldFrame { unit: 10.0, ..WorldFrame::WORLD };
        let unplaced = Plan::of(&above, 8.0, WorldFrame::WORLD, None).unwrap();
        assert_eq!((unplaced.place, unplaced.describe().as_str()), (None, "0.125 scene units each"));
        assert!(Plan::of(&above, 8.0, WorldFrame::WORLD, Some(25832)).unwrap().place.is_some());
        assert!(Plan::of(&above, 8.0, frame, None).unwrap().why_unplaced().is_none());
        assert!(Plan::of(&ahead, 8.0, frame, None).unwrap().why_unplaced().unwrap().contains("--up z"));
        assert!(Plan::of(&ahead, 8.0, frame, Some(25832)).is_err());
    }
}
