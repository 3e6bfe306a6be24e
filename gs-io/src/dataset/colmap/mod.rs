//! COLMAP's sparse models: cameras, images and points as stored, and the data set made of them.
//!
//! [`ColmapModel::read`] reads a model; [`read`] makes a data set of the best of the [`models_of`] a
//! folder.
//!
//! *Source:* COLMAP's documentation ("Output Format"). `rigs` and `frames`, which newer versions
//!   add, contain nothing beyond the images' own poses and are not read.

mod binary;
mod camera_model;
mod candidate;
mod files;
mod folders;
mod model;
mod records;
mod text;
mod write;

use std::path::{Path, PathBuf};

use self::candidate::{Candidate, read_largest};
pub(crate) use self::{
    camera_model::CameraModel,
    model::{ColmapCamera, ColmapImage, ColmapModel, ColmapObservation, ColmapPoint},
};
pub(super) use self::{
    folders::{data_set_of, has_photographs, is_model, models_of},
    model::points_of,
};
use super::{
    Dataset, DatasetKind, DatasetSettings,
    read::{Parts, apply_lists, assemble, lists_in_files},
};
use crate::error::Error;

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
