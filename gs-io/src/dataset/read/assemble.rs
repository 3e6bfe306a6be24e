//! Turns the content of a data set of any kind into usable views, and counts what is left out.

use std::{
    cmp::Reverse,
    collections::{HashMap, hash_map::Entry},
    path::{Path, PathBuf},
};

use glam::DVec3;

use super::{
    Draft, Finder, Place, Refusal, WorldPoint,
    finder::is_bare,
    place::{check_inside, search_folders},
    points::{points_in, without_copies},
    split_lists::{apply as apply_lists, in_files as lists_in_files},
    splits,
    tally::Tally,
    views::{Lenses, Made, make_views},
};
use crate::{
    WorldFrame,
    dataset::{
        Dataset, DatasetKind, DatasetSettings, Remark, Skip, Split, SplitOrigin, View,
        camera::{is_two_to_one, shows_all_directions},
        images::check_depth,
    },
    error::Error,
    image::decode,
};

/// The result of a reader.
#[derive(Debug)]
pub(crate) struct Parts<'a> {
    pub(crate) kind: DatasetKind,
    pub(crate) root: &'a Path,
    pub(crate) drafts: Vec<Draft>,
    pub(crate) points: Vec<WorldPoint>,
    /// Folders that may contain the images; the first with an image of the name is used.
    pub(crate) places: Vec<Place>,
    /// Where the data set states its split; `None` if it has none.
    pub(crate) split: Option<SplitOrigin>,
    pub(crate) remarks: Vec<Remark>,
}

/// Assembles the data set of a file that names images, with the split of lists beside it.
pub(crate) fn assemble_named(mut parts: Parts<'_>, file: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    Draft::localize(&mut parts.drafts, parts.root, settings);
    let names = parts.drafts.iter().map(|draft| ("the image name", draft.name.as_str()));
    check_inside(parts.root, file, names, settings)?;
    let lists = lists_in_files(parts.root, None, settings)?;
    parts.split = apply_lists(lists, &mut parts.drafts, &mut parts.remarks, settings)?;
    assemble(parts, settings)
}

/// Assembles the data set.
pub(crate) fn assemble(parts: Parts<'_>, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let Parts { kind, root, mut drafts, points, places, split, mut remarks } = parts;
    let found = drafts.len();
    let mut finder = Finder::new(root, &places, &drafts, &search_folders(root, settings));
    let mut tally = Tally::default();
    remarks.extend(keep_one_of_each(&mut drafts, finder.place(), settings, &mut tally));
    finder.search_for(&drafts);
    drafts.sort_by(|a, b| a.name.cmp(&b.name));
    let frame = settings.frame.unwrap_or_else(|| frame_of(&drafts, &points));
    if !frame.is_world() {
        remarks.extend(settings.frame.is_none().then(|| Remark::Frame { frame: frame.to_string() }));
        drafts.iter_mut().for_each(|draft| draft.move_to(&frame));
    }
    let mut lenses = Lenses::default();
    let mut unused_depths = 0;
    let mut views = Vec::new();
    for draft in &drafts {
        match make_views(draft, &mut finder, settings, &mut lenses) {
            Ok(Made { views: made, calibrated, renamed, remarks }) => {
                tally.count(&made, calibrated, &remarks);
                if renamed || draft.written.is_some() {
                    tally.count_renamed(draft.written.as_ref().unwrap_or(&draft.name), root, &made[0].image);
                }
                if let Some(Err(error)) = made[0].depth.as_ref().map(|depth| check_depth(&depth.path, &made[0].source))
                {
                    tally.count_bad_depth(&error);
                }
                unused_depths += usize::from(draft.depth.is_some() && made[0].depth.is_none());
                views.extend(made);
            }
            Err(Refusal { why: Skip::NoImage, .. }) if !tally.has(Skip::NoImage) => {
                let detail = draft.file.as_ref().and_then(|file| finder.near(file));
                tally.skip(&draft.name, Skip::NoImage, detail);
            }
            Err(Refusal { why, detail }) => tally.skip(&draft.name, why, detail),
        }
    }
    if views.is_empty() {
        let mut skipped: Vec<String> = tally.remarks().iter().map(ToString::to_string).collect();
        if found == 0 {
            skipped.push("it lists none".to_owned());
        }
        let outside = finder.outside;
        return Err(Error::NoViews { path: root.to_owned(), kind: kind.name(), found, skipped, outside });
    }
    if let Some(view) = unsplit_panorama(&views) {
        let problem = "it is twice as wide as high, and its borders meet as those of a 360° image do, but its camera \
                       has a perspective model";
        let remedy = "set the camera's model to EQUIRECTANGULAR, or cut a few columns off if it is no 360° image";
        return Err(Error::unusable(&view.image, problem, remedy));
    }
    remarks.extend(tally.remarks());
    if let Some(place) = finder.place().filter(|_| finder.elsewhere) {
        let folder = place.folder.strip_prefix(root).unwrap_or(&place.folder);
        remarks.push(Remark::OtherFolder { folder: folder.display().to_string() });
    }
    if unused_depths > 0 {
        remarks.push(Remark::DepthsUnused { count: unused_depths });
    }
    remarks.extend(unused_masks(kind, root, &drafts, &remarks));
    let listed = points.len();
    let points = points_in(&frame, points);
    if points.len() < listed {
        remarks.push(Remark::PointsNotFinite { count: listed - points.len() });
    }
    let finite = points.len();
    let points = without_copies(points);
    if points.len() < finite {
        remarks.push(Remark::PointsCoincide { count: finite - points.len() });
    }
    if points.is_empty() && !remarks.iter().any(|remark| matches!(remark, Remark::PointsMissing { .. })) {
        remarks.push(Remark::NoPoints);
    }
    let Some(split) = splits::apply(split, &mut views, settings, &mut remarks) else {
        let skipped = remarks.iter().filter(|r| matches!(r, Remark::Skipped { .. } | Remark::ListedTwice { .. }));
        let mut skipped: Vec<String> = skipped.map(ToString::to_string).collect();
        if skipped.is_empty() {
            skipped.push("its split lists none".to_owned());
        }
        let problem = format!("no view for training can be used: {}", skipped.join("; "));
        return Err(Error::unusable(root, problem, "correct this, or the data set's split"));
    };
    views.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(Dataset { kind, root: root.to_owned(), frame, views, points, split, remarks })
}

/// Keeps one of the views of each image: what is held out is never trained on; else the first in the file.
fn keep_one_of_each(
    drafts: &mut Vec<Draft>,
    place: Option<&Place>,
    settings: &DatasetSettings,
    tally: &mut Tally,
) -> Option<Remark> {
    let is_held_out = |draft: &Draft| draft.split > Some(Split::Train) && !settings.replace_split;
    drafts.sort_by_key(|draft| Reverse(draft.split));
    let (mut kept, mut twice) = (HashMap::new(), Vec::new());
    drafts.retain(|draft| match kept.entry(image_name(draft, place)) {
        Entry::Vacant(entry) => {
            entry.insert(is_held_out(draft));
            true
        }
        Entry::Occupied(entry) if *entry.get() && !is_held_out(draft) => {
            twice.push(draft.name.clone());
            false
        }
        Entry::Occupied(_) => {
            tally.skip(&draft.name, Skip::SameName, None);
            false
        }
    });
    let count = twice.len();
    twice.into_iter().next().map(|first| Remark::ListedTwice { count, first })
}

/// The name of a view, with the extension of its image's file if it has none.
fn image_name(draft: &Draft, place: Option<&Place>) -> PathBuf {
    let bare = draft.file.as_ref().filter(|file| is_bare(file));
    let found = bare.and_then(|file| place?.find(file));
    let name = found.as_ref().and_then(|path| path.file_name());
    name.map_or_else(|| PathBuf::from(&draft.name), |name| Path::new(&draft.name).with_file_name(name))
}

/// A remark on a folder of masks, if the data set has no other masks.
fn unused_masks(kind: DatasetKind, root: &Path, drafts: &[Draft], remarks: &[Remark]) -> Option<Remark> {
    let is_missing = |remark: &Remark| matches!(remark, Remark::MasksMissing { .. });
    if drafts.iter().any(|draft| draft.mask.is_some()) || remarks.iter().any(is_missing) {
        return None;
    }
    let folder = ["masks", "mask"].into_iter().find(|folder| root.join(folder).is_dir())?;
    let how = match kind {
        DatasetKind::Nerfstudio | DatasetKind::Blender => "name the mask of each frame in its mask_path",
        _ => "the mask of an image is masks/NAME, by the name of the image",
    };
    Some(Remark::MasksUnused { folder, how })
}

/// The frame that suits the poses and points of a data set.
fn frame_of(drafts: &[Draft], points: &[WorldPoint]) -> WorldFrame {
    let cameras: Vec<DVec3> = drafts.iter().filter_map(|draft| Some(draft.pose.ok()?.position())).collect();
    let points: Vec<DVec3> = points.iter().map(|point| point.position).collect();
    WorldFrame::of(&cameras, &points)
}

/// The first view of the shape of a 360° image with another camera model, if its borders are those of
/// a 360° image, too.
fn unsplit_panorama(views: &[View]) -> Option<&View> {
    let is_wide = |view: &&View| view.source.face().is_none() && is_two_to_one((view.source.width, view.source.height));
    let first = views.iter().find(is_wide)?;
    let image = decode(&first.image, first.orientation).ok()?.image;
    shows_all_directions(&image).then_some(first)
}
