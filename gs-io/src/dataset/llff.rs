//! `poses_bounds.npy` of LLFF: a pose, a focal length and two depths for each image of a folder.
//!
//! The array has a row of 17 numbers for each image, in the order of the images' names: a 3×5 matrix
//! by rows, then the nearest and the farthest depth, which are not used. The columns of the matrix are
//! the camera's axes down, right and back in the world, its position, and the image's rows, columns
//! and focal length, px. The principal point is the centre, and there is no distortion.
//!
//! *Source:* LLFF's documentation (Mildenhall et al. 2019), "Using your own poses without running
//!   COLMAP".

use std::path::Path;

use glam::{DVec2, dvec2};

use super::{
    Dataset, DatasetKind, DatasetSettings, Distortion, Skip,
    camera::{Intrinsics, Pose},
    read::{Draft, Parts, Place, Refusal, Stated, assemble_named},
};
use crate::{atomic::read_file, error::Error, image::image_files, npy::Npy};

/// The file of such a data set.
pub(super) const POSES: &str = "poses_bounds.npy";

/// Numbers of an image.
const ROW: usize = 17;

/// Reads the data set of a `poses_bounds.npy`.
pub(super) fn read(root: &Path, file: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let rows = rows(file, &read_file(file, super::FILE)?)?;
    let (place, names) = images(root, file, rows.len(), settings)?;
    let drafts = names.iter().zip(&rows).map(|(name, row)| draft(root, name, row)).collect();
    let (places, points, remarks) = (vec![place], Vec::new(), Vec::new());
    let parts = Parts { kind: DatasetKind::Llff, root, drafts, points, places, split: None, remarks };
    assemble_named(parts, file, settings)
}

/// The first folder with as many images as there are poses, and their names.
fn images(root: &Path, file: &Path, poses: usize, settings: &DatasetSettings) -> Result<(Place, Vec<String>), Error> {
    let mut counts = Vec::new();
    for place in Place::usual(root, settings)? {
        let Ok(files) = image_files(&place.folder) else { continue };
        let names: Vec<String> = files.iter().filter_map(|file| Some(file.file_name()?.to_str()?.to_owned())).collect();
        if names.len() == poses {
            return Ok((place, names));
        }
        if !names.is_empty() {
            let folder = place.folder.strip_prefix(root).unwrap_or(&place.folder).display().to_string();
            let folder = if folder.is_empty() { "the folder itself" } else { &folder };
            counts.push(format!("{folder} has {}", names.len()));
        }
    }
    let found = if counts.is_empty() { "there are no images".to_owned() } else { counts.join(", ") };
    let problem = format!("it has {} for the images by name, but {found}", gs_core::counted(poses, "pose"));
    Err(Error::unusable(file, problem, "put exactly the images of these poses into the folder images"))
}

fn draft(root: &Path, name: &str, row: &[f64]) -> Draft {
    let at = |row_of: usize, column: usize| row[5 * row_of + column];
    let [height, width, focal] = [at(0, 4), at(1, 4), at(2, 4)];
    let is_usable = [height, width, focal].iter().all(|value| value.is_finite() && *value > 0.0);
    let intrinsics = Intrinsics::new(DVec2::splat(focal), None, dvec2(width, height), Distortion::None);
    let numbers = vec![("height", height), ("width", width), ("focal", focal)];
    let stated = Stated { place: POSES.to_owned(), numbers };
    let intrinsics = if is_usable { Ok(intrinsics) } else { Err(Refusal::new(Skip::BadCamera, stated.to_string())) };
    // From (down, right, back) to (right, up, back).
    let turned = |i: usize| vec![at(i, 1), -at(i, 0), at(i, 2), at(i, 3)];
    let pose = Pose::camera_to_world(&[turned(0), turned(1), turned(2)]);
    Draft::of_image(root, name, intrinsics, stated, pose)
}

/// The rows of the array.
fn rows(path: &Path, bytes: &[u8]) -> Result<Vec<Vec<f64>>, Error> {
    let wrong = |problem: String| {
        Error::unusable(path, problem, "write it with numpy.save as float64, a row of 17 numbers for each image")
    };
    let npy = Npy::header(bytes, bytes.len() as u64).map_err(wrong)?;
    if npy.columns as usize != ROW || npy.rows == 0 {
        return Err(wrong(format!("it has {} rows of {} numbers", npy.rows, npy.columns)));
    }
    let numbers: Vec<f64> = npy.numbers(bytes).map(Iterator::collect).unwrap_or_default();
    Ok(numbers.chunks_exact(ROW).map(<[f64]>::to_vec).collect())
}
