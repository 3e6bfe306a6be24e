//! COLMAP's sparse models: cameras, images and points as stored, and the data set made of them.
//!
//! *Source:* COLMAP's documentation ("Output Format"). `rigs` and `frames`, which newer versions
//!   add, contain nothing beyond the images' own poses and are not read.

mod binary;
mod camera_model;
mod models;
mod text;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use glam::{DQuat, DVec2, DVec3, dvec2};

pub use self::camera_model::CameraModel;
use self::models::{Candidate, read_largest};
pub(super) use self::models::{data_set_of, has_photographs, is_model, models_of};
use super::{
    Dataset, DatasetKind, DatasetSettings, DepthFile, Lens, Remark, Skip, SourceCamera, WorldPoint,
    camera::Pose,
    images::find_depth,
    read::{Draft, Parts, Refusal, Stated, apply_lists, assemble, find_image, lists_in_files, plain},
    read_file,
};
use crate::error::Error;

/// The folder of masks: `masks/NAME.png` for the image `images/NAME`.
const MASK_FOLDER: &str = "masks";

/// The folder of depth maps: `depths/NAME` for the image `images/NAME`, ending in `.png` or `.npy`.
const DEPTH_FOLDER: &str = "depths";

/// The id that stands for no point.
const NO_POINT: u64 = u64::MAX;

/// A sparse model as stored in its files. Only the format is checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ColmapModel {
    /// Cameras by id.
    pub cameras: BTreeMap<u32, ColmapCamera>,
    /// Registered images, in file order.
    pub images: Vec<ColmapImage>,
    /// Points, in file order.
    pub points: Vec<ColmapPoint>,
}

/// A camera, which several images may share.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapCamera {
    /// The model, which defines the parameters.
    pub model: CameraModel,
    /// Columns of the camera's images, px.
    pub width: u64,
    /// Rows of the camera's images, px.
    pub height: u64,
    /// The parameters, in the order of [`CameraModel::parameter_names`].
    pub parameters: Vec<f64>,
}

impl ColmapCamera {
    /// The camera of the images at full size.
    ///
    /// # Errors
    /// [`Skip::BadCamera`] or [`Skip::Panorama`].
    pub fn source(&self) -> Result<SourceCamera, Skip> {
        let size = dvec2(self.width as f64, self.height as f64);
        let intrinsics = self.model.intrinsics(&self.parameters, size)?;
        let lens = Lens::new(intrinsics.distortion).ok_or(Skip::BadCamera)?;
        let sides = u32::try_from(self.width).ok().zip(u32::try_from(self.height).ok()).ok_or(Skip::BadCamera)?;
        let source = intrinsics.source(size, sides, lens);
        source.fault().is_none().then_some(source).ok_or(Skip::BadCamera)
    }
}

/// A registered image.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapImage {
    /// The id.
    pub id: u32,
    /// World-to-camera rotation, not normalised.
    pub rotation: DQuat,
    /// World-to-camera translation, world units.
    pub translation: DVec3,
    /// The id of the image's camera.
    pub camera_id: u32,
    /// The path below the image folder.
    pub name: String,
    /// The image's keypoints.
    pub observations: Vec<ColmapObservation>,
}

/// A keypoint of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColmapObservation {
    /// Position in px of the distorted image, from its top-left corner; pixel (i, j) has its centre
    /// at (i + ½, j + ½).
    pub position: DVec2,
    /// The id of the keypoint's point, if it was triangulated.
    pub point: Option<u64>,
}

/// A triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColmapPoint {
    /// The id.
    pub id: u64,
    /// Position, world units.
    pub position: DVec3,
    /// Colour, RGB.
    pub color: [u8; 3],
    /// Mean reprojection error, px; −1 where COLMAP did not compute it.
    pub error: f64,
}

impl ColmapModel {
    /// Reads the model in a folder: the binary files if there is a `cameras.bin`, else the text
    /// files, which are also read where the binary ones are damaged. The file of points is optional.
    ///
    /// # Errors
    /// [`Error::Missing`] or [`Error::Read`]; those of [`Self::from_binary`] or
    /// [`Self::from_text`].
    pub fn read(folder: &Path) -> Result<Self, Error> {
        Self::read_either(folder).map(|(model, _, _)| model)
    }

    /// Reads the model as [`Self::read`] does, with the extension of its files, and what was wrong with
    /// others.
    fn read_either(folder: &Path) -> Result<(Self, &'static str, Option<Remark>), Error> {
        let has = |extension| folder.join("cameras").with_extension(extension).is_file();
        if !has("bin") {
            return Self::read_with(folder, "txt").map(|model| (model, "txt", None));
        }
        match Self::read_with(folder, "bin") {
            Ok(model) => Ok((model, "bin", None)),
            Err(error @ (Error::Damaged { .. } | Error::Missing { .. })) if has("txt") => {
                let Ok(model) = Self::read_with(folder, "txt") else { return Err(error) };
                Ok((model, "txt", Some(Remark::TextModel { error: error.to_string() })))
            }
            Err(error) => Err(error),
        }
    }

    fn read_with(folder: &Path, extension: &str) -> Result<Self, Error> {
        let bytes = |name: &str| read_file(&folder.join(name).with_extension(extension));
        let cameras = bytes("cameras")?;
        if cameras.is_empty() && extension == "bin" {
            // The fault to name, even where other files are missing.
            binary::cameras(&folder.join("cameras.bin"), &cameras)?;
        }
        let images = bytes("images")?;
        let points = match bytes("points3D") {
            Err(Error::Missing { .. }) => None,
            other => Some(other?),
        };
        let parse = if extension == "bin" { Self::from_binary } else { Self::from_text };
        parse(folder, &cameras, &images, points.as_deref())
    }

    /// The model in the bytes of `cameras.bin`, `images.bin` and `points3D.bin`; `folder` is for
    /// messages. Memory is limited by their lengths, not by the counts they claim.
    ///
    /// # Errors
    /// [`Error::Damaged`] where a file ends early or claims more than it can contain,
    /// [`Error::UnknownCameraModel`].
    pub fn from_binary(folder: &Path, cameras: &[u8], images: &[u8], points: Option<&[u8]>) -> Result<Self, Error> {
        let points = points.map(|bytes| binary::points(&folder.join("points3D.bin"), bytes)).transpose()?;
        Ok(Self {
            cameras: binary::cameras(&folder.join("cameras.bin"), cameras)?,
            images: binary::images(&folder.join("images.bin"), images)?,
            points: points.unwrap_or_default(),
        })
    }

    /// The model in the bytes of `cameras.txt`, `images.txt` and `points3D.txt`; `folder` is for
    /// messages.
    ///
    /// # Errors
    /// [`Error::DamagedLine`], [`Error::UnknownCameraModel`].
    pub fn from_text(folder: &Path, cameras: &[u8], images: &[u8], points: Option<&[u8]>) -> Result<Self, Error> {
        let points = points.map(|bytes| text::points(&folder.join("points3D.txt"), bytes)).transpose()?;
        Ok(Self {
            cameras: text::cameras(&folder.join("cameras.txt"), cameras)?,
            images: text::images(&folder.join("images.txt"), images)?,
            points: points.unwrap_or_default(),
        })
    }

    /// Drafts of the views. `file` is that of the cameras.
    fn draft(&self, root: &Path, file: &str, image: &ColmapImage) -> Draft {
        let intrinsics = self.cameras.get(&image.camera_id).ok_or(Skip::NoCamera).and_then(|camera| {
            let size = dvec2(camera.width as f64, camera.height as f64);
            camera.model.intrinsics(&camera.parameters, size)
        });
        let intrinsics = intrinsics.map_err(Refusal::from);
        let stated = self.cameras.get(&image.camera_id).map(|camera| {
            let numbers = camera.model.parameter_names().iter().copied().zip(camera.parameters.iter().copied());
            Stated { place: format!("camera {} of {file}", image.camera_id), numbers: numbers.collect() }
        });
        let name = plain(&image.name);
        let file = Some(PathBuf::from(&name));
        let mask = find_image(&root.join(MASK_FOLDER).join(&name));
        let depth = find_depth(&root.join(DEPTH_FOLDER), Path::new(&name));
        let depth = depth.map(|path| DepthFile { path, unit: None });
        let pose = Pose::world_to_camera(image.rotation, image.translation);
        let stated = stated.unwrap_or_default();
        Draft { name, file, mask, depth, intrinsics, stated, pose, split: None }
    }
}

/// Points in the engine's form; those that are not finite are counted later.
pub(super) fn points_of(points: &[ColmapPoint]) -> impl Iterator<Item = WorldPoint> {
    points.iter().map(|point| WorldPoint { position: point.position, color: point.color.map(|c| f32::from(c) / 255.0) })
}

/// Reads the data set with these models, which were found at `named`: a data set's folder, or that of a
/// model in it.
pub(super) fn read(named: &Path, folders: &[PathBuf], settings: &DatasetSettings) -> Result<Dataset, Error> {
    let root = &data_set_of(named);
    let (candidate, others) = read_largest(root, folders, settings)?;
    let Candidate { folder, model, mut drafts, places, damaged } = candidate;
    let mut remarks = others.into_iter().chain(damaged).collect();
    let lists = lists_in_files(root, Some(&folder), settings)?;
    let split = apply_lists(lists, &mut drafts, &mut remarks, settings)?;
    let points = points_of(&model.points).collect();
    assemble(Parts { kind: DatasetKind::Colmap, root, drafts, points, places, split, remarks }, settings)
}

fn unknown_model(path: &Path, found: impl ToString) -> Error {
    let known = CameraModel::ALL.map(CameraModel::name).join(", ");
    Error::UnknownCameraModel { path: path.to_owned(), found: found.to_string(), known }
}
