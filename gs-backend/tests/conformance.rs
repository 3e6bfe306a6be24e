//! The conformance suite, over the backend chosen at run time: [`AnyRasterizer`] passes every call
//! on unchanged.

use gs_backend::{AnyRasterizer, FutureExt as _, Request, Wanted, open};
use gs_conformance::conformance::{cases, cases_3d};
use gs_core::{Backend, Error, Parameterization, Rasterizer, Scene2d};

/// Cases that call each method at least once, and are quick.
const CASES: [&str; 8] = [
    "scenes_come_back",
    "restored_splats_continue_bit_for_bit",
    "fused_steps_match_separate_stages",
    "every_call_sees_pending_steps",
    "noise_moves_means_and_nothing_else",
    "incomplete_targets_are_completed",
    "edits_carry_everything_along",
    "mismatches_are_errors",
];

fn opened(wanted: Wanted) -> AnyRasterizer {
    let request = Request::default().with(|s| s.wanted = wanted);
    open(&request).block_on().expect("`cargo xtask test` installs a driver").rasterizer
}

fn check(rasterizer: &AnyRasterizer) {
    let mut run = 0;
    for case in cases::<AnyRasterizer>().iter().filter(|case| CASES.contains(&case.name)) {
        (case.run)(rasterizer).unwrap_or_else(|failure| panic!("{}: {failure}", case.name));
        run += 1;
    }
    for case in cases_3d::<AnyRasterizer>().iter().filter(|case| CASES.contains(&case.name)) {
        (case.run)(rasterizer).unwrap_or_else(|failure| panic!("{} in 3D: {failure}", case.name));
        run += 1;
    }
    assert_eq!(run, 2 * CASES.len() - 1, "scenes_come_back exists for 2D scenes only");
}

#[test]
fn the_cpu_conforms_through_any_rasterizer() {
    let rasterizer = opened(Wanted::Cpu);
    assert_eq!(rasterizer.name(), "cpu");
    assert!(rasterizer.describe().starts_with("cpu ("));
    check(&rasterizer);
}

#[test]
fn wgpu_conforms_through_any_rasterizer() {
    let rasterizer = opened(Wanted::Wgpu);
    assert_eq!(rasterizer.name(), "wgpu");
    check(&rasterizer);
}

#[test]
fn values_of_the_cpu_are_an_error_on_wgpu() {
    let (cpu, wgpu) = (opened(Wanted::Cpu), opened(Wanted::Wgpu));
    let splats = cpu.upload(&Scene2d::default(), Parameterization::ScaleRotation).unwrap();
    assert!(matches!(wgpu.for_2d().download(&splats).block_on(), Err(Error::State(_))));
    assert_eq!(wgpu.for_2d().len(&splats), 0);
}

#[test]
fn the_reason_names_the_backend_and_says_why() {
    let chosen = open(&Request::default()).block_on().unwrap();
    assert!(chosen.reason.starts_with(&chosen.rasterizer.describe()), "{}", chosen.reason);
    let asked = open(&Request::default().with(|s| s.wanted = Wanted::Cpu)).block_on().unwrap();
    assert!(asked.reason.contains(": as requested, the fastest SIMD level"), "{}", asked.reason);
    let request = Request::default().with(|s| {
        s.wanted = Wanted::Cpu;
        s.why = Some("to be compared");
    });
    assert!(open(&request).block_on().unwrap().reason.contains(": to be compared, "));
}
