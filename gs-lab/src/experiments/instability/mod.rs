//! Numerical instability (paper §3.4.2): loss and gradients as a scale goes to zero, without
//! guards, with the paper's clamp and ε, and with this project's guards, which allow scales below a
//! pixel; and the price of each in PSNR.
//!
//! The product's guards cannot be switched off. Fits without them use `textbook`, a dense solver
//! that follows the paper's formulas literally. A fit that diverges is counted and does not end the
//! experiment.

mod driven;
mod findings;
mod floors;
mod guard;
mod precision;
mod small_fits;
mod textbook;

use gs_core::{Optimizer, Scene2d};

#[cfg(test)]
pub(crate) use self::floors::floor_settings;
use self::guard::CLAMP_PX;
pub(crate) use self::{
    driven::Drive,
    floors::Floor,
    guard::Guard,
    precision::{Determinant, Precision},
    small_fits::{Free, Trajectory},
};
use super::{
    Cell, Circumstance, Claim, Findings, Laboratory, Number, Paired, Picture, Table, findings::significant,
    laboratory::SHARP_DB, paired::gain,
};
use crate::report::figure::{Axis, Figure, Marks, Series};
use crate::synthetic::SyntheticTarget;
use gs_train::Error;

/// This project's minimum scale, px.
const PROJECT_FLOOR_PX: f32 = 0.25;

/// The minimum scales whose price is measured, px: the paper's and this project's.
pub(crate) const FLOORS_PX: [f32; 2] = [CLAMP_PX, PROJECT_FLOOR_PX];

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct InstabilityMeasured {
    /// The determinant of a needle of 10 px.
    pub(crate) precision: Precision,
    /// A scale that is set to ever smaller values, as in [`Guard::ALL`].
    pub(crate) drives: Vec<Drive>,
    /// Small fits in which the optimizer may shrink a scale by itself.
    pub(crate) free: Vec<Free>,
    /// The price of a minimum scale, in fits of 600 Gaussians.
    pub(crate) floors: Vec<Floor>,
    pictures: Vec<Picture>,
}

/// Sets a scale to ever smaller values with every guard, makes small fits, and measures the price
/// of minimum scales.
pub(crate) fn measure<R: Optimizer<Scene2d>>(laboratory: &mut Laboratory<'_, R>) -> Result<InstabilityMeasured, Error> {
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

impl InstabilityMeasured {
    /// The results of setting a scale under a guard.
    pub(crate) fn drive(&self, guard: Guard) -> &Drive {
        self.drives.iter().find(|drive| drive.guard == guard).expect("all guards are measured")
    }

    /// The fits of a target with a minimum scale.
    pub(crate) fn floor(&self, target: &str, min_scale_px: f32) -> &Floor {
        let mut floors = self.floors.iter();
        floors.find(|f| f.target == target && f.min_scale_px == min_scale_px).expect("all floors are measured")
    }

    /// PSNR with the clamp at 1 px less that with this project's minimum and the same seed, dB,
    /// where neither fit diverged.
    pub(crate) fn price_of_clamp(&self, target: &str) -> Paired {
        let [clamped, guarded] = [CLAMP_PX, PROJECT_FLOOR_PX].map(|floor| &self.floor(target, floor).psnr);
        let pairs = clamped.iter().zip(guarded).filter_map(|(clamped, guarded)| Some(gain((*clamped)?, (*guarded)?)));
        Paired::of(&pairs.collect::<Vec<_>>())
    }

    /// Number of small fits with a guard, and how many of them diverged.
    pub(crate) fn free_fits(&self, guard: Guard) -> (usize, usize) {
        let with = self.free.iter().filter(|free| free.guard == guard);
        with.fold((0, 0), |(fits, diverged), free| (fits + free.fits(), diverged + free.diverged()))
    }
}
