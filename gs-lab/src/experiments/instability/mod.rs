//! Numerical instability (paper §3.4.2): loss and gradients as a scale goes to zero, without
//! guards, with the paper's clamp and ε, and with this project's guards, which allow scales below a
//! pixel. What the clamp costs is measured by the study `instability`.
//!
//! The product's guards cannot be switched off. Fits without them use `textbook`, a dense solver
//! that follows the paper's formulas literally. A fit that diverges is counted and does not end the
//! experiment.

mod driven;
mod findings;
mod guard;
mod precision;
mod small_fits;
mod textbook;

use gs_backend::AnyRasterizer;
use gs_train::Error;

use self::{
    driven::Drive,
    guard::Guard,
    precision::{Determinant, Precision},
    small_fits::{Free, Trajectory},
};
use crate::{
    report::{
        Cell, Findings, Table,
        figure::{Axis, Figure, Marks, Series},
    },
    result::{Circumstance, Claim, Number, significant},
    synthetic::SyntheticTarget,
};

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
struct InstabilityMeasured {
    /// The determinant of a needle of 10 px.
    precision: Precision,
    /// A scale that is set to ever smaller values, as in [`Guard::ALL`].
    drives: Vec<Drive>,
    /// Small fits in which the optimizer may shrink a scale by itself.
    free: Vec<Free>,
}

/// Sets a scale to ever smaller values with every guard, and makes small fits.
pub(super) fn measure(on: &AnyRasterizer, is_quick: bool, note: &dyn Fn(&str)) -> Result<Findings, Error> {
    let small = SyntheticTarget::THIN_LINES_24_PX.image();
    note("a scale that is driven to zero");
    let angles = if is_quick { 8 } else { 32 };
    let drives = Guard::ALL.map(|guard| Drive::measure(on, guard, &small, angles));
    let drives = drives.into_iter().collect::<Result<_, Error>>()?;
    note("small fits with and without guards");
    let free = Free::measure_all(on, is_quick, &small)?;
    Ok(InstabilityMeasured { precision: Precision::of_needle(), drives, free }.findings())
}

impl InstabilityMeasured {
    /// The results of setting a scale under a guard.
    fn drive(&self, guard: Guard) -> &Drive {
        self.drives.iter().find(|drive| drive.guard == guard).expect("all guards are measured")
    }

    /// Number of small fits with a guard, and how many of them diverged.
    fn free_fits(&self, guard: Guard) -> (usize, usize) {
        let with = self.free.iter().filter(|free| free.guard == guard);
        with.fold((0, 0), |(fits, diverged), free| (fits + free.fits(), diverged + free.diverged()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::ClaimVerdict;
    use gs_cpu::{CpuRasterizer, CpuSettings};

    #[test]
    fn scales_that_vanish_give_nan_without_guards_and_only_there() {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let small = SyntheticTarget::THIN_LINES_24_PX.image();
        let drives = Guard::ALL.map(|guard| Drive::measure(&cpu, guard, &small, 8).unwrap()).to_vec();
        let measured = InstabilityMeasured { precision: Precision::of_needle(), drives, free: Vec::new() };
        let off = measured.drive(Guard::Off);
        assert!(off.not_finite > 0 && off.from_px.is_some_and(|from| (1e-4..1e-2).contains(&from)), "{off:?}");
        assert!(measured.precision.wrong_below_px > off.from_px.unwrap(), "wrong before it is NaN");
        for guard in [Guard::Paper, Guard::Project] {
            assert_eq!(measured.drive(guard).not_finite, 0, "{guard:?}");
        }
        assert!(measured.drive(Guard::Project).left_out_px.is_some_and(|scale| scale < 1e-3));
        let verdicts: Vec<ClaimVerdict> = measured.findings().claims.iter().map(Claim::verdict).collect();
        assert_eq!(verdicts, [ClaimVerdict::Partly; 2], "without fits nothing is known of fits");
    }
}
