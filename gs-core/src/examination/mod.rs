//! What is wrong with a scene that somebody made, Gaussian by Gaussian, and its repair.
//!
//! A Gaussian is *broken* where it draws nothing in any view, or where a scene that holds it is refused as not finite; it is *doubtful*
//! where it is drawn as it stands, but probably is not what its maker meant. [`repair`] mends what is broken and nothing else, so that a
//! repaired scene looks as the broken one did: what could be drawn is as it was, bit for bit.
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
//! assert!(examine(&scene)?.is_sound());
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

/// A finding and the Gaussians that it is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Case {
    /// What was found.
    pub finding: Finding,
    /// In how many Gaussians.
    pub count: usize,
    /// The first of them.
    pub first: usize,
}

/// What was found in a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Examination {
    /// Gaussians in all.
    pub gaussians: usize,
    /// What was found, in the order of [`Finding`]; one Gaussian may be in several.
    pub cases: Vec<Case>,
    /// The Gaussians that [`repair`] removes, ascending.
    pub removed: Vec<usize>,
    /// Those that it keeps and widens, ascending.
    pub widened: Vec<usize>,
}

impl Examination {
    /// Whether nothing is broken: there is nothing to repair.
    pub fn is_sound(&self) -> bool {
        self.removed.is_empty() && self.widened.is_empty()
    }

    /// Broken Gaussians.
    pub fn broken(&self) -> usize {
        self.removed.len() + self.widened.len()
    }
}

/// What [`repair`] has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Repair {
    /// Gaussians that are gone: [`Remedy::Remove`].
    pub removed: usize,
    /// Gaussians of which a scale of 0 was raised: [`Remedy::Widen`].
    pub widened: usize,
}

/// Examines every Gaussian of a scene. Time O(N log N), memory a few bytes a Gaussian.
///
/// # Errors
/// [`Error::Length`] and [`Error::Setting`] for arrays that do not describe the same Gaussians, of which none can be said to be broken.
pub fn examine<S: Examinable>(scene: &S) -> Result<Examination, Error> {
    scene.validate_lengths()?;
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
    // Of broken Gaussians no place and no shape is known to compare.
    whole::duplicates(scene, &drawn, &mut |index| note(index, Finding::Duplicate));
    whole::outliers(scene, &drawn, &mut |index| note(index, Finding::Outlier));
    cases.sort_unstable_by_key(|case| case.finding);
    Ok(Examination { gaussians: scene.len(), cases, removed, widened })
}

/// Mends what is broken: removes what cannot be drawn, and gives a scale of 0 the smallest that a file can hold. All else stays as it is,
/// bit for bit and in its order.
///
/// # Errors
/// Those of [`examine`]; the scene is then as it was.
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
