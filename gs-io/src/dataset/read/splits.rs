//! Decides which views are for training and which are held out.

use std::num::NonZeroU32;

use crate::dataset::{DatasetSettings, Remark, Split, SplitOrigin, View};

/// Sets the split of all views, and returns where it comes from: the data set's own split, which
/// `views` already have and `stated` names, or every n-th image. The views of an image must be
/// neighbours. Returns `None` if no view is for training.
pub(crate) fn apply(
    stated: Option<SplitOrigin>,
    views: &mut [View],
    settings: &DatasetSettings,
    remarks: &mut Vec<Remark>,
) -> Option<SplitOrigin> {
    match stated {
        Some(origin) if !settings.replace_split => hold_out_tests(views, remarks).then_some(origin),
        Some(_) => {
            remarks.push(Remark::SplitReplaced);
            Some(match hold_out(views, settings.test_every, remarks) {
                SplitOrigin::Every(every) => SplitOrigin::Replaced(Some(every)),
                _ => SplitOrigin::Replaced(None),
            })
        }
        None => Some(hold_out(views, settings.test_every, remarks)),
    }
}

/// Holds out the views for validation if there are none for tests. Returns whether there is a view
/// for training.
fn hold_out_tests(views: &mut [View], remarks: &mut Vec<Remark>) -> bool {
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

/// Holds out every n-th image, or none if that would leave no view for training.
///
/// Neighbouring views of the same image file count as one image. So the faces of a 360° image stay
/// together, because each shows what its neighbours border on. Neighbouring frames of a
/// `transforms.json` that name the same file stay together, too, though their poses may differ.
fn hold_out(views: &mut [View], every: Option<NonZeroU32>, remarks: &mut Vec<Remark>) -> SplitOrigin {
    views.iter_mut().for_each(|view| view.split = Split::Train);
    let Some(every) = every else { return SplitOrigin::None };
    let images = views.chunk_by_mut(|a, b| a.image == b.image);
    let tests = images.step_by(every.get() as usize);
    tests.flatten().for_each(|view| view.split = Split::Test);
    if views.iter().any(|view| view.split == Split::Train) {
        return SplitOrigin::Every(every);
    }
    views.iter_mut().for_each(|view| view.split = Split::Train);
    remarks.push(Remark::NothingHeldOut);
    SplitOrigin::None
}
