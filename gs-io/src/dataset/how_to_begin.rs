//! What to do about a folder that is not a data set.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use gs_core::counted;

use super::{
    colmap::{data_set_of, has_photographs, is_model, models_of},
    kinds::has_file,
    read::{IMAGE_FOLDERS, walk, whole},
};
use crate::{
    image::{heic_files, image_files, unreadable_photographs},
    text::quoted,
};

/// How deep files are in a data set.
const PARTS: usize = 3;

/// Advice for a folder that is not a data set; if it contains images without poses, how to find these, and
/// where the images are.
pub(super) fn how_to_begin(folder: &Path) -> (String, Option<PathBuf>) {
    let images_in = |folder: &Path| image_files(folder).map_or(0, |files| files.len());
    let below = data_sets_below(folder);
    if let Some(first) = below.first() {
        let others = if below.len() > 1 { format!(", one of {} data sets in it", below.len()) } else { String::new() };
        let images =
            if has_file(first) || has_photographs(first) { "" } else { " with the folder of its images by --images" };
        return (format!("name {}{others}{images}", quoted(first)), None);
    }
    let is_data_set = |folder: &&Path| has_file(folder) || !models_of(folder).is_empty();
    if let Some(above) = whole(folder).ancestors().skip(1).take(PARTS).find(is_data_set) {
        return (format!("it is part of the data set {}: name that", quoted(above)), None);
    }
    let places = [folder.to_owned(), folder.join(IMAGE_FOLDERS[0]), folder.join("input")];
    if let Some((unreadable, place)) = places.iter().find_map(|place| Some((unreadable_photographs(place)?, place))) {
        let heic = heic_files(place).len();
        if heic == 0 {
            return (format!("it holds {unreadable}"), None);
        }
        let (count, place_words) = (counted(heic + images_in(place), "photograph"), quoted(place));
        let how = format!("gs poses {place_words} -o DATASET converts them and finds these");
        return (format!("it holds {count} without camera poses: {how}"), Some(place.clone()));
    }
    match places.iter().map(|place| (images_in(place), place)).find(|(count, _)| *count > 1) {
        None => ("name the folder that holds one of them".to_owned(), None),
        Some((count, images)) => {
            let command = format!("gs poses {} -o DATASET", quoted(images));
            (format!("it holds {count} images without camera poses: {command} finds them"), Some(images.to_owned()))
        }
    }
}

/// The data sets below a folder, by absolute paths.
fn data_sets_below(folder: &Path) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    walk(&whole(folder), |folder, _| {
        if has_file(folder) {
            found.insert(folder.to_owned());
        } else if is_model(folder) {
            found.insert(data_set_of(folder));
        }
    });
    found
}
