//! Cases of covariance factors of 3D scenes: upload and download, gradients, and steps against
//! `f64`.

use glam::{DMat3, DVec3};
use gs_core::{
    AdamRates, EditPlan, Loss, Optimizer, Parameterization, Scene, Scene3d,
    edit::{AfterEdit, Birth, Moments, Origin, Place},
    effects::{Antialias, Blend},
};
use pollster::FutureExt as _;

use super::{
    CaseOutcome, check_gradients,
    optimizer::{distinct, step},
    parameterizations,
};
use crate::{
    failure::Failure,
    oracle::{FactoredReference, Parameters},
    scenes::{Draw, Kind3d},
    subject::Subject,
    tolerance::FRAME_SHARE,
};

/// The outcome of a skipped case, if the backend does not offer covariance factors for 3D scenes.
fn without_factors<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<Option<CaseOutcome>, Failure> {
    let offered = parameterizations::<Scene3d, R>(rasterizer)?.contains(&Parameterization::CovarianceFactor);
    Ok((!offered).then(|| {
        CaseOutcome::Skipped(format!("parameterization {} for 3D scenes", Parameterization::CovarianceFactor.name()))
    }))
}

/// Scenes that were uploaded as factors have the same covariances when downloaded; all else has the
/// same bits.
pub fn covariance_factors_come_back_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    if let Some(skipped) = without_factors(rasterizer)? {
        return Ok(skipped);
    }
    for (seed, kind) in (2700..).zip([Kind3d::Typical, Kind3d::Needles, Kind3d::Opaque]) {
        let scene = Draw::for_3d(kind, Blend::Over, 37, (40, 30), seed).scene;
        let splats = rasterizer.upload(&scene, Parameterization::CovarianceFactor)?;
        let back = rasterizer.download(&splats).block_on()?;
        let restored = rasterizer.download(&rasterizer.restore(&rasterizer.save(&splats).block_on()?)?).block_on()?;
        Failure::unless(back == restored, || format!("{kind:?}: the restored scene differs"))?;
        let same = (&back.means, &back.opacity_logits, &back.sh) == (&scene.means, &scene.opacity_logits, &scene.sh);
        Failure::unless(same, || format!("{kind:?}: means, opacities or colours differ"))?;
        for (i, (a, b)) in scene.rows().gaussians.iter().zip(&back.rows().gaussians).enumerate() {
            let [a, b] = [a, b].map(|row| FactoredReference::new(row).factor);
            let whitened = a.inverse() * b;
            let same = (whitened * whitened.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-4);
            Failure::unless(same, || {
                format!("{kind:?}: Gaussian {i} was uploaded with the factor {a} and downloaded with {b}")
            })?;
        }
    }
    Ok(CaseOutcome::Passed)
}

/// Gradients are by the scene's parameters in the parameterization of covariance factors, too.
pub fn gradients_match_in_covariance_factors_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    if let Some(skipped) = without_factors(rasterizer)? {
        return Ok(skipped);
    }
    for blend in [Blend::Sum, Blend::Over] {
        for antialias in Antialias::ALL {
            for (seed, kind) in (2710..).zip([Kind3d::Typical, Kind3d::Edge, Kind3d::Opaque]) {
                let draw = Draw::for_3d(kind, blend, 20, (30, 30), seed).antialiased(antialias);
                check_gradients(rasterizer, &draw, &Loss::L2, Parameterization::CovarianceFactor)?;
            }
        }
    }
    Ok(CaseOutcome::Passed)
}

/// Six steps in covariance factors, with a Gaussian born after the third, equal Adam in `f64`. The
/// scales stay within their bounds.
pub fn covariance_factor_steps_match_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    if let Some(skipped) = without_factors(rasterizer)? {
        return Ok(skipped);
    }
    for blend in [Blend::Sum, Blend::Over] {
        let draw = Scene3d::overlapping(blend, 12, (24, 20), 2723);
        let newborn = Scene3d::overlapping(blend, 1, (24, 20), 2727).scene;
        let target = rasterizer.upload_target(&draw.target()?)?;
        // With this ε, a step is in proportion to a gradient that is mere rounding.
        let rates = distinct::<Scene3d>(1e-3);
        let mut splats = rasterizer.upload(&draw.scene, Parameterization::CovarianceFactor)?;
        let mut reference: Vec<_> = draw.scene.rows().gaussians.iter().map(FactoredReference::new).collect();
        for steps in 1..=6 {
            if steps == 4 {
                let birth = Birth {
                    gaussian: newborn.gaussian(0),
                    parent: None,
                    moments: Moments::Fresh,
                    origin: Origin::Seed,
                    place: Place::Last,
                };
                let plan = EditPlan { added: vec![birth], statistics: AfterEdit::Keep, ..EditPlan::default() };
                rasterizer.edit(&mut splats, &plan).block_on()?;
                reference.push(FactoredReference::new(&newborn.rows().gaussians[0]));
            }
            let before = rasterizer.download(&splats).block_on()?.rows();
            let gradients = step(rasterizer, &mut splats, &draw, &target, &rates)?;
            let after = rasterizer.download(&splats).block_on()?.rows();
            let count = after.gaussians.len();
            Failure::unless(count == reference.len(), || format!("{count} Gaussians, not {}", reference.len()))?;
            for (g, reference) in reference.iter_mut().enumerate() {
                reference.step(&before.gaussians[g], &gradients[g], &rates);
                compare(reference, &after.gaussians[g], &rates)
                    .map_err(|failure| failure.at(format!("{blend:?}, step {steps}, Gaussian {g}")))?;
            }
        }
    }
    bounds_hold(rasterizer).map(CaseOutcome::from)
}

/// Compares a row with the reference in whitened coordinates, relative to the movement.
fn compare(reference: &FactoredReference, found: &Parameters, rates: &AdamRates) -> Result<(), Failure> {
    let steps = f64::from(reference.steps);
    let whiten = reference.factor.inverse();
    let place = whiten * (DVec3::from_slice(found) - reference.mean);
    let shape = whiten * FactoredReference::new(found).factor;
    let shape = shape * shape.transpose();
    let moved = |rate: f32| steps * (FRAME_SHARE * f64::from(rate) + 1e-5);
    let check = |what: &str, difference: f64, tolerance: f64| {
        let what = what.to_owned();
        match difference <= tolerance {
            true => Ok(()),
            false => Err(Failure::Differs { what, expected: 0.0, found: difference, tolerance, others: 0 }),
        }
    };
    check("whitened distance of the means", place.abs().max_element(), moved(rates.mean.learning_rate))?;
    let largest = (shape - DMat3::IDENTITY).to_cols_array().into_iter().fold(0.0f64, |m, v| m.max(v.abs()));
    check("whitened difference of the covariances", largest, moved(rates.scale.learning_rate))?;
    for (k, (a, b)) in reference.rest.iter().zip(&found[found.len() - reference.rest.len()..]).enumerate() {
        let rate = [rates.opacity, rates.color, rates.color_rest][if k == 0 {
            0
        } else if k < 4 {
            1
        } else {
            2
        }];
        let difference = if a == b { 0.0 } else { (a - b).abs() };
        check(&format!("entry {k} of opacity and colours"), difference, moved(rate.learning_rate))?;
    }
    Ok(())
}

/// Large steps keep the scales within their bounds.
fn bounds_hold<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let draw = Scene3d::overlapping(Blend::Over, 12, (24, 20), 2733);
    let target = rasterizer.upload_target(&draw.target()?)?;
    let mut rates = distinct::<Scene3d>(1e-12);
    (rates.scale.learning_rate, rates.mean.learning_rate) = (0.4, 0.0);
    let scales = |scene: &Scene3d| -> (f32, f32) {
        let all = || scene.log_scales.iter().flat_map(|scales| scales.to_array()).map(f32::exp);
        (all().fold(f32::INFINITY, f32::min), all().fold(0.0, f32::max))
    };
    let (smallest, largest) = scales(&draw.scene);
    (rates.min_scale, rates.max_scale) = (0.8 * smallest, 1.25 * largest);
    let mut splats = rasterizer.upload(&draw.scene, Parameterization::CovarianceFactor)?;
    for _ in 0..4 {
        step(rasterizer, &mut splats, &draw, &target, &rates)?;
    }
    let (low, high) = scales(&rasterizer.download(&splats).block_on()?);
    let within = low >= 0.999 * rates.min_scale && high <= 1.001 * rates.max_scale;
    let at_them = low <= 1.001 * rates.min_scale || high >= 0.999 * rates.max_scale;
    Failure::unless(within && at_them, || {
        format!("scales of {low} to {high} with bounds {} and {}", rates.min_scale, rates.max_scale)
    })
}
