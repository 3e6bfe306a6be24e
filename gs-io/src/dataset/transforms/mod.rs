//! `transforms.json` of Nerfstudio and instant-ngp, and the three files of NeRF-synthetic:
//! [`read_nerfstudio`] and [`read_blender`].
//!
//! Poses are camera-to-world with axes right, up, back (OpenGL), in the file's own world.
//! Nerfstudio may have rotated that world (`applied_transform`) relative to the COLMAP model it was
//! made from. Its `ply_file_path` is already in the file's world; a COLMAP model next to it is not.
//!
//! *Source:* Nerfstudio's documentation ("Data conventions"), and the files of NeRF-synthetic
//! (Mildenhall et al. 2020).

mod camera_fields;
mod point_cloud;
mod write;

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::{
    Dataset, DatasetKind, DatasetSettings, DepthFile, Remark, Skip, Split, SplitOrigin,
    camera::{Pose, affine},
    colmap::{ColmapModel, points_of},
    read::{
        CameraFields, Draft, Folders, IMAGE_FOLDERS, Matrix, NamePart, Number, Parts, Place, WorldPoint, apply_lists,
        assemble, check_inside, ending_inside, lists_in_files, localize, parse, plain,
    },
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
    frames: Vec<Frame>,
    /// Frames for tests (ScanNet++).
    #[serde(default)]
    test_frames: Vec<Frame>,
    /// Transform from COLMAP's world to the file's, 3×4 by rows.
    applied_transform: Option<Matrix>,
    applied_scale: Option<Number>,
    ply_file_path: Option<String>,
    /// Whether there are masks; without, each `mask_path` is a name only (ScanNet++).
    has_mask: Option<bool>,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
    /// The other fields: intrinsics of frames without their own.
    #[serde(flatten)]
    shared: Map<String, Value>,
}

/// An image.
#[derive(Debug, Deserialize)]
struct Frame {
    file_path: String,
    /// The path of another machine that stood for it.
    #[serde(skip)]
    written: Option<String>,
    transform_matrix: Option<Matrix>,
    mask_path: Option<String>,
    depth_file_path: Option<String>,
    /// Whether the image is blurred or not registered well (ScanNet++).
    is_bad: Option<bool>,
    /// The other fields: intrinsics of the frame's own.
    #[serde(flatten)]
    own: Map<String, Value>,
}

impl Frame {
    fn draft(
        &self,
        root: &Path,
        file: &Path,
        shared: &Map<String, Value>,
        split: Option<Split>,
        folders: &mut Folders,
    ) -> Result<Draft, Error> {
        let name = plain(&self.file_path);
        let camera = CameraFields { own: &self.own, shared: Some(shared) };
        let depth = self.depth_file_path.as_ref().and_then(|depth| folders.file(root, depth));
        Ok(Draft {
            file: Some(PathBuf::from(&name)),
            name,
            written: self.written.clone(),
            depth: depth.map(|path| DepthFile { path, unit: Some(DEPTH_UNIT) }),
            mask: self.mask_path.as_ref().and_then(|mask| folders.image(root, mask)),
            intrinsics: match self.is_bad {
                Some(true) => Err(Skip::MarkedBad.into()),
                _ => camera.intrinsics(file)?,
            },
            stated: camera.stated(file),
            pose: match &self.transform_matrix {
                Some(matrix) => Pose::camera_to_world(&matrix.0),
                None => Err(Skip::NoPose),
            },
            split,
        })
    }
}

impl Transforms {
    /// Takes paths of another machine for those inside the folder.
    fn localize(&mut self, root: &Path, settings: &DatasetSettings) {
        let mut frames: Vec<&mut Frame> = self.frames.iter_mut().chain(&mut self.test_frames).collect();
        let mut images: Vec<&mut String> = frames.iter_mut().map(|frame| &mut frame.file_path).collect();
        let written = localize(root, &mut images, settings);
        for (frame, written) in frames.into_iter().zip(written) {
            frame.written = written;
            let others = [&mut frame.mask_path, &mut frame.depth_file_path].into_iter().flatten();
            others.for_each(|path| *path = ending_inside(root, path, settings).unwrap_or_else(|| std::mem::take(path)));
        }
        if let Some(path) = &mut self.ply_file_path {
            *path = ending_inside(root, path, settings).unwrap_or_else(|| std::mem::take(path));
        }
    }

    fn check_inside(&self, root: &Path, path: &Path, settings: &DatasetSettings) -> Result<(), Error> {
        let frames = || self.frames.iter().chain(&self.test_frames);
        let images = frames().map(|frame| ("file_path", frame.file_path.as_str()));
        let masks = frames().filter_map(|frame| Some(("mask_path", frame.mask_path.as_deref()?)));
        let depths = frames().filter_map(|frame| Some(("depth_file_path", frame.depth_file_path.as_deref()?)));
        let points = self.ply_file_path.as_deref().map(|points| ("ply_file_path", points));
        check_inside(root, path, images.chain(masks).chain(depths).chain(points), settings)
    }

    /// The names of the frames by their keys `split`.
    fn split_by_frame(&self) -> [(Split, &'static str, Vec<String>); 3] {
        let values = [(Split::Train, &["train"][..]), (Split::Validation, &["val"]), (Split::Test, &["test", "eval"])];
        values.map(|(split, values)| {
            let is_of =
                |frame: &&Frame| frame.own.get("split").and_then(Value::as_str).is_some_and(|v| values.contains(&v));
            (split, "split", self.frames.iter().filter(is_of).map(|frame| frame.file_path.clone()).collect())
        })
    }

    /// Drafts of the frames, with remarks on what they refer to. `split` is that of `frames`.
    fn drafts(&self, root: &Path, path: &Path, split: Option<Split>) -> Result<(Vec<Draft>, Vec<Remark>), Error> {
        let frames = self.frames.iter().map(|frame| (frame, split));
        let frames: Vec<_> = frames.chain(self.test_frames.iter().map(|frame| (frame, Some(Split::Test)))).collect();
        let mut folders = Folders::default();
        let drafts = frames.iter().map(|(frame, split)| frame.draft(root, path, &self.shared, *split, &mut folders));
        let drafts = drafts.collect::<Result<Vec<_>, Error>>()?;
        let remarks = missing(frames.iter().map(|(frame, _)| *frame), &drafts);
        Ok((drafts, remarks))
    }
}

/// Remarks on masks and depth maps that frames refer to and that do not exist.
fn missing<'f>(frames: impl Iterator<Item = &'f Frame> + Clone, drafts: &[Draft]) -> Vec<Remark> {
    let no_mask = |(frame, draft): (&Frame, &Draft)| frame.mask_path.clone().filter(|_| draft.mask.is_none());
    let no_depth = |(frame, draft): (&Frame, &Draft)| frame.depth_file_path.clone().filter(|_| draft.depth.is_none());
    let masks: Vec<String> = frames.clone().zip(drafts).filter_map(no_mask).collect();
    let depths: Vec<String> = frames.zip(drafts).filter_map(no_depth).collect();
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
        let mut file: Transforms = parse(&path)?;
        file.localize(root, settings);
        file.check_inside(root, &path, settings)?;
        let (of_file, missing) = file.drafts(root, &path, Some(split))?;
        drafts.extend(of_file);
        remarks.extend(missing);
        if points.is_empty() {
            points = listed_points(root, &file, &mut remarks)?.unwrap_or_default();
        }
    }
    let places = places(root, settings)?;
    let split = drafts.iter().any(|draft| draft.split != Some(Split::Train)).then_some(SplitOrigin::Files);
    assemble(Parts { kind: DatasetKind::Blender, root, drafts, points, places, split, remarks }, settings)
}

/// Reads a `transforms.json` with files below `root`.
pub(super) fn read_nerfstudio(root: &Path, path: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let mut file: Transforms = parse(path)?;
    if file.has_mask == Some(false) {
        file.frames.iter_mut().chain(&mut file.test_frames).for_each(|frame| frame.mask_path = None);
    }
    file.localize(root, settings);
    file.check_inside(root, path, settings)?;
    let (mut drafts, mut remarks) = file.drafts(root, path, None)?;
    let lists = [
        (Split::Train, "train_filenames", &file.train_filenames),
        (Split::Validation, "val_filenames", &file.val_filenames),
        (Split::Test, "test_filenames", &file.test_filenames),
    ];
    let named = lists.into_iter().filter_map(|(split, key, names)| Some((split, key, names.clone()?)));
    let lists: Vec<_> = named.chain(file.split_by_frame()).filter(|(.., names)| !names.is_empty()).collect();
    let lists = match lists.is_empty() && file.test_frames.is_empty() {
        true => lists_in_files(root, None, settings)?,
        false => Some((path.to_owned(), lists)),
    };
    let split = apply_lists(lists, &mut drafts, &mut remarks, settings)?;
    let points = match listed_points(root, &file, &mut remarks)? {
        Some(points) => points,
        None => colmap_points(root, &file)?,
    };
    let places = places(root, settings)?;
    assemble(Parts { kind: DatasetKind::Nerfstudio, root, drafts, points, places, split, remarks }, settings)
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
    let path = Folders::default().file(root, name).unwrap_or_else(|| root.join(plain(name)));
    let (points, remark) = match point_cloud::read(&path, name) {
        Err(Error::Missing { .. }) => (Vec::new(), Some(Remark::PointsMissing { file: name.clone() })),
        read => read?,
    };
    remarks.extend(remark);
    Ok(Some(points))
}

/// The points of the COLMAP model next to the file, in the file's world.
fn colmap_points(root: &Path, file: &Transforms) -> Result<Vec<WorldPoint>, Error> {
    let folder = root.join(NERFSTUDIO_COLMAP);
    let (linear, offset) = match &file.applied_transform {
        None => (OLD_TRANSFORM, DVec3::ZERO),
        // With an invalid transform, the place of the points is unknown.
        Some(matrix) => match affine(&matrix.0) {
            Some(transform) => transform,
            None => return Ok(Vec::new()),
        },
    };
    if !folder.join("points3D.bin").is_file() && !folder.join("points3D.txt").is_file() {
        return Ok(Vec::new());
    }
    let scale = file.applied_scale.map_or(1.0, |scale| scale.0);
    let mut model = ColmapModel::read(&folder)?;
    model.points.iter_mut().for_each(|point| point.position = (linear * point.position + offset) * scale);
    Ok(points_of(&model.points).collect())
}
