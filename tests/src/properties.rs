//! What property tests of backends share: how many scenes they draw, and what becomes of a comparison's outcome.

use gs_core::Loss;
use proptest::{
    prelude::*,
    test_runner::{RngSeed, TestCaseError},
};

use crate::Failure;

/// Proptest's own settings with this number of cases.
#[must_use]
pub fn fresh(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, ..ProptestConfig::default() }
}

/// The same cases in each run, without a file of failures: a failing case fails again, and prints
/// what it shrank to.
#[must_use]
pub fn repeatable(cases: u32, seed: u64) -> ProptestConfig {
    ProptestConfig {
        cases,
        max_global_rejects: cases / 2,
        rng_seed: RngSeed::Fixed(seed),
        failure_persistence: None,
        max_shrink_iters: 100,
        ..ProptestConfig::default()
    }
}

/// What a property test makes of a comparison: a scene in which there was nothing to compare counts as rejected, of which [`repeatable`]
/// allows only so many.
///
/// # Errors
/// The failure, or the rejection.
pub fn judge<T>(result: Result<T, Failure>) -> Result<(), TestCaseError> {
    match result {
        Ok(_) => Ok(()),
        Err(Failure::Nothing(text)) => Err(TestCaseError::reject(text)),
        Err(failure) => Err(TestCaseError::fail(failure.to_string())),
    }
}

/// Every loss, [`Loss::L1Dssim`] with weights of 0 to 1.
pub fn losses() -> impl Strategy<Value = Loss> {
    prop_oneof![Just(Loss::L2), Just(Loss::L1), (0.0f32..=1.0).prop_map(|lambda| Loss::L1Dssim { lambda })]
}
