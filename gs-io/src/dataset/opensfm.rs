//! `reconstruction.json` of OpenSfM and OpenDroneMap: cameras, shots and points.
//!
//! The file is a list of reconstructions, pieces that do not hang together. A shot has the name of its
//! image, the name of its camera, and the pose from the world to the camera with axes right, down,
//! forward: an angle-axis vector, rad, and a translation. Focal lengths and the principal point are
//! relative to the longer side of the image, the principal point from the image's centre. OpenDroneMap
//! puts the file into `opensfm`, next to `images`.
//!
//! *Source:* OpenSfM's documentation ("Reconstruction file format", "Geometric Models"), and for keys
//!   of cameras, half pixels and coefficients its `io.py`, `features.py` and
//!   `camera_distortions_functions.h`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use glam::{DQuat, DVec2, DVec3, dvec2};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::{
    Dataset, DatasetKind, DatasetSettings, Remark, Skip,
    camera::{Intrinsics, Pose},
    read::{
        CameraFields, Draft, IMAGE_FOLDERS, Number, Parts, Place, Refusal, Stated, WorldPoint, assemble_named, parse,
        shown, whole,
    },
};
use crate::error::Error;

/// The file of such a data set.
pub(super) const RECONSTRUCTION: &str = "reconstruction.json";

/// The folder of OpenDroneMap with the file.
pub(super) const FOLDER: &str = "opensfm";

/// Values of `projection_type`; the first is the default.
const PERSPECTIVE: [&str; 4] = ["perspective", "brown", "radial", "simple_radial"];
const FISHEYE: [&str; 2] = ["fisheye", "fisheye_opencv"];
const PANORAMA: [&str; 2] = ["spherical", "equirectangular"];

/// Keys of a camera's numbers.
const NUMBERS: [&str; 13] =
    ["width", "height", "focal", "focal_x", "focal_y", "c_x", "c_y", "k1", "k2", "k3", "k4", "p1", "p2"];

/// A piece of the file.
#[derive(Debug, Default, Deserialize)]
struct Reconstruction {
    cameras: BTreeMap<String, Map<String, Value>>,
    shots: BTreeMap<String, Shot>,
    #[serde(default)]
    points: BTreeMap<String, Point>,
}

/// An image.
#[derive(Debug, Deserialize)]
struct Shot {
    camera: String,
    rotation: [Number; 3],
    #[serde(default = "origin")]
    translation: [Number; 3],
}

#[derive(Debug, Deserialize)]
struct Point {
    coordinates: [Number; 3],
    /// 0 to 255.
    color: [Number; 3],
}

fn origin() -> [Number; 3] {
    [Number(0.0); 3]
}

fn vector(numbers: [Number; 3]) -> DVec3 {
    DVec3::from_array(numbers.map(|number| number.0))
}

/// Reads the data set of a `reconstruction.json`.
pub(super) fn read(named: &Path, file: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let mut pieces: Vec<Reconstruction> = parse(file)?;
    // Stable, so the first of equal ones.
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.shots.len()));
    let sizes: Vec<String> = pieces.iter().map(|piece| gs_core::counted(piece.shots.len(), "image")).collect();
    let remarks = match &sizes[..] {
        [read, others @ ..] if !others.is_empty() => {
            let piece = |size: &String| format!("a piece of {size}");
            vec![Remark::OtherModels { read: piece(read), others: others.iter().map(piece).collect() }]
        }
        _ => Vec::new(),
    };
    let Reconstruction { cameras, shots, points } = pieces.into_iter().next().unwrap_or_default();
    let root = &project(named, file);
    let draft = |(name, shot): (&String, &Shot)| {
        let camera = cameras.get(&shot.camera).map(|own| CameraFields { own, shared: None });
        let camera = camera.map(|fields| Camera { name: &shot.camera, fields });
        let intrinsics = camera.as_ref().map_or(Ok(Err(Skip::NoCamera.into())), |camera| camera.intrinsics(file))?;
        let stated = camera.map(|camera| camera.stated()).unwrap_or_default();
        let rotation = DQuat::from_scaled_axis(vector(shot.rotation));
        let pose = Pose::world_to_camera(rotation, vector(shot.translation));
        Ok(Draft::of_image(root, name, intrinsics, stated, pose))
    };
    let drafts = shots.iter().map(draft).collect::<Result<_, Error>>()?;
    let point = |point: Point| WorldPoint {
        position: vector(point.coordinates),
        color: point.color.map(|channel| (channel.0 / 255.0).clamp(0.0, 1.0) as f32),
    };
    let (points, places) = (points.into_values().map(point).collect(), Place::usual(root, settings)?);
    let parts = Parts { kind: DatasetKind::OpenSfm, root, drafts, points, places, split: None, remarks };
    assemble_named(parts, file, settings)
}

/// The folder of the data set: the one that was named, or the one above OpenDroneMap's `opensfm`.
fn project(named: &Path, file: &Path) -> PathBuf {
    let whole = whole(named);
    let has_images = |folder: &Path| IMAGE_FOLDERS.iter().any(|name| folder.join(name).is_dir());
    let is_inner = whole.ends_with(FOLDER) && file.parent() == Some(named) && !has_images(named);
    let above = whole.parent().filter(|above| is_inner && has_images(above));
    above.map_or_else(|| named.to_owned(), Path::to_owned)
}

/// A camera of the file.
struct Camera<'a> {
    name: &'a str,
    fields: CameraFields<'a>,
}

impl Camera<'_> {
    /// A number greater than 0.
    fn positive(&self, key: &str) -> Result<f64, String> {
        let found = self.fields.between(key, 0.0, f64::INFINITY, "greater than 0")?;
        found.ok_or_else(|| format!("{key} is missing"))
    }

    /// The intrinsics; inside, why the camera is impossible, with the key.
    ///
    /// # Errors
    /// [`Error::Unusable`] for an unknown `projection_type`.
    fn intrinsics(&self, file: &Path) -> Result<Result<Intrinsics, Refusal>, Error> {
        let kind = self.fields.get("projection_type").map_or(PERSPECTIVE[0], |kind| kind.as_str().unwrap_or_default());
        if !PERSPECTIVE.iter().chain(&FISHEYE).chain(&PANORAMA).any(|known| *known == kind) {
            let known = [&PERSPECTIVE[..], &FISHEYE, &PANORAMA].concat().join(", ");
            let found = self.fields.get("projection_type").map_or_else(String::new, shown);
            return Err(Error::unknown_camera_model(file, found, &known));
        }
        let refused = |fault| Refusal::new(Skip::BadCamera, format!("in camera {}, {fault}", self.name));
        // OpenSfM's way to write NaN.
        if let Some((key, _)) = self.fields.own.iter().find(|(_, value)| value.is_null()) {
            return Ok(Err(refused(format!("{key} is NaN, but must be a number"))));
        }
        Ok(self.numbers(kind).map_err(refused))
    }

    fn numbers(&self, kind: &str) -> Result<Intrinsics, String> {
        let size = dvec2(self.positive("width")?, self.positive("height")?);
        if PANORAMA.contains(&kind) {
            return Ok(Intrinsics::panorama(Some(size)));
        }
        let focal = match self.fields.get("focal").is_some() {
            true => DVec2::splat(self.positive("focal")?),
            false => dvec2(self.positive("focal_x")?, self.positive("focal_y")?),
        };
        let offset = |key| Ok::<_, String>(self.fields.number(key)?.unwrap_or_default());
        let center = dvec2(offset("c_x")?, offset("c_y")?);
        let distortion = self.fields.distortion(FISHEYE.contains(&kind))?;
        let longer = size.max_element();
        Ok(Intrinsics::new(focal * longer, Some(0.5 * size + center * longer), size, distortion))
    }

    /// The numbers with their keys, for messages.
    fn stated(&self) -> Stated {
        let numbers = self.fields.numbers(NUMBERS);
        Stated { place: format!("camera {} of {RECONSTRUCTION}", self.name), numbers }
    }
}
