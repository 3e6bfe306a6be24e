//! `transforms.json` of Nerfstudio and instant-ngp, and the three files of NeRF-synthetic.
//!
//! Poses are camera-to-world with axes right, up, back (OpenGL), in the file's own world.
//! Nerfstudio may have rotated that world (`applied_transform`) relative to the COLMAP model it was
//! made from. Its `ply_file_path` is already in the file's world; a COLMAP model beside it is not.
//!
//! *Source:* Nerfstudio's documentation ("Data conventions"), and the files of NeRF-synthetic
//! (Mildenhall et al. 2020).

use std::{
    collections::HashSet,
    path::{Path, PathBuf},
};

use glam::{DMat3, DVec3, dvec2};
use serde::{Deserialize, de::DeserializeOwned};

use super::{
    BrownConrady, Dataset, DatasetKind, DatasetSettings, DepthFile, Distortion, Fisheye, Remark, Skip, Split,
    WorldPoint,
    assemble::{Draft, Focal, Intrinsics, Parts, Stated, assemble},
    colmap::{ColmapModel, points_of},
    place::{IMAGE_FOLDERS, NamePart, Place, check_inside, find_image},
    point_cloud,
    pose::{Pose, affine},
    read_file,
};
use crate::error::Error;

/// The file of a Nerfstudio data set.
pub(super) const NERFSTUDIO: &str = "transforms.json";
/// The first file of a NeRF-synthetic data set.
pub(super) const BLENDER_TRAIN: &str = "transforms_train.json";

/// All files of a NeRF-synthetic data set.
const BLENDER: [(&str, Split); 3] =
    [(BLENDER_TRAIN, Split::Train), ("transforms_val.json", Split::Validation), ("transforms_test.json", Split::Test)];

/// World units of a stored 1 in a depth map: Nerfstudio's `depth_unit_scale_factor`, for depths in
/// millimetres.
const DEPTH_UNIT: f32 = 1e-3;

/// Where Nerfstudio stores the COLMAP model that it started from.
const NERFSTUDIO_COLMAP: &str = "colmap/sparse/0";

/// The transformation of COLMAP's world by Nerfstudio versions that did not write
/// `applied_transform`.
const OLD_TRANSFORM: DMat3 = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::NEG_Z);

/// The content of the file.
#[derive(Debug, Deserialize)]
struct Transforms {
    /// Intrinsics of frames without their own.
    #[serde(flatten)]
    camera: CameraFields,
    frames: Vec<Frame>,
    /// Transform from COLMAP's world to the file's, 3×4 by rows.
    applied_transform: Option<Vec<Vec<f64>>>,
    applied_scale: Option<f64>,
    ply_file_path: Option<String>,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
}

/// An image.
#[derive(Debug, Deserialize)]
struct Frame {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    mask_path: Option<String>,
    depth_file_path: Option<String>,
    #[serde(flatten)]
    camera: CameraFields,
}

/// Intrinsics, shared or of a frame. Lengths in px, angles in rad.
#[derive(Debug, Clone, Default, Deserialize)]
struct CameraFields {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

impl CameraFields {
    /// Returns these intrinsics, completed by the shared ones.
    fn or(&self, shared: &Self) -> Self {
        Self {
            camera_model: self.camera_model.clone().or_else(|| shared.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(shared.is_fisheye),
            camera_angle_x: self.camera_angle_x.or(shared.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(shared.camera_angle_y),
            fl_x: self.fl_x.or(shared.fl_x),
            fl_y: self.fl_y.or(shared.fl_y),
            cx: self.cx.or(shared.cx),
            cy: self.cy.or(shared.cy),
            w: self.w.or(shared.w),
            h: self.h.or(shared.h),
            k1: self.k1.or(shared.k1),
            k2: self.k2.or(shared.k2),
            k3: self.k3.or(shared.k3),
            k4: self.k4.or(shared.k4),
            p1: self.p1.or(shared.p1),
            p2: self.p2.or(shared.p2),
        }
    }

    /// The numbers that are present, by their keys.
    fn numbers(&self) -> Vec<(&'static str, f64)> {
        let Self { camera_model: _, is_fisheye: _, camera_angle_x, camera_angle_y, fl_x, fl_y, cx, cy, w, h, .. } =
            self;
        let Self { k1, k2, k3, k4, p1, p2, .. } = self;
        let all = [
            ("camera_angle_x", camera_angle_x),
            ("camera_angle_y", camera_angle_y),
            ("fl_x", fl_x),
            ("fl_y", fl_y),
            ("cx", cx),
            ("cy", cy),
            ("w", w),
            ("h", h),
            ("k1", k1),
            ("k2", k2),
            ("k3", k3),
            ("k4", k4),
            ("p1", p1),
            ("p2", p2),
        ];
        all.into_iter().filter_map(|(key, value)| Some((key, (*value)?))).collect()
    }

    fn intrinsics(&self, path: &Path) -> Result<Result<Intrinsics, Skip>, Error> {
        let zero = Option::unwrap_or_default;
        let radial = [self.k1, self.k2, self.k3, self.k4].map(zero);
        let tangential = [self.p1, self.p2].map(zero);
        let model = self.camera_model.as_deref();
        let distortion = match model.unwrap_or(if self.is_fisheye == Some(true) { FISHEYE[0] } else { PERSPECTIVE[0] })
        {
            name if FISHEYE.contains(&name) => Distortion::Fisheye(Fisheye { radial, ..Fisheye::default() }),
            name if PERSPECTIVE.contains(&name) => {
                match (BrownConrady { radial, tangential, ..BrownConrady::default() }) {
                    none if none == BrownConrady::default() => Distortion::None,
                    bent => Distortion::BrownConrady(bent),
                }
            }
            // The lengths fl_x, fl_y, cx and cy of a 360° image follow from its size.
            PANORAMA => {
                let size = self.w.zip(self.h).map(|(w, h)| dvec2(w, h));
                return Ok(Ok(Intrinsics::panorama(size)));
            }
            other => {
                let known = [&FISHEYE[..], &PERSPECTIVE, &[PANORAMA]].concat().join(", ");
                let found = other.chars().filter(|c| !c.is_control()).take(40).collect();
                return Err(Error::UnknownCameraModel { path: path.to_owned(), found, known });
            }
        };
        let focal = match (self.fl_x, self.fl_y, self.camera_angle_x) {
            (Some(x), y, _) => Focal::Lengths(dvec2(x, y.unwrap_or(x))),
            (None, Some(y), None) => Focal::Lengths(dvec2(y, y)),
            (None, _, Some(x)) => Focal::Angles(x, self.camera_angle_y),
            (None, None, None) => return Ok(Err(Skip::BadCamera)),
        };
        let both = |x: Option<f64>, y: Option<f64>| x.zip(y).map(|(x, y)| dvec2(x, y));
        Ok(Ok(Intrinsics { focal, center: both(self.cx, self.cy), size: both(self.w, self.h), distortion }))
    }
}

/// Values of `camera_model` for the perspective model; the first is the default.
const PERSPECTIVE: [&str; 6] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"];
const FISHEYE: [&str; 4] = ["OPENCV_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];
const PANORAMA: &str = "EQUIRECTANGULAR";

impl Frame {
    fn draft(&self, root: &Path, file: &Path, shared: &CameraFields, split: Option<Split>) -> Result<Draft, Error> {
        let name = self.file_path.trim_start_matches("./").to_owned();
        let camera = self.camera.or(shared);
        let place = file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Ok(Draft {
            file: Some(PathBuf::from(&name)),
            name,
            depth: self
                .depth_file_path
                .as_ref()
                .map(|depth| root.join(depth))
                .filter(|path| path.is_file())
                .map(|path| DepthFile { path, unit: Some(DEPTH_UNIT) }),
            mask: self.mask_path.as_ref().and_then(|mask| find_image(&root.join(mask))),
            intrinsics: camera.intrinsics(file)?,
            stated: Stated { place, numbers: camera.numbers() },
            pose: Pose::camera_to_world(&self.transform_matrix),
            split,
        })
    }
}

impl Transforms {
    fn check_inside(&self, root: &Path, path: &Path, settings: &DatasetSettings) -> Result<(), Error> {
        let images = self.frames.iter().map(|frame| ("file_path", frame.file_path.as_str()));
        let masks = self.frames.iter().filter_map(|frame| Some(("mask_path", frame.mask_path.as_deref()?)));
        let depths =
            self.frames.iter().filter_map(|frame| Some(("depth_file_path", frame.depth_file_path.as_deref()?)));
        let points = self.ply_file_path.as_deref().map(|points| ("ply_file_path", points));
        check_inside(root, path, images.chain(masks).chain(depths).chain(points), settings)
    }
}

/// Remarks on masks and depth maps that frames refer to and that do not exist.
fn missing(frames: &[Frame], drafts: &[Draft]) -> Vec<Remark> {
    let no_mask = |(frame, draft): (&Frame, &Draft)| frame.mask_path.clone().filter(|_| draft.mask.is_none());
    let no_depth = |(frame, draft): (&Frame, &Draft)| frame.depth_file_path.clone().filter(|_| draft.depth.is_none());
    let masks: Vec<String> = frames.iter().zip(drafts).filter_map(no_mask).collect();
    let depths: Vec<String> = frames.iter().zip(drafts).filter_map(no_depth).collect();
    let masks = masks.first().map(|first| Remark::MasksMissing { count: masks.len(), first: first.clone() });
    let depths = depths.first().map(|first| Remark::DepthsMissing { count: depths.len(), first: first.clone() });
    masks.into_iter().chain(depths).collect()
}

/// Reads a data set in the format of NeRF-synthetic.
pub(super) fn read_blender(root: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let (mut drafts, mut points, mut remarks) = (Vec::new(), Vec::new(), Vec::new());
    for (name, split) in BLENDER {
        let path = root.join(name);
        if !path.is_file() {
            continue;
        }
        let file: Transforms = parse(&path)?;
        file.check_inside(root, &path, settings)?;
        let first = drafts.len();
        for frame in &file.frames {
            drafts.push(frame.draft(root, &path, &file.camera, Some(split))?);
        }
        remarks.extend(missing(&file.frames, &drafts[first..]));
        if points.is_empty() {
            points = listed_points(root, &file, &mut remarks)?.unwrap_or_default();
        }
    }
    let places = places(root, settings)?;
    assemble(Parts { kind: DatasetKind::Blender, root, drafts, points, places, remarks }, settings)
}

/// Reads a `transforms.json` with files below `root`.
pub(super) fn read_nerfstudio(root: &Path, path: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let file: Transforms = parse(path)?;
    file.check_inside(root, path, settings)?;
    let split_of = |names: &Option<Vec<String>>| -> HashSet<String> {
        names.iter().flatten().map(|name| name.trim_start_matches("./").to_owned()).collect()
    };
    let (validation, test) = (split_of(&file.val_filenames), split_of(&file.test_filenames));
    let says = [&file.train_filenames, &file.val_filenames, &file.test_filenames].iter().any(|names| names.is_some());
    let mut drafts = Vec::with_capacity(file.frames.len());
    for frame in &file.frames {
        let mut draft = frame.draft(root, path, &file.camera, None)?;
        draft.split = says.then(|| match &draft.name {
            name if test.contains(name) => Split::Test,
            name if validation.contains(name) => Split::Validation,
            _ => Split::Train,
        });
        drafts.push(draft);
    }
    let mut remarks = missing(&file.frames, &drafts);
    let points = match listed_points(root, &file, &mut remarks)? {
        Some(points) => points,
        None => colmap_points(root, &file)?,
    };
    let places = places(root, settings)?;
    assemble(Parts { kind: DatasetKind::Nerfstudio, root, drafts, points, places, remarks }, settings)
}

/// Where images may be: the frames' own paths and smaller copies, or the folder of the settings.
fn places(root: &Path, settings: &DatasetSettings) -> Result<Vec<Place>, Error> {
    if let Some(place) = Place::chosen(root, settings, NamePart::FileName)? {
        return Ok(vec![place]);
    }
    let own = Place { folder: root.to_owned(), part: NamePart::Path, shrunk: 1.0 };
    let copies = IMAGE_FOLDERS.iter().map(|name| Place::new(root, name, NamePart::FileName));
    Ok(std::iter::once(own).chain(copies).collect())
}

/// The points of the referenced file; `None` without a reference.
fn listed_points(root: &Path, file: &Transforms, remarks: &mut Vec<Remark>) -> Result<Option<Vec<WorldPoint>>, Error> {
    let Some(name) = &file.ply_file_path else { return Ok(None) };
    match point_cloud::read(&root.join(name)) {
        Err(Error::Missing { .. }) => {
            remarks.push(Remark::PointsMissing { file: name.clone() });
            Ok(Some(Vec::new()))
        }
        other => other.map(Some),
    }
}

/// The points of the COLMAP model beside the file, in the file's world.
fn colmap_points(root: &Path, file: &Transforms) -> Result<Vec<WorldPoint>, Error> {
    let folder = root.join(NERFSTUDIO_COLMAP);
    let (linear, offset) = match &file.applied_transform {
        None => (OLD_TRANSFORM, DVec3::ZERO),
        // With an invalid transform, the place of the points is unknown.
        Some(rows) => match affine(rows) {
            Some(transform) => transform,
            None => return Ok(Vec::new()),
        },
    };
    if !folder.join("points3D.bin").is_file() && !folder.join("points3D.txt").is_file() {
        return Ok(Vec::new());
    }
    let scale = file.applied_scale.unwrap_or(1.0);
    let mut model = ColmapModel::read(&folder)?;
    model.points.iter_mut().for_each(|point| point.position = (linear * point.position + offset) * scale);
    Ok(points_of(&model.points).collect())
}

fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    serde_json::from_slice(&read_file(path)?).map_err(|error| {
        let message = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        Error::DamagedJson { path: path.to_owned(), message }
    })
}
