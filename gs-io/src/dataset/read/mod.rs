//! What readers of all kinds share: names, places of images, splits, and the data set made of it.
//!
//! A reader describes each view as a [`Draft`] and hands all of them to [`assemble`].

mod assemble;
mod finder;
mod json;
mod names;
mod place;
mod split_lists;
mod tally;

pub(super) use self::{
    assemble::{Draft, Focal, Intrinsics, Parts, Refusal, Stated, assemble, same_shape, search_folders},
    finder::{Finder, Folders, entries},
    json::{Number, number_of, parse, shown},
    names::plain,
    place::{IMAGE_FOLDERS, NamePart, Place, check_inside, find_image, how_to_begin, whole},
    split_lists::{apply as apply_lists, in_files as lists_in_files},
};
