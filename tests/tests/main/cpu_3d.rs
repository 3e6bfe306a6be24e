//! gs-cpu: the conformance suite for 3D scenes at every SIMD level, and drawn scenes
//! compared with the oracle.

use gs_conformance::{
    conformance::{check_gradients, check_image, conformance_3d},
    properties::{judge, losses, repeatable},
    scenes::draws_3d,
};
use gs_core::Parameterization;
use gs_cpu::SimdLevel;
use proptest::prelude::*;

use super::cpu::{conforms_at_every_level, levels, rasterizer};

fn assert_conforms(level: SimdLevel, threads: usize) {
    match conformance_3d(&rasterizer(level, threads)) {
        Ok(skipped) => assert_eq!(skipped, []),
        Err(failure) => panic!("{level}, {threads} threads: {failure}"),
    }
}

conforms_at_every_level!(assert_conforms);

proptest! {
    #![proptest_config(repeatable(300, 2026))]

    #[test]
    fn drawn_images_match(draw in draws_3d(), level in levels()) {
        judge(check_image(&rasterizer(level, 2), &draw))?;
    }

    #[test]
    fn drawn_gradients_match(draw in draws_3d(), level in levels(), loss in losses()) {
        judge(check_gradients(&rasterizer(level, 2), &draw, &loss, Parameterization::ScaleRotation))?;
    }
}
