//! Examination and repair of scenes from elsewhere, Gaussian by Gaussian.
//!
//! A Gaussian is *broken* where it draws nothing in any view, or makes its scene be refused as not
//! finite. It is *doubtful* where it is drawn, but is probably not what its maker meant. [`repair`]
//! changes broken Gaussians only, so the repaired scene looks the same: all that could be drawn
//! stays, bit for bit.
//!
//! ```
//! use gs_core::{Scene, Gaussian3d, Scene3d, examination::{Finding, examine, repair}};
//! use glam::Vec3;
//!
//! let good = Gaussian3d {
//!     mean: Vec3::ZERO,
//!     log_scale: Vec3::ZERO,
//!     rotation: [1.0, 0.0, 0.0, 0.0],
//!     opacity_logit: 0.0,
//!     sh: vec![Vec3::ZERO],
//! };
//! let mut scene = Scene3d::default();
//! scene.push(Gaussian3d { mean: Vec3::NAN, ..good.clone() });
//! scene.push(good);
//! let examination = examine(&scene)?;
//! let case = examination.cases[0];
//! assert_eq!((case.finding, case.count, case.first), (Finding::MeanNotFinite, 1, 0));
//! assert_eq!(repair(&mut scene)?.removed, 1);
//! assert_eq!(examine(&scene)?.broken(), 0);
//! # Ok::<(), gs_core::Error>(())
//! ```

mod finding;
mod kinds;
mod whole;

pub use self::{
    finding::{
        EXTREME_COLOR, Finding, NEEDLE_ASPECT, OUT_OF_RANGE_LOGIT, OUTLIER_DISTANCES, Remedy, SMALLEST_LOG_SCALE,
    },
    kinds::Examinable,
};
use crate::error::Error;
#[cfg(doc)]
use crate::scene::Scene;

/// A finding and how many Gaussians have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct Case {
    /// The finding.
    pub finding: Finding,
    /// Number of Gaussians with the finding.
    pub count: usize,
    /// Index of the first Gaussian with the finding.
    pub first: usize,
}

/// Result of [`examine`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Examination {
    /// Number of Gaussians in the scene.
    pub gaussians: usize,
    /// The findings, in the order of [`Finding`]; one Gaussian may have several.
    pub cases: Vec<Case>,
    /// Indices of the Gaussians that [`repair`] removes, ascending.
    pub removed: Vec<usize>,
    /// Indices of the Gaussians that [`repair`] keeps and widens, ascending.
    pub widened: Vec<usize>,
}

impl Examination {
    /// Number of broken Gaussians.
    pub fn broken(&self) -> usize {
        self.removed.len() + self.widened.len()
    }
}

/// Result of [`repair`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[non_exhaustive]
pub struct Repair {
    /// Number of Gaussians removed: [`Remedy::Remove`].
    pub removed: usize,
    /// Number of Gaussians whose scale of 0 was raised: [`Remedy::Widen`].
    pub widened: usize,
}

/// Examines every Gaussian of a scene. Time O(N log N), memory a few bytes a Gaussian.
///
/// # Errors
/// Those of [`Scene::check_lengths`].
pub fn examine<S: Examinable>(scene: &S) -> Result<Examination, Error> {
    scene.check_lengths()?;
    let mut cases: Vec<Case> = Vec::new();
    let mut note = |index: usize, finding: Finding| match cases.iter_mut().find(|case| case.finding == finding) {
        Some(case) => {
            case.count += 1;
            case.first = case.first.min(index);
        }
        None => cases.push(Case { finding, count: 1, first: index }),
    };
    let (mut removed, mut widened) = (Vec::new(), Vec::new());
    let mut drawn = Vec::with_capacity(scene.len());
    for index in 0..scene.len() {
        let mut worst = Remedy::Leave;
        scene.examine_one(index, &mut |finding| {
            worst = worst.max(finding.remedy());
            note(index, finding);
        });
        match worst {
            Remedy::Remove => removed.push(index),
            Remedy::Widen => widened.push(index),
            Remedy::Leave => drawn.push(index),
        }
    }
    // Broken Gaussians have no place or shape to compare.
    whole::duplicates(scene, &drawn, &mut |index| note(index, Finding::Duplicate));
    whole::outliers(scene, &drawn, &mut |index| note(index, Finding::Outlier));
    whole::activated(scene, &mut note);
    cases.sort_unstable_by_key(|case| case.finding);
    Ok(Examination { gaussians: scene.len(), cases, removed, widened })
}

/// Repairs a scene: removes Gaussians that cannot be drawn, and raises scales of 0 to the smallest
/// that a file can hold.
///
/// All other Gaussians stay as they are, bit for bit and in their order.
///
/// # Errors
/// Those of [`examine`]; the scene is then unchanged.
pub fn repair<S: Examinable>(scene: &mut S) -> Result<Repair, Error> {
    let Examination { removed, widened, .. } = examine(scene)?;
    for &index in &widened {
        scene.widen(index);
    }
    if !removed.is_empty() {
        let mut keep = vec![true; scene.len()];
        removed.iter().for_each(|&index| keep[index] = false);
        scene.retain(&keep);
    }
    Ok(Repair { removed: removed.len(), widened: widened.len() })
}

#[cfg(test)]
mod tests;
