//! What property tests of backends share: how many scenes they draw, and what becomes of a comparison's outcome.

use gs_core::Loss;
use proptest::{
    prelude::*,
    test_runner::{RngSeed, TestCaseError},
};

use crate::Failure;

/// Under Miri, which takes a few thousand times as long as a processor, one case in so many is drawn.
const CASES_PER_CASE_UNDER_MIRI: u32 = 64;

/// How many of so many cases are drawn: all, but under Miri few.
const fn few_under_miri(cases: u32) -> u32 {
    if cfg!(miri) { cases.div_ceil(CASES_PER_CASE_UNDER_MIRI) } else { cases }
}

/// Proptest's own settings with so many cases. Under Miri there are few, and no file of failures, which isolation leaves no folder for.
#[must_use]
pub fn fresh(cases: u32) -> ProptestConfig {
    let ordinary = ProptestConfig { cases: few_under_miri(cases), ..ProptestConfig::default() };
    if cfg!(miri) { ProptestConfig { failure_persistence: None, ..ordinary } } else { ordinary }
}

/// So many cases, those of a seed, and no file of failures: a failing case fails again, and prints what it shrank to. Under Miri, few of them.
#[must_use]
pub fn repeatable(cases: u32, seed: u64) -> ProptestConfig {
    let cases = few_under_miri(cases);
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
