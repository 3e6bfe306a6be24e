//! The lists of frames for training, validation and tests in a `transforms.json`.

use std::{collections::HashMap, path::Path};

use crate::{
    dataset::{Remark, Skip, Split, assemble::Draft, names},
    error::Error,
};

/// A list of names with its key.
pub(super) type List<'a> = (Split, &'static str, &'a [String]);

/// Sets the split of each draft that a list names. The others are left out if there is a list for
/// training. *Source:* Nerfstudio, whose splits have no other frames either. Names may differ from
/// those of the frames in what [`names`] ignores, or have another folder, if that leaves one frame.
///
/// # Errors
/// [`Error::SplitMatchesNothing`] for a list without any frame.
pub(super) fn apply(path: &Path, lists: &[List<'_>], drafts: &mut [Draft]) -> Result<Vec<Remark>, Error> {
    let index = Index::new(drafts);
    let mut listed: Vec<[bool; 3]> = vec![[false; 3]; drafts.len()];
    let (mut other, mut missing) = (Vec::new(), Vec::new());
    for &(split, key, names) in lists {
        let mut matches = 0;
        for name in names {
            let found = index.find(name);
            matches += found.len();
            match found.first() {
                None => missing.push(name.clone()),
                Some(&first) if drafts[first].name != names::plain(name) => {
                    other.push((name.clone(), drafts[first].name.clone()));
                }
                Some(_) => {}
            }
            found.iter().for_each(|&frame| listed[frame][split as usize] = true);
        }
        if let (0, Some(first)) = (matches, names.first()) {
            let frame = drafts.first().map_or_else(String::new, |draft| draft.name.clone());
            return Err(Error::SplitMatchesNothing { path: path.to_owned(), key, first: first.clone(), frame });
        }
    }
    let mut remarks = Vec::new();
    if let Some((listed, frame)) = other.first() {
        remarks.push(Remark::ListedOtherwise { count: other.len(), listed: listed.clone(), frame: frame.clone() });
    }
    if let Some(first) = missing.first() {
        remarks.push(Remark::ListedWithoutFrame { count: missing.len(), first: first.clone() });
    }
    let is_in = |splits: [bool; 3], split: Split| splits[split as usize];
    let held_out = |splits| is_in(splits, Split::Test) || is_in(splits, Split::Validation);
    let twice = |splits: &[bool; 3]| is_in(*splits, Split::Train) && held_out(*splits);
    if let Some(first) = listed.iter().position(twice) {
        let count = listed.iter().filter(|splits| twice(splits)).count();
        remarks.push(Remark::ListedTwice { count, first: drafts[first].name.clone() });
    }
    let trains = lists.iter().any(|(split, ..)| *split == Split::Train);
    let mut unlisted = Vec::new();
    for (draft, splits) in drafts.iter_mut().zip(listed).filter(|(draft, _)| draft.split.is_none()) {
        // What is held out for tests is never trained on.
        let first = [Split::Test, Split::Validation, Split::Train].into_iter().find(|split| is_in(splits, *split));
        draft.split = first.or(Some(Split::Train));
        match first {
            Some(_) => {}
            None if trains => draft.intrinsics = Err(Skip::Unlisted.into()),
            None => unlisted.push(draft.name.clone()),
        }
    }
    if let Some(first) = unlisted.first() {
        remarks.push(Remark::UnlistedTrained { count: unlisted.len(), first: first.clone() });
    }
    Ok(remarks)
}

/// Finds frames by the names of lists.
struct Index([HashMap<String, Vec<usize>>; 4]);

impl Index {
    fn new(drafts: &[Draft]) -> Self {
        let mut levels: [HashMap<String, Vec<usize>>; 4] = Default::default();
        for (frame, draft) in drafts.iter().enumerate() {
            for (level, form) in levels.iter_mut().zip(Self::forms(&draft.name)) {
                level.entry(form).or_default().push(frame);
            }
        }
        Self(levels)
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

    /// The frames of a name: all that have it as it is, or the only one that has a looser form of it.
    fn find(&self, name: &str) -> &[usize] {
        let found = |(level, form): (&HashMap<String, Vec<usize>>, String)| level.get(&form).is_some();
        let forms = || self.0.iter().zip(Self::forms(name));
        let Some(strictest) = forms().position(found) else { return &[] };
        match forms().nth(strictest).and_then(|(level, form)| level.get(&form)) {
            Some(frames) if strictest == 0 || frames.len() == 1 => frames,
            _ => &[],
        }
    }
}
