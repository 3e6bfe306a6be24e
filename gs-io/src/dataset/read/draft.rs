//! A view as its data set describes it, before its image is found.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use super::{
    names::plain,
    place::{IMAGE_FOLDERS, find_image, localize},
};
use crate::{
    WorldFrame,
    dataset::{
        DatasetSettings, DepthFile, Skip, Split,
        camera::{Intrinsics, Pose},
        images::find_depth,
    },
    error::Error,
};

/// A view as the data set describes it.
#[derive(Debug, Clone)]
pub(crate) struct Draft {
    pub(crate) name: String,
    /// The path of another machine in the data set that stands for the name.
    pub(crate) written: Option<String>,
    /// Path of the image below the image folder; `None` for an invalid name.
    pub(crate) file: Option<PathBuf>,
    pub(crate) mask: Option<PathBuf>,
    pub(crate) depth: Option<DepthFile>,
    /// The intrinsics, or why the view is left out.
    pub(crate) intrinsics: Result<Intrinsics, Refusal>,
    /// Where the intrinsics come from, for messages.
    pub(crate) stated: Stated,
    pub(crate) pose: Result<Pose, Skip>,
    /// `None` if the data set does not say.
    pub(crate) split: Option<Split>,
}

/// The folder of masks: `masks/NAME.png` for the image `images/NAME`.
const MASK_FOLDER: &str = "masks";

/// The folder of depth maps: `depths/NAME` for the image `images/NAME`, ending in `.png` or `.npy`.
const DEPTH_FOLDER: &str = "depths";

impl Draft {
    /// The view of an image of this name, with the mask and the depth map of the name below `root`.
    pub(crate) fn of_image(
        root: &Path,
        name: &str,
        intrinsics: Result<Intrinsics, Refusal>,
        stated: Stated,
        pose: Result<Pose, Skip>,
    ) -> Self {
        let name = plain(name);
        let mask = find_image(&root.join(MASK_FOLDER).join(&name));
        let depth = find_depth(&root.join(DEPTH_FOLDER), Path::new(&name));
        let depth = depth.map(|path| DepthFile { path, unit: None });
        let file = Some(PathBuf::from(&name));
        Self { name, written: None, file, mask, depth, intrinsics, stated, pose, split: None }
    }

    /// Takes images at absolute paths of another machine for those below `root` that end alike
    /// ([`localize`]). Names are relative to the folder of the images.
    pub(crate) fn localize(drafts: &mut [Self], root: &Path, settings: &DatasetSettings) {
        let mut names: Vec<&mut String> = drafts.iter_mut().map(|draft| &mut draft.name).collect();
        let written = localize(root, &mut names, settings);
        let in_images = |name: &str| Some(name.strip_prefix(IMAGE_FOLDERS[0])?.strip_prefix('/')?.to_owned());
        for (draft, written) in drafts.iter_mut().zip(written).filter(|(_, written)| written.is_some()) {
            let Self { name, intrinsics, stated, pose, .. } = draft.clone();
            let name = in_images(&name).unwrap_or(name);
            *draft = Self { written, ..Self::of_image(root, &name, intrinsics, stated, pose) };
        }
    }

    /// Takes the pose, and the unit of depths, from the world to a frame.
    pub(crate) fn move_to(&mut self, frame: &WorldFrame) {
        let is_finite = |pose: &Pose| pose.translation.as_vec3().is_finite();
        let pose = self.pose.map(|pose| pose.in_frame(frame));
        self.pose = pose.and_then(|pose| is_finite(&pose).then_some(pose).ok_or(Skip::BadPose));
        if let Some(DepthFile { unit: Some(unit), .. }) = &mut self.depth {
            *unit = (f64::from(*unit) / frame.unit) as f32;
        }
    }
}

/// The numbers of a camera as its file has them, for messages.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stated {
    /// "transforms.json", "camera 7 of cameras.bin".
    pub(crate) place: String,
    pub(crate) numbers: Vec<(&'static str, f64)>,
}

impl fmt::Display for Stated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |(name, value): &(&str, f64)| match value.abs() {
            0.0 | 1e-3..1e6 => format!("{name} = {value}"),
            _ => format!("{name} = {value:e}"),
        };
        // Most coefficients of lenses are 0.
        let says = |(name, value): &&(&str, f64)| *value != 0.0 || !name.starts_with(['k', 'p', 's']);
        let numbers: Vec<String> = self.numbers.iter().filter(says).map(number).collect();
        write!(f, "{} has {}", self.place, numbers.join(", "))
    }
}

/// Why a view cannot be used, with details if there are any.
#[derive(Debug, Clone)]
pub(crate) struct Refusal {
    pub(crate) why: Skip,
    pub(crate) detail: Option<String>,
}

impl From<Skip> for Refusal {
    fn from(why: Skip) -> Self {
        Self { why, detail: None }
    }
}

impl Refusal {
    pub(crate) fn new(why: Skip, detail: String) -> Self {
        Self { why, detail: Some(detail) }
    }

    /// A refusal because of a file that cannot be read. The view's name replaces the path at the
    /// beginning of the error.
    pub(crate) fn of_file(why: Skip, path: &Path, error: &Error) -> Self {
        let text = error.to_string();
        let detail = text.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&text);
        Self::new(why, detail.to_owned())
    }
}
