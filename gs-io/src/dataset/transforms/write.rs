//! Writing a data set with other cameras as a `transforms.json`.

use std::fmt::Write as _;

use gs_core::Camera;
use serde_json::{Map, Value, json};

use crate::dataset::{BrownConrady, Dataset, Distortion, Fisheye, SourceCamera, Split, View};

/// The key of a camera's model.
const MODEL: &str = "camera_model";

impl Dataset {
    /// This data set as the text of a `transforms.json`: the training and test views with these cameras in place of
    /// [`View::camera`], of which only the pose counts. Images and masks are named by absolute paths, and points by
    /// `points`, the path of a [`Self::points_ply`] next to the file. Depth maps are left out.
    ///
    /// [`read_dataset`](super::super::read_dataset) finds the split in each frame's `split`. Nerfstudio reads the
    /// file, too, and holds out views of its own choice.
    ///
    /// `None` where the format has no form for a view: a face of a 360° image or of a wide fish-eye, or a lens
    /// that is neither OpenCV's nor its fish-eye.
    pub fn transforms_json(&self, camera: impl Fn(&View) -> Camera, points: Option<&str>) -> Option<String> {
        let absolute = |path: &std::path::Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let mut frames = Vec::new();
        for view in self.views.iter().filter(|view| view.split != Split::Validation) {
            let mut frame = intrinsics(&view.source)?;
            frame.insert("file_path".to_owned(), json!(absolute(&view.image).display().to_string()));
            frame.insert("split".to_owned(), json!(if view.split == Split::Test { "test" } else { "train" }));
            if let Some(mask) = &view.mask {
                frame.insert("mask_path".to_owned(), json!(absolute(mask).display().to_string()));
            }
            let camera = camera(view);
            let position = self.frame.to_world(camera.position().as_dvec3());
            // The rows of the world-to-camera rotation are the camera's axes: right, down, forward.
            let [right, down, forward] = [0, 1, 2].map(|row| camera.rotation.as_dmat3().row(row));
            let row = |axis: usize| [right[axis], -down[axis], -forward[axis], position[axis]];
            frame.insert("transform_matrix".to_owned(), json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]));
            frames.push(frame);
        }
        let mut file = Map::new();
        if let Some(points) = points {
            file.insert("ply_file_path".to_owned(), json!(points));
        }
        // Nerfstudio looks for the model only here.
        let model = frames.first().and_then(|frame| frame.get(MODEL)).cloned();
        if let Some(model) = model.filter(|model| frames.iter().all(|frame| frame.get(MODEL) == Some(model))) {
            file.insert(MODEL.to_owned(), model);
        }
        file.insert("frames".to_owned(), json!(frames));
        serde_json::to_string_pretty(&file).ok()
    }

    /// The points of this data set in its world as a PLY, which a `transforms.json` can name.
    pub fn points_ply(&self) -> String {
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", self.points.len());
        ["x", "y", "z"].into_iter().for_each(|axis| _ = writeln!(text, "property double {axis}"));
        ["red", "green", "blue"].into_iter().for_each(|color| _ = writeln!(text, "property uchar {color}"));
        text += "end_header\n";
        for point in &self.points {
            let place = self.frame.to_world(point.position.as_dvec3());
            let [r, g, b] = point.color.map(|value| (255.0 * value).round() as u8);
            _ = writeln!(text, "{} {} {} {r} {g} {b}", place.x, place.y, place.z);
        }
        text
    }
}

/// The fields of a camera of an image file; `None` where the format has no form for it.
fn intrinsics(source: &SourceCamera) -> Option<Map<String, Value>> {
    if source.is_face() {
        return None;
    }
    let (model, radial, tangential) = match *source.lens.distortion() {
        Distortion::None => ("OPENCV", [0.0; 4], [0.0; 2]),
        Distortion::BrownConrady(BrownConrady { radial, divisor: [0.0, 0.0, 0.0], tangential, skew: 0.0 }) => {
            ("OPENCV", radial, tangential)
        }
        Distortion::Fisheye(Fisheye { radial, tangential: [0.0, 0.0], prism: [0.0, 0.0] }) => {
            ("OPENCV_FISHEYE", radial, [0.0; 2])
        }
        _ => return None,
    };
    let mut fields = Map::new();
    fields.insert(MODEL.to_owned(), json!(model));
    fields.insert("w".to_owned(), json!(source.width));
    fields.insert("h".to_owned(), json!(source.height));
    let (focal, center) = (source.focal, source.center);
    let numbers = [("fl_x", focal.x), ("fl_y", focal.y), ("cx", center.x), ("cy", center.y)];
    let lens = ["k1", "k2", "k3", "k4"].into_iter().zip(radial).chain(["p1", "p2"].into_iter().zip(tangential));
    for (key, value) in numbers.into_iter().chain(lens.filter(|(_, value)| *value != 0.0)) {
        fields.insert(key.to_owned(), json!(value));
    }
    Some(fields)
}
