//! Writing a data set with other cameras as a text model.

use std::fmt::Write as _;

use glam::DQuat;
use gs_core::Camera;

use super::CameraModel;
use crate::dataset::{Dataset, SourceCamera, Split, View};

impl Dataset {
    /// This data set as the files of COLMAP's text model, by their names: the training and test views with these
    /// cameras in place of [`View::camera`], of which only the pose counts, and the points, without the images that
    /// show them. Images have the [names](View::name) of their views.
    ///
    /// The lists of the split are not in the model; [`Self::transforms_json`] has it.
    ///
    /// `None` where a view is a face of a 360° image or of a wide fish-eye, or where COLMAP has no model of its lens.
    pub fn colmap_text(&self, camera: impl Fn(&View) -> Camera) -> Option<[(&'static str, String); 3]> {
        let [mut cameras, mut images, mut points] = [
            "# CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS\n",
            "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and a line of its keypoints, which are left out\n",
            "# POINT_ID X Y Z R G B ERROR\n",
        ]
        .map(str::to_owned);
        let mut sources: Vec<&SourceCamera> = Vec::new();
        for (view, id) in self.views.iter().filter(|view| view.split != Split::Validation).zip(1..) {
            let of_view = sources.iter().position(|source| **source == view.source);
            let index = match of_view {
                Some(index) => index,
                None => {
                    _ = writeln!(cameras, "{} {}", sources.len() + 1, intrinsics(&view.source)?);
                    sources.push(&view.source);
                    sources.len() - 1
                }
            };
            let camera = camera(view);
            let rotation = camera.rotation.as_dmat3();
            let t = -(rotation * self.frame.to_world(camera.position().as_dvec3()));
            let q = DQuat::from_mat3(&rotation).normalize();
            let name = &view.name;
            _ = writeln!(images, "{id} {} {} {} {} {} {} {} {} {name}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z, index + 1);
        }
        for (point, id) in self.points.iter().zip(1..) {
            let p = self.frame.to_world(point.position.as_dvec3());
            let [r, g, b] = point.color.map(|value| (255.0 * value).round() as u8);
            _ = writeln!(points, "{id} {} {} {} {r} {g} {b} 0", p.x, p.y, p.z);
        }
        Some([("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", points)])
    }
}

/// A camera after its number; `None` where COLMAP has no model for it.
fn intrinsics(source: &SourceCamera) -> Option<String> {
    let SourceCamera { width, height, focal, center, lens } = source;
    let (model, coefficients) = CameraModel::of(lens.distortion())?;
    let mut text = format!("{} {width} {height} {} {} {} {}", model.name(), focal.x, focal.y, center.x, center.y);
    coefficients.iter().for_each(|value| _ = write!(text, " {value}"));
    (!source.is_face()).then_some(text)
}
