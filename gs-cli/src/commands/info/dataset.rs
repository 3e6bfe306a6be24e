//! `gs info` of a data set: its views, cameras and points, and the reader's remarks.

use std::{collections::BTreeMap, fmt::Write};

use gs_core::counted;
use gs_io::dataset::{Dataset, DatasetKind, SourceCamera, Split, SplitOrigin, View};
use serde::Serialize;

use super::rows_text;
use crate::{failure::Failure, flags::dataset::remark_text, terminal::output};

/// Cameras that are printed in full. The others are counted.
const CAMERAS_SHOWN: usize = 4;

/// What `gs info --json` prints of a data set.
#[derive(Debug, Serialize)]
struct Info {
    kind: &'static str,
    made_by: DatasetKind,
    views: usize,
    train: usize,
    validation: usize,
    test: usize,
    split: SplitOrigin,
    cameras: Vec<CameraInfo>,
    points: usize,
    masks: usize,
    depth_maps: usize,
    remarks: Vec<String>,
}

/// A camera, and how many views it took.
#[derive(Debug, Serialize)]
struct CameraInfo {
    views: usize,
    /// Columns and rows of its images, px.
    image: [u32; 2],
    /// Columns and rows after the images are undistorted and scaled down, px.
    undistorted: [u32; 2],
    /// Focal lengths in x and y, px.
    focal: [f64; 2],
    /// Horizontal and vertical after that, degrees.
    field_of_view: [f64; 2],
    lens: &'static str,
    /// Whether the camera takes 360° images. Each of them is split into six views.
    all_directions: bool,
    /// Whether each image is split into several views: a 360° image, or one of a wide fish-eye.
    faces: bool,
}

/// Prints the content of a data set.
pub(super) fn print(dataset: &Dataset, json: bool) -> Result<(), Failure> {
    let info = Info::of(dataset);
    output::answer(json, &info, || text(&info))
}

impl Info {
    fn of(dataset: &Dataset) -> Self {
        let count = |split| dataset.views_of(split).count();
        let mut cameras: Vec<(SourceCamera, CameraInfo)> = Vec::new();
        for view in &dataset.views {
            let camera = view.source.front();
            match cameras.iter_mut().find(|(source, _)| *source == camera) {
                Some((_, found)) => found.views += 1,
                None => cameras.push((camera, CameraInfo::of(view))),
            }
        }
        Self {
            kind: "dataset",
            made_by: dataset.kind,
            views: dataset.views.len(),
            train: count(Split::Train),
            validation: count(Split::Validation),
            test: count(Split::Test),
            split: dataset.split,
            cameras: cameras.into_iter().map(|(_, camera)| camera).collect(),
            points: dataset.points.len(),
            masks: dataset.views.iter().filter(|view| view.mask.is_some()).count(),
            depth_maps: dataset.views.iter().filter(|view| view.depth.is_some()).count(),
            remarks: dataset.remarks.iter().map(remark_text).collect(),
        }
    }
}

impl CameraInfo {
    fn of(view: &View) -> Self {
        let View { camera, source, .. } = view;
        let angle = |side: u32, focal: f32, center: f32| {
            let (before, after) = (f64::from(center), f64::from(side) - f64::from(center));
            ((before / f64::from(focal)).atan() + (after / f64::from(focal)).atan()).to_degrees()
        };
        Self {
            views: 1,
            image: [source.width, source.height],
            undistorted: [camera.width, camera.height],
            focal: source.focal.to_array(),
            field_of_view: [
                angle(camera.width, camera.focal.x, camera.center.x),
                angle(camera.height, camera.focal.y, camera.center.y),
            ],
            lens: source.lens_name(),
            all_directions: source.is_panorama(),
            faces: source.is_face(),
        }
    }
}

fn text(info: &Info) -> String {
    let mut rows = vec![("kind", format!("{} data set", info.made_by.name()))];
    let splits = [("train", info.train), ("validation", info.validation), ("test", info.test)];
    let splits: Vec<_> = splits.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!("{n} {name}")).collect();
    rows.push(("views", format!("{}: {}", info.views, splits.join(", "))));
    rows.push(("split", info.split.to_string()));
    for camera in info.cameras.iter().take(CAMERAS_SHOWN) {
        let ([width, height], [fx, fy], [x, y]) = (camera.image, camera.focal, camera.field_of_view);
        let mut line = format!("{width}x{height} px, ");
        let _ = match camera.all_directions {
            true => write!(line, "360°, {}", camera.lens),
            false if camera.faces => write!(line, "focal {fx:.1}, {fy:.1} px, {}", camera.lens),
            false => write!(line, "focal {fx:.1}, {fy:.1} px, {x:.1} x {y:.1} degrees, {}", camera.lens),
        };
        if camera.undistorted != camera.image {
            let [width, height] = camera.undistorted;
            let done = match camera.lens {
                _ if camera.all_directions => "split into six faces of",
                _ if camera.faces => "split into 90° faces of",
                "pinhole" => "scaled to",
                _ => "undistorted to",
            };
            let _ = write!(line, ", {done} {width}x{height} px");
        }
        let _ = write!(line, " ({})", counted(camera.views, "view"));
        rows.push(("camera", line));
    }
    if info.cameras.len() > CAMERAS_SHOWN {
        rows.push(("camera", format!("{} more", info.cameras.len() - CAMERAS_SHOWN)));
    }
    rows.push(("points", info.points.to_string()));
    if info.masks > 0 {
        rows.push(("masks", info.masks.to_string()));
    }
    if info.depth_maps > 0 {
        rows.push(("depth maps", info.depth_maps.to_string()));
    }
    rows.extend(info.remarks.iter().map(|remark| ("remark", remark.clone())));
    rows_text(&rows, &BTreeMap::new())
}
