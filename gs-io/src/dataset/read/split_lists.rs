//! The lists of frames for training, validation and tests: in a `transforms.json`, and in files of
//! their own.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use serde::Deserialize;

use super::{Draft, names, parse};
use crate::{
    atomic::read_file,
    dataset::{DatasetSettings, FILE, Remark, Skip, Split, SplitOrigin},
    error::Error,
    text::utf8_text,
};

/// ScanNet++'s file of lists, in the folder above those of its cameras.
const TRAIN_TEST: &str = "train_test_lists.json";

/// The list of test images beside a COLMAP model. *Source:* `dataset_readers.py` of 3DGS.
const TEST: &str = "test.txt";

/// A list of names with its key.
pub(crate) type List = (Split, &'static str, Vec<String>);

/// The lists in files of their own, with the file; a `model` is COLMAP's.
///
/// # Errors
/// Those of reading a file, and [`Error::Unusable`].
pub(crate) fn in_files(
    root: &Path,
    model: Option<&Path>,
    settings: &DatasetSettings,
) -> Result<Option<(PathBuf, Vec<List>)>, Error> {
    #[derive(Deserialize)]
    struct TrainTest {
        train: Vec<String>,
        test: Vec<String>,
    }
    let above = settings.allow_outside.then(|| root.join(".."));
    let paths = std::iter::once(root.to_owned()).chain(above).map(|folder| folder.join(TRAIN_TEST));
    if let Some(path) = paths.into_iter().find(|path| path.is_file()) {
        let TrainTest { train, test } = parse(&path)?;
        return Ok(Some((path, vec![(Split::Train, "train", train), (Split::Test, "test", test)])));
    }
    let Some(path) = model.map(|model| model.join(TEST)).filter(|path| path.is_file()) else { return Ok(None) };
    let bytes = read_file(&path, FILE)?;
    let text = String::from_utf8_lossy(utf8_text(&path, &bytes)?);
    let names = text.lines().map(|line| line.trim().to_owned()).filter(|name| !name.is_empty()).collect();
    Ok(Some((path, vec![(Split::Test, "the list", names)])))
}

/// In which of the lists for training, validation and tests a frame is.
type Listed = [bool; 3];

fn is_in(listed: &Listed, split: Split) -> bool {
    listed[split as usize]
}

/// Sets the split of each draft that a list names, unless the settings replace it, and returns where
/// it comes from. The others are left out if there is a list for training. *Source:* Nerfstudio, whose
/// splits have no other frames either. Names may differ from those of the frames in what [`names`]
/// ignores, and lack the folder, if that leaves one frame.
///
/// # Errors
/// [`Error::Unusable`] for a list without any frame.
pub(crate) fn apply(
    lists: Option<(PathBuf, Vec<List>)>,
    drafts: &mut [Draft],
    remarks: &mut Vec<Remark>,
    settings: &DatasetSettings,
) -> Result<Option<SplitOrigin>, Error> {
    let Some((path, lists)) = lists else { return Ok(None) };
    if settings.replace_split || lists.is_empty() {
        return Ok(Some(SplitOrigin::Lists));
    }
    let (listed, of_names) = find(&path, &lists, drafts)?;
    remarks.extend(of_names);
    let held_out = |listed: &Listed| is_in(listed, Split::Test) || is_in(listed, Split::Validation);
    let mut twice = listed.iter().zip(&*drafts).filter(|(listed, _)| is_in(listed, Split::Train) && held_out(listed));
    if let Some((_, draft)) = twice.next() {
        remarks.push(Remark::ListedTwice { first: draft.name.clone(), count: 1 + twice.count() });
    }
    let trains = lists.iter().any(|(split, ..)| *split == Split::Train);
    let mut unlisted = Vec::new();
    for (draft, listed) in drafts.iter_mut().zip(&listed).filter(|(draft, _)| draft.split.is_none()) {
        // What is held out for tests is never trained on.
        let first = [Split::Test, Split::Validation, Split::Train].into_iter().find(|split| is_in(listed, *split));
        draft.split = first.or(Some(Split::Train));
        match first {
            Some(_) => {}
            None if trains => draft.intrinsics = Err(Skip::Unlisted.into()),
            None => unlisted.push(draft.name.clone()),
        }
    }
    // 3DGS's list is one of tests alone.
    if let Some(first) = unlisted.first().filter(|_| !path.ends_with(TEST)) {
        remarks.push(Remark::UnlistedTrained { count: unlisted.len(), first: first.clone() });
    }
    Ok(Some(SplitOrigin::Lists))
}

/// The lists that each draft is in, with remarks on names that fit none or only loosely.
fn find(path: &Path, lists: &[List], drafts: &[Draft]) -> Result<(Vec<Listed>, Vec<Remark>), Error> {
    let index = Index::new(drafts);
    let mut listed = vec![Listed::default(); drafts.len()];
    let (mut other, mut missing) = (Vec::new(), Vec::new());
    for (split, key, names) in lists {
        let mut matches = 0;
        for name in names {
            let frames = index.find(name);
            matches += frames.len();
            frames.iter().for_each(|&frame| listed[frame][*split as usize] = true);
            match frames.first().map(|&frame| &drafts[frame].name) {
                None => missing.push(name),
                Some(frame) if *frame != names::plain(name) => other.push((name, frame)),
                Some(_) => {}
            }
        }
        if let (0, Some(first), Some(frame)) = (matches, names.first(), drafts.first()) {
            let names = format!("it begins with `{first}`, the frames with `{}`", frame.name);
            let problem = format!("{key} names no frame of the data set: {names}");
            return Err(Error::unusable(path, problem, "correct the names or remove the list"));
        }
    }
    let other = other.first().map(|&(listed, frame)| Remark::ListedOtherwise {
        count: other.len(),
        listed: listed.clone(),
        frame: frame.clone(),
    });
    let missing =
        missing.first().map(|&first| Remark::ListedWithoutFrame { count: missing.len(), first: first.clone() });
    Ok((listed, other.into_iter().chain(missing).collect()))
}

/// Finds frames by the names of lists.
struct Index<'d> {
    drafts: &'d [Draft],
    /// Of each of the [`forms`] of a name, the frames that have it.
    levels: [HashMap<String, Vec<usize>>; 4],
}

/// The forms of a name, from the strictest: as it is, without regard to case, without extension,
/// without folder.
fn forms(name: &str) -> [String; 4] {
    let plain = names::plain(name);
    let folded = names::folded(&plain);
    let stem = names::without_extension(&folded).to_owned();
    let file = stem.rsplit('/').next().unwrap_or(&stem).to_owned();
    [plain, folded, stem, file]
}

impl<'d> Index<'d> {
    fn new(drafts: &'d [Draft]) -> Self {
        let mut levels: [HashMap<String, Vec<usize>>; 4] = Default::default();
        for (frame, draft) in drafts.iter().enumerate() {
            for (level, form) in levels.iter_mut().zip(forms(&draft.name)) {
                level.entry(form).or_default().push(frame);
            }
        }
        Self { drafts, levels }
    }

    /// The frames of a name: all that have it as it is, or the only one that has a looser form of it.
    /// If both have folders, those of one must end the other.
    fn find(&self, name: &str) -> Vec<usize> {
        let forms = forms(name);
        let strictest = self.levels.iter().zip(&forms).position(|(level, form)| level.contains_key(form));
        let Some(mut frames) = strictest.and_then(|at| self.levels[at].get(&forms[at])).cloned() else {
            return Vec::new();
        };
        frames
            .retain(|&frame| strictest != Some(3) || ends_alike(&forms[2], &self::forms(&self.drafts[frame].name)[2]));
        if strictest == Some(0) || frames.len() == 1 { frames } else { Vec::new() }
    }
}

/// Whether one path is the end of the other, by whole parts.
fn ends_alike(a: &str, b: &str) -> bool {
    let ends = |long: &str, short: &str| long.strip_suffix(short).is_some_and(|start| start.ends_with('/'));
    a == b || ends(a, b) || ends(b, a)
}
