//! Counts remarks on the views of a data set, with the first view of each kind.

use std::{mem::discriminant, path::Path};

use gs_core::Camera;

use crate::{
    dataset::{Remark, Skip, SourceCamera, View},
    error::Error,
    image::ImageRemark,
};

/// The remarks so far.
#[derive(Default)]
pub(crate) struct Tally(Vec<Remark>);

/// The most images that are named if there is no file of theirs.
const NAMED: usize = 3;

impl Tally {
    /// Counts a view that is left out.
    pub(crate) fn skip(&mut self, name: &str, why: Skip, detail: Option<String>) {
        let remark = self.add(Remark::Skipped { why, count: 0, first: name.to_owned(), detail });
        if let Remark::Skipped { why: Skip::NoImage, count: 2..=NAMED, first, .. } = remark {
            first.push_str(", ");
            first.push_str(name);
        }
    }

    /// Whether a view was left out for this reason.
    pub(crate) fn has(&self, why: Skip) -> bool {
        self.0.iter().any(|remark| matches!(remark, Remark::Skipped { why: known, .. } if *known == why))
    }

    /// Counts an image whose file has another name than in the data set at `root`.
    pub(crate) fn count_renamed(&mut self, name: &str, root: &Path, file: &Path) {
        let file = file.strip_prefix(root).unwrap_or(file).display().to_string();
        self.add(Remark::Renamed { count: 0, first: name.to_owned(), file });
    }

    /// Counts a depth map that cannot be used.
    pub(crate) fn count_bad_depth(&mut self, error: &Error) {
        self.add(Remark::DepthsUnusable { count: 0, first: error.to_string() });
    }

    /// Counts an image that stays by its views, with the size of its calibration and the remarks on its file.
    pub(crate) fn count(&mut self, of_image: &[View], calibrated: (u64, u64), remarks: &[ImageRemark]) {
        let Some(view) = of_image.first() else { return };
        let SourceCamera { width, height, lens, .. } = view.source;
        if view.source.is_panorama() {
            self.add(Remark::Split { count: 0 });
        } else if view.source.face().is_some() {
            if let Remark::SplitFisheye { views, .. } = self.add(Remark::SplitFisheye { count: 0, views: 0 }) {
                *views += of_image.len();
            }
        } else if !lens.is_pinhole() {
            self.add(Remark::Undistorted { lens: lens.distortion().name(), count: 0 });
        }
        if calibrated != (u64::from(width), u64::from(height)) {
            self.add(Remark::Scaled { count: 0, from: calibrated, to: (width, height) });
        }
        let size = |camera: &Camera| (camera.width, camera.height);
        let (from, to) = (size(&view.full), size(&view.camera));
        if from != to {
            self.add(Remark::Reduced { count: 0, max_side: to.0.max(to.1), from, to });
        }
        let [x, y] = view.source.center.to_array();
        let axes = [("cx", x, width), ("cy", y, height)];
        let is_outside = |(_, value, side): &(_, f64, u32)| !(0.0..=f64::from(*side)).contains(value);
        if let Some((key, value, side)) = axes.into_iter().find(is_outside) {
            let fault = format!("{key} is {value}, of {side} px");
            self.add(Remark::OffCenter { count: 0, first: view.name.clone(), fault });
        }
        for remark in remarks {
            self.add(Remark::Image { remark: remark.clone(), count: 0, first: view.name.clone() });
        }
    }

    /// All remarks, by their kinds.
    pub(crate) fn remarks(mut self) -> Vec<Remark> {
        self.0.sort();
        self.0
    }

    /// Counts one more of the remarks of a kind; the first gives the details.
    fn add(&mut self, remark: Remark) -> &mut Remark {
        let known = self.0.iter().position(|known| is_of_kind(known, &remark)).unwrap_or_else(|| {
            self.0.push(remark);
            self.0.len() - 1
        });
        if let Remark::Skipped { count, .. }
        | Remark::Image { count, .. }
        | Remark::Scaled { count, .. }
        | Remark::Reduced { count, .. }
        | Remark::Undistorted { count, .. }
        | Remark::DepthsUnusable { count, .. }
        | Remark::Renamed { count, .. }
        | Remark::OffCenter { count, .. }
        | Remark::SplitFisheye { count, .. }
        | Remark::Split { count } = &mut self.0[known]
        {
            *count += 1;
        }
        &mut self.0[known]
    }
}

fn is_of_kind(known: &Remark, remark: &Remark) -> bool {
    match (known, remark) {
        (Remark::Skipped { why: a, .. }, Remark::Skipped { why: b, .. }) => a == b,
        (Remark::Image { remark: a, .. }, Remark::Image { remark: b, .. }) => a == b,
        (Remark::Undistorted { lens: a, .. }, Remark::Undistorted { lens: b, .. }) => a == b,
        _ => discriminant(known) == discriminant(remark),
    }
}
