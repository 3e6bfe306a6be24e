//! Decides which views are for training and which are held out.

use std::num::NonZeroU32;

use crate::dataset::{DatasetSettings, Remark, Split, SplitOrigin, View};

/// The images with their views and splits. `images` has the number of views of each image, and its
/// split in the data set: the faces of a 360° image stay together, because each shows what its
/// neighbours border on.
fn by_image<'v>(
    views: &'v mut [View],
    images: &[(usize, Option<Split>)],
) -> impl Iterator<Item = (&'v mut [View], Option<Split>)> {
    let mut rest = views;
    images.iter().map(move |&(count, stored)| {
        let (of_image, others) = std::mem::take(&mut rest).split_at_mut(count);
        rest = others;
        (of_image, stored)
    })
}

/// Decides the split of all views: by the data set, or every n-th image. `None` if no view is for
/// training.
pub(crate) fn apply(
    stated: Option<SplitOrigin>,
    views: &mut [View],
    images: &[(usize, Option<Split>)],
    settings: &DatasetSettings,
    remarks: &mut Vec<Remark>,
) -> Option<SplitOrigin> {
    match stated {
        Some(origin) if !settings.replace_split => apply_stated(views, images, remarks).then_some(origin),
        Some(_) => {
            remarks.push(Remark::SplitReplaced);
            Some(match hold_out(views, images, settings.test_every, remarks) {
                SplitOrigin::Every(every) => SplitOrigin::Replaced(Some(every)),
                _ => SplitOrigin::Replaced(None),
            })
        }
        None => Some(hold_out(views, images, settings.test_every, remarks)),
    }
}

/// Applies the data set's own split; returns whether there is a view for training. Without test
/// views, those for validation are held out in their place.
fn apply_stated(views: &mut [View], images: &[(usize, Option<Split>)], remarks: &mut Vec<Remark>) -> bool {
    for (of_image, stored) in by_image(views, images) {
        of_image.iter_mut().for_each(|view| view.split = stored.unwrap_or(Split::Train));
    }
    let count = |views: &[View], split: Split| views.iter().filter(|view| view.split == split).count();
    if count(views, Split::Test) == 0 {
        remarks.push(match count(views, Split::Validation) {
            0 => Remark::NoTestViews,
            count => Remark::ValidationTested { count },
        });
        views.iter_mut().filter(|view| view.split == Split::Validation).for_each(|view| view.split = Split::Test);
    }
    count(views, Split::Train) > 0
}

/// Holds out every n-th image of a data set without a split, unless that would leave none.
fn hold_out(
    views: &mut [View],
    images: &[(usize, Option<Split>)],
    every: Option<NonZeroU32>,
    remarks: &mut Vec<Remark>,
) -> SplitOrigin {
    let Some(every) = every else { return SplitOrigin::None };
    for (i, (of_image, _)) in by_image(views, images).enumerate() {
        let split = if i.is_multiple_of(every.get() as usize) { Split::Test } else { Split::Train };
        of_image.iter_mut().for_each(|view| view.split = split);
    }
    if views.iter().any(|view| view.split == Split::Train) {
        return SplitOrigin::Every(every);
    }
    views.iter_mut().for_each(|view| view.split = Split::Train);
    remarks.push(Remark::NothingHeldOut);
    SplitOrigin::None
}
