//! What readers of all kinds share: names, places of images, splits, and the data set made of it.
//!
//! A reader describes each view as a [`Draft`] and hands all of them to [`assemble()`] as [`Parts`],
//! with the [`Place`]s where images may be. [`lists_in_files`] and [`apply_lists`] split by lists.

mod assemble;
mod camera_fields;
mod draft;
mod finder;
mod json;
mod names;
mod place;
mod points;
mod split_lists;
mod splits;
mod tally;
mod views;

pub(super) use self::{
    assemble::{Parts, assemble, assemble_named},
    camera_fields::CameraFields,
    draft::{Draft, Refusal, Stated},
    finder::{Finder, Folders, entries, walk},
    json::{Matrix, Number, number_of, parse, shown},
    names::plain,
    place::{IMAGE_FOLDERS, NamePart, Place, check_inside, ending_inside, localize, search_folders, whole},
    points::WorldPoint,
    split_lists::{apply as apply_lists, in_files as lists_in_files},
};
