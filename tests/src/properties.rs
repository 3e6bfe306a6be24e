//! Settings and outcomes of property tests.

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

/// Configures this number of cases with a fixed seed, and no file of failures: a failing case fails
/// again, and prints its minimal form.
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

/// Converts a comparison's outcome. A scene with nothing to compare is rejected, and [`repeatable`]
/// limits the number of rejections.
///
/// # Errors
/// The failure or the rejection.
pub fn judge<T>(result: Result<T, Failure>) -> Result<(), TestCaseError> {
    match result {
        Ok(_) => Ok(()),
        Err(Failure::Nothing(text)) => Err(TestCaseError::reject(text)),
        Err(failure) => Err(TestCaseError::fail(failure.to_string())),
    }
}

/// All losses, [`Loss::L1Dssim`] with weights of 0 to 1.
pub fn losses() -> impl Strategy<Value = Loss> {
    prop_oneof![Just(Loss::L2), Just(Loss::L1), (0.0f32..=1.0).prop_map(|lambda| Loss::L1Dssim { lambda })]
}
