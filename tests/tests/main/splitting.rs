//! Splitting matrices from the gradients of a backend, compared with a dense sum over the pixels of
//! second differences of each Gaussian's weight.

use glam::{DMat3, DVec3};
use gs_conformance::{
    oracle::Oracle,
    scenes::{Draw, Kind3d},
    subject::Subject as _,
};
use gs_core::{
    Camera, Gaussian3d, Loss, Parameterization, Rasterizer as _, Scene as _, Scene3d,
    effects::{Antialias, Blend},
    math::perspective::{Ellipsoid, Perspective},
};
use gs_cpu::SimdLevel;
use pollster::FutureExt as _;

use crate::cpu::rasterizer;

fn ellipsoid(scene: &Scene3d, index: usize) -> Ellipsoid {
    Ellipsoid {
        mean: scene.means[index],
        log_scale: scene.log_scales[index],
        rotation: scene.rotations[index],
        opacity_logit: scene.opacity_logits[index],
    }
}

/// The matrices of gs-core from the gradients of gs-cpu; `None` for Gaussians that are not drawn.
fn found(draw: &Draw<Scene3d>) -> Vec<Option<[f32; 6]>> {
    let rasterizer = rasterizer(SimdLevel::best(), 1);
    let on = rasterizer.for_3d();
    let target = on.upload_target(&draw.target().unwrap()).unwrap();
    let splats = on.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
    let pass = on.forward(&splats, &draw.view, &draw.settings).block_on().unwrap();
    let (_, gradients) = on.backward(&splats, pass, &target, &Loss::L2).block_on().unwrap();
    let gradients = on.gradients(&splats, &gradients).block_on().unwrap();
    let perspective = Perspective::new(&draw.view, &draw.settings);
    (0..draw.scene.len())
        .map(|index| {
            let g = ellipsoid(&draw.scene, index);
            let is_drawn = perspective.project(&g).is_ok() && gradients.opacity_logits[index] != 0.0;
            is_drawn.then(|| perspective.splitting_matrix(&g, &ellipsoid(&gradients, index)).unwrap())
        })
        .collect()
}

/// The linearised projection of a Gaussian's standard deviations, rows u and v, px.
fn projected(camera: &Camera, gaussian: &Gaussian3d) -> [DVec3; 2] {
    let p = camera.to_camera(gaussian.mean).as_dvec3();
    let seen = camera.rotation.as_dmat3() * gaussian.factor().unwrap().as_dmat3();
    let focal = camera.focal.as_dvec2();
    let row = |by: DVec3| seen.transpose() * by;
    [
        row(DVec3::new(focal.x / p.z, 0.0, -focal.x * p.x / (p.z * p.z))),
        row(DVec3::new(0.0, focal.y / p.z, -focal.y * p.y / (p.z * p.z))),
    ]
}

/// The matrices of the oracle, of Gaussians that the image shows well within its margin.
fn expected(draw: &Draw<Scene3d>) -> Vec<[f64; 6]> {
    let oracle = Oracle::new(draw.view, draw.settings).unwrap();
    let in_image = oracle.splitting(&draw.scene.rows(), &draw.target().unwrap(), &Loss::L2).unwrap();
    (0..draw.scene.len())
        .map(|index| {
            let [u, v] = projected(&draw.view, &draw.scene.gaussian(index));
            let [xx, xy, yy] = in_image[index];
            let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
            let s = outer(u, u) * xx + (outer(u, v) + outer(v, u)) * xy + outer(v, v) * yy;
            [s.x_axis.x, s.y_axis.x, s.z_axis.x, s.y_axis.y, s.z_axis.y, s.z_axis.z]
        })
        .collect()
}

/// The largest difference of two matrices, in units of the largest entry of the expected one.
fn difference(found: [f32; 6], expected: [f64; 6]) -> f64 {
    let size = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    found.iter().zip(expected).map(|(&a, b)| (f64::from(a) - b).abs()).fold(0.0, f64::max) / size
}

fn check(draw: &Draw<Scene3d>, uneven: &Draw<Scene3d>, tolerance: f64) {
    let mut compared = 0;
    for (index, (found, expected)) in found(uneven).into_iter().zip(expected(draw)).enumerate() {
        let Some(found) = found else { continue };
        let difference = difference(found, expected);
        assert!(difference < tolerance, "Gaussian {index}: {found:?} instead of {expected:?}");
        compared += 1;
    }
    assert!(compared >= 6, "only {compared} Gaussians are drawn");
}

#[test]
fn splitting_matrices_are_those_of_a_dense_sum() {
    for (seed, antialias) in [(5, Antialias::None), (6, Antialias::Dilate), (7, Antialias::Mip)] {
        let mut draw = Draw::for_3d(Kind3d::Overlapping, Blend::Over, 8, (34, 26), seed).antialiased(antialias);
        draw.settings.accuracy.alpha_cut = 1e-5;
        for index in 0..draw.scene.len() {
            draw.scene.log_scales[index] = ellipsoid(&draw.scene, index).without_equal_scales().log_scale;
        }
        check(&draw, &draw, 2e-3);
    }
}

/// The gradient by the rotation of a ball is 0, so its matrix is that of a Gaussian with slightly
/// different scales.
#[test]
fn balls_have_nearly_the_matrix_of_uneven_gaussians() {
    let mut draw = Draw::for_3d(Kind3d::Overlapping, Blend::Over, 8, (34, 26), 8).antialiased(Antialias::Dilate);
    draw.settings.accuracy.alpha_cut = 1e-5;
    let mut uneven = draw.clone();
    for index in 0..draw.scene.len() {
        let mean = draw.scene.log_scales[index].element_sum() / 3.0;
        draw.scene.log_scales[index] = glam::Vec3::splat(mean);
        uneven.scene.log_scales[index] = ellipsoid(&draw.scene, index).without_equal_scales().log_scale;
    }
    check(&draw, &uneven, 0.1);
}
