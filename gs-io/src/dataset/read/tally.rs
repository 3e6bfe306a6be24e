//! Counts remarks on the views of a data set, with the first view of each kind.

use std::{collections::BTreeMap, path::Path};

use gs_core::Camera;

use crate::{
    dataset::{Remark, Skip, SourceCamera, View},
    error::Error,
    image::ImageRemark,
};

/// Counts so far.
#[derive(Default)]
pub(crate) struct Tally {
    skipped: BTreeMap<Skip, Remark>,
    images: BTreeMap<ImageRemark, Remark>,
    scaled: Option<Remark>,
    split: Option<Remark>,
    split_fisheye: Option<Remark>,
    reduced: Option<Remark>,
    off_center: Option<Remark>,
    bent: BTreeMap<&'static str, Remark>,
    bad_depths: Option<Remark>,
    renamed: Option<Remark>,
}

/// The most images that are named if there is no file of theirs.
const NAMED: usize = 3;

impl Tally {
    /// Counts a view that is left out.
    pub(crate) fn skip(&mut self, name: &str, why: Skip, detail: Option<String>) {
        let new = || Remark::Skipped { why, count: 0, first: name.to_owned(), detail };
        let remark = self.skipped.entry(why).or_insert_with(new);
        if let Remark::Skipped { why: Skip::NoImage, count: 1..NAMED, first, .. } = remark {
            first.push_str(", ");
            first.push_str(name);
        }
        add(remark);
    }

    /// Whether a view was left out for this reason.
    pub(crate) fn has(&self, why: Skip) -> bool {
        self.skipped.contains_key(&why)
    }

    /// Counts an image whose file has another name than in the data set at `root`.
    pub(crate) fn count_renamed(&mut self, name: &str, root: &Path, file: &Path) {
        let file = file.strip_prefix(root).unwrap_or(file).display().to_string();
        add(self.renamed.get_or_insert_with(|| Remark::Renamed { count: 0, first: name.to_owned(), file }));
    }

    /// Counts a depth map that cannot be used.
    pub(crate) fn count_bad_depth(&mut self, error: &Error) {
        add(self.bad_depths.get_or_insert_with(|| Remark::DepthsUnusable { count: 0, first: error.to_string() }));
    }

    /// Counts an image that stays by its views, with the size of its calibration and the remarks on its file.
    pub(crate) fn count(&mut self, of_image: &[View], calibrated: (u64, u64), remarks: &[ImageRemark]) {
        let Some(view) = of_image.first() else { return };
        let SourceCamera { width, height, lens, .. } = view.source;
        if view.source.is_panorama() {
            add(self.split.get_or_insert(Remark::Split { count: 0 }));
        } else if view.source.face().is_some() {
            let remark = self.split_fisheye.get_or_insert(Remark::SplitFisheye { count: 0, views: 0 });
            add(remark);
            if let Remark::SplitFisheye { views, .. } = remark {
                *views += of_image.len();
            }
        } else if !lens.is_pinhole() {
            let lens = lens.distortion().name();
            add(self.bent.entry(lens).or_insert(Remark::Undistorted { count: 0, lens }));
        }
        if calibrated != (u64::from(width), u64::from(height)) {
            add(self.scaled.get_or_insert(Remark::Scaled { count: 0, from: calibrated, to: (width, height) }));
        }
        let size = |camera: &Camera| (camera.width, camera.height);
        let (from, to) = (size(&view.full), size(&view.camera));
        if from != to {
            add(self.reduced.get_or_insert(Remark::Reduced { count: 0, max_side: to.0.max(to.1), from, to }));
        }
        let [x, y] = view.source.center.to_array();
        let axes = [("cx", x, width), ("cy", y, height)];
        if let Some((key, value, side)) =
            axes.into_iter().find(|(_, value, side)| !(0.0..=f64::from(*side)).contains(value))
        {
            let fault = format!("{key} is {value}, of {side} px");
            add(self.off_center.get_or_insert_with(|| Remark::OffCenter { count: 0, first: view.name.clone(), fault }));
        }
        for remark in remarks {
            let first = || Remark::Image { remark: remark.clone(), count: 0, first: view.name.clone() };
            add(self.images.entry(remark.clone()).or_insert_with(first));
        }
    }

    /// All remarks.
    pub(crate) fn remarks(self) -> Vec<Remark> {
        let images = self.renamed.into_iter().chain(self.images.into_values());
        let sizes = self.split.into_iter().chain(self.split_fisheye).chain(self.scaled).chain(self.reduced);
        let sizes = sizes.chain(self.off_center);
        let rest = self.bent.into_values().chain(self.bad_depths);
        self.skipped.into_values().chain(images).chain(sizes).chain(rest).collect()
    }
}

/// Increments a remark's count.
fn add(remark: &mut Remark) {
    if let Remark::Skipped { count, .. }
    | Remark::Image { count, .. }
    | Remark::Scaled { count, .. }
    | Remark::Reduced { count, .. }
    | Remark::Undistorted { count, .. }
    | Remark::DepthsUnusable { count, .. }
    | Remark::Renamed { count, .. }
    | Remark::OffCenter { count, .. }
    | Remark::SplitFisheye { count, .. }
    | Remark::Split { count } = remark
    {
        *count += 1;
    }
}
