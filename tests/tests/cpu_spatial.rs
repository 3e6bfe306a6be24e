//! gs-cpu: the conformance suite for spatial scenes at every SIMD level of this machine with 1, 2 and 7 threads, and drawn scenes against
//! the oracle.

use gs_conformance::{
    Failure,
    conformance::{check_gradients, check_image, spatial_conformance},
    scenes::spatial_draws,
};
use gs_core::{Chart, Loss};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use proptest::{
    prelude::*,
    test_runner::{RngSeed, TestCaseError},
};

fn rasterizer(level: SimdLevel, threads: usize) -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings { threads: Some(threads), level: Some(level) }).unwrap()
}

#[test]
fn conforms_at_every_level_and_number_of_threads() {
    let mut failures = Vec::new();
    for level in SimdLevel::available() {
        for threads in [1, 2, 7] {
            match spatial_conformance(&rasterizer(level, threads)) {
                Ok(skipped) => assert_eq!(skipped, []),
                Err(failure) => failures.push(format!("{level}, {threads} threads: {failure}")),
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// A scene in which there is nothing to compare counts as rejected, of which there may be only so many.
fn judge<T>(result: Result<T, Failure>) -> Result<(), TestCaseError> {
    match result {
        Ok(_) => Ok(()),
        Err(Failure::Nothing(text)) => Err(TestCaseError::reject(text)),
        Err(failure) => Err(TestCaseError::fail(failure.to_string())),
    }
}

fn repeatable(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        max_global_rejects: cases / 2,
        rng_seed: RngSeed::Fixed(2026),
        failure_persistence: None,
        max_shrink_iters: 200,
        ..ProptestConfig::default()
    }
}

fn levels() -> impl Strategy<Value = SimdLevel> {
    proptest::sample::select(SimdLevel::available())
}

fn losses() -> impl Strategy<Value = Loss> {
    prop_oneof![Just(Loss::L2), Just(Loss::L1), (0.0f32..=1.0).prop_map(|lambda| Loss::L1Dssim { lambda })]
}

proptest! {
    #![proptest_config(repeatable(300))]

    #[test]
    fn drawn_images_match(draw in spatial_draws(), level in levels()) {
        judge(check_image(&rasterizer(level, 2), &draw))?;
    }

    #[test]
    fn drawn_gradients_match(draw in spatial_draws(), level in levels(), loss in losses()) {
        judge(check_gradients(&rasterizer(level, 2), &draw, &loss, Chart::ScaleRotation))?;
    }
}
