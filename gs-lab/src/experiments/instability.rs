//! Numerical instability (paper §3.4.2): what becomes of a loss and its gradients as a scale goes to zero, without guards, with the
//! paper's clamp and ε, and with this project's guards, which allow less than a pixel; and what each costs in PSNR.
//!
//! The product's guards cannot be switched off. What is computed without them is computed by `textbook`, a dense solver as the paper's
//! formulas are written down, of which nothing else is used. A fit that diverges ends no experiment here, whichever solver made it: it is
//! counted.

mod driven;
mod findings;
mod floors;
mod precision;
mod small_fits;

use gs_core::{Optimizer, Scene2d};

pub use self::{
    driven::Drive,
    floors::{Floor, floor_settings},
    precision::{Determinant, Precision},
    small_fits::{Free, Trajectory, small_settings},
};
use super::{
    Cell, Circumstance, Claim, Findings, Laboratory, Number, Paired, Picture, SHARP_DB, Table, findings::significant,
    paired::gain, textbook::Guards,
};
use crate::figure::{Axis, Figure, Marks, Series};
use crate::synthetic::SyntheticTarget;
use gs_train::Error;

/// Length of the needle whose other scale is driven to zero, px.
const NEEDLE_PX: f32 = 10.0;

/// The paper's clamp, px.
const CLAMP_PX: f32 = 1.0;

/// This project's floor of the scales, px.
const PROJECT_FLOOR_PX: f32 = 0.25;

/// The smallest σ allowed in the fits that price a floor, px: the paper's and this project's.
pub const FLOORS_PX: [f32; 2] = [CLAMP_PX, PROJECT_FLOOR_PX];

/// What keeps a scale from harm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Guard {
    /// Nothing.
    Off,
    /// An ε of 1e-6 px⁴ on the determinant.
    Epsilon,
    /// No scale below 1 px, and the ε: the paper's.
    Paper,
    /// This project's: the product itself.
    Project,
}

impl Guard {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Off, Self::Epsilon, Self::Paper, Self::Project];

    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "none",
            Self::Epsilon => "ε = 1e-6 on the determinant",
            Self::Paper => "the paper's: σ ≥ 1 px and ε",
            Self::Project => "this project's: σ ≥ 0.25 px",
        }
    }

    /// The textbook's; nothing for the product, which has its own.
    fn of_textbook(self) -> Option<Guards> {
        match self {
            Self::Off => Some(Guards::OFF),
            Self::Epsilon => Some(Guards::EPSILON),
            Self::Paper => Some(Guards::PAPER),
            Self::Project => None,
        }
    }
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct InstabilityMeasured {
    /// The determinant of a needle of 10 px.
    pub precision: Precision,
    /// A scale that is driven to zero, as in [`Guard::ALL`].
    pub drives: Vec<Drive>,
    /// Fits that may drive one there themselves.
    pub free: Vec<Free>,
    /// The price of a floor, in fits of 600 Gaussians.
    pub floors: Vec<Floor>,
    pictures: Vec<Picture>,
}

/// Drives a scale to zero with every guard, lets fits do so, and prices the floors.
///
/// # Errors
/// Those of the product's fits but for [`Error::Diverged`], which is counted.
pub fn measure<R: Optimizer<Scene2d>>(laboratory: &mut Laboratory<'_, R>) -> Result<InstabilityMeasured, Error> {
    let small = SyntheticTarget::THIN_LINES_24_PX.image();
    let angles = laboratory.extent().choose(32, 8);
    let drives = Guard::ALL.iter().map(|&guard| Drive::measure(laboratory.rasterizer(), guard, &small, angles));
    let drives = drives.collect::<Result<_, Error>>()?;
    let free = Free::measure_all(laboratory, &small)?;
    let (mut floors, mut pictures) = (Vec::new(), Vec::new());
    for (name, target) in [("circle and square", SyntheticTarget::PAPER), ("thin lines", SyntheticTarget::THIN_LINES)] {
        let target = target.image();
        for min_scale_px in FLOORS_PX {
            let (floor, picture) = Floor::measure(laboratory, name, &target, min_scale_px)?;
            floors.push(floor);
            pictures.extend(picture.filter(|_| name == "thin lines"));
        }
    }
    Ok(InstabilityMeasured { precision: Precision::of_needle(), drives, free, floors, pictures })
}

/// What a fit came to, or nothing where it diverged.
fn unless_diverged<T>(made: Result<T, Error>) -> Result<Option<T>, Error> {
    match made {
        Ok(made) => Ok(Some(made)),
        Err(Error::Diverged { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

impl InstabilityMeasured {
    /// A driven scale under a guard.
    ///
    /// # Panics
    /// Never: all guards are measured.
    pub fn drive(&self, guard: Guard) -> &Drive {
        self.drives.iter().find(|drive| drive.guard == guard).expect("all guards are measured")
    }

    /// The fits of a target with a floor.
    ///
    /// # Panics
    /// Where they were not made: targets are "circle and square" and "thin lines", floors 1 and 0.25 px.
    pub fn floor(&self, target: &str, min_scale_px: f32) -> &Floor {
        let mut floors = self.floors.iter();
        floors.find(|f| f.target == target && f.min_scale_px == min_scale_px).expect("all floors are measured")
    }

    /// PSNR with the clamp at 1 px less that with this project's floor and the same seed, dB, where both fits lived.
    pub fn price_of_clamp(&self, target: &str) -> Paired {
        let [clamped, guarded] = [CLAMP_PX, PROJECT_FLOOR_PX].map(|floor| &self.floor(target, floor).psnr);
        let pairs = clamped.iter().zip(guarded).filter_map(|(clamped, guarded)| Some(gain((*clamped)?, (*guarded)?)));
        Paired::of(&pairs.collect::<Vec<_>>())
    }

    /// (fits, of them diverged) with a guard, whatever the step of the scales.
    pub fn free_fits(&self, guard: Guard) -> (usize, usize) {
        let with = self.free.iter().filter(|free| free.guard == guard);
        with.fold((0, 0), |(fits, diverged), free| (fits + free.fits(), diverged + free.diverged()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_divergence_is_counted_and_other_errors_are_not() {
        let diverged = Error::Diverged { step: 3, loss: f32::NAN, suspect: None };
        assert_eq!(unless_diverged::<()>(Err(diverged)).unwrap(), None);
        assert_eq!(unless_diverged(Ok(7)).unwrap(), Some(7));
        assert!(unless_diverged::<()>(Err(Error::Finished { iterations: 3 })).is_err());
    }
}
