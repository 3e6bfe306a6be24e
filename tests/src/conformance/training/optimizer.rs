//! Cases of stage `adam`, compared with `f64` references on the backend's own gradients.

use glam::{DMat2, DVec2};
use gs_core::{
    Adam, AdamRates, EditPlan, Loss, Optimizer, Parameterization, Scene2d,
    adam::Group,
    edit::{AfterEdit, Birth, Moments, Origin, Place},
    effects::Blend,
};
use pollster::FutureExt as _;

use crate::{
    adam_reference::{AdamReference, rate_of},
    failure::Failure,
    oracle::{OracleScene, Parameters},
    scenes::{Draw, Kind2d},
    subject::Subject,
    tolerance::ADAM_SHARE,
};

/// Rates and betas that differ between all groups, and an ε as large as √v̂, so that any wrong one
/// has an effect.
pub(crate) fn distinct<S: Subject>(epsilon: f32) -> AdamRates {
    let group = |learning_rate, beta1, beta2| {
        Group::constant(learning_rate).with(|s| {
            s.beta1 = beta1;
            s.beta2 = beta2;
        })
    };
    S::adam()
        .with(|s| {
            s.mean = group(0.11, 0.9, 0.99);
            s.scale = group(0.023, 0.8, 0.95);
            s.rotation = group(0.017, 0.85, 0.9);
            s.opacity = group(0.05, 0.7, 0.999);
            s.color = group(0.013, 0.6, 0.97);
            s.color_rest = group(0.007, 0.75, 0.93);
            s.epsilon = epsilon;
        })
        .at(0.0)
}

/// Runs forward, backward and one Adam step; returns the gradients.
pub(crate) fn step<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    splats: &mut R::Splats,
    draw: &Draw<S>,
    target: &R::Target,
    rates: &AdamRates,
) -> Result<Vec<Parameters>, Failure> {
    let pass = rasterizer.forward(splats, &draw.view, &draw.settings).block_on()?;
    let (_, gradients) = rasterizer.backward(splats, pass, target, &Loss::L2).block_on()?;
    let rows = rasterizer.gradients(splats, &gradients).block_on()?.rows_of_gradients();
    rasterizer.step(splats, &gradients, rates).block_on()?;
    Ok(rows)
}

/// Six steps in ln-scales and rotation, with a Gaussian born after the third, equal Adam in `f64`:
/// with the rates and betas of each group, bias correction by each Gaussian's own count, and ε
/// added to √v̂.
pub(crate) fn adam_matches<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        for epsilon in [1e-3, 1e-8] {
            let draw = S::overlapping(blend, 12, (24, 20), 1203);
            let newborn = S::overlapping(blend, 1, (24, 20), 1207).scene;
            let target = rasterizer.upload_target(&draw.target()?)?;
            let rates = distinct::<S>(epsilon);
            let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
            let mut reference = AdamReference::new(draw.scene.rows());
            for steps in 1..=6 {
                if steps == 4 {
                    let birth = |gaussian| Birth {
                        gaussian,
                        parent: None,
                        moments: Moments::Fresh,
                        origin: Origin::Seed,
                        place: Place::Last,
                    };
                    let added = vec![birth(newborn.gaussian(0))];
                    let plan = EditPlan { added, statistics: AfterEdit::Keep, ..EditPlan::default() };
                    rasterizer.edit(&mut splats, &plan).block_on()?;
                    reference.push(newborn.rows().gaussians[0].clone());
                }
                let gradients = step(rasterizer, &mut splats, &draw, &target, &rates)?;
                reference.step(&gradients, &rates);
                let found = rasterizer.download(&splats).block_on()?.rows();
                compare_parameters::<S>(&reference.scene, &found, &rates, steps)
                    .map_err(|failure| failure.at(format!("{blend:?}, epsilon {epsilon}, step {steps}")))?;
            }
        }
    }
    Ok(())
}

pub(crate) fn compare_parameters<S: Subject>(
    expected: &OracleScene,
    found: &OracleScene,
    rates: &AdamRates,
    steps: i32,
) -> Result<(), Failure> {
    let counts = (expected.gaussians.len(), found.gaussians.len());
    Failure::unless(counts.0 == counts.1, || format!("{} Gaussians, not {}", counts.1, counts.0))?;
    for (g, (a, b)) in expected.gaussians.iter().zip(&found.gaussians).enumerate() {
        for i in (0..a.len()).filter(|&i| a[i].is_finite()) {
            let moved = f64::from(rate_of(i, a.len(), rates).learning_rate);
            let tolerance = f64::from(steps) * (ADAM_SHARE * moved + f64::from(f32::EPSILON) * a[i].abs());
            if !((a[i] - b[i]).abs() <= tolerance) {
                let what = format!("Gaussian {g}, {}", S::parameter_name(i));
                return Err(Failure::Differs { what, expected: a[i], found: b[i], tolerance, others: 0 });
            }
        }
    }
    Ok(())
}

/// The first step in covariance factors moves by the rate against the sign of each gradient in
/// whitened coordinates: μ + L ξ and L (I + η + η²/2), η symmetric.
pub(crate) fn covariance_factor_steps_match<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        let draw = Draw::new(Kind2d::Typical, blend, 40, (40, 30), 1300);
        let target = rasterizer.upload_target(&draw.target()?)?;
        let adam = Adam::default().with(|s| {
            s.mean = Group::constant(0.12);
            s.scale = Group::constant(0.07);
            s.epsilon = 1e-15;
        });
        let rates = adam.at(0.0);
        let mut splats = rasterizer.upload(&draw.scene, Parameterization::CovarianceFactor)?;
        let before = rasterizer.download(&splats).block_on()?;
        let gradients = step(rasterizer, &mut splats, &draw, &target, &rates)?;
        let after = rasterizer.download(&splats).block_on()?;
        let mut compared = 0;
        for (i, (old, new)) in before.iter().zip(after.iter()).enumerate() {
            let factor = old.factor().as_dmat2();
            let (g, s) = (&gradients[i], old.log_scale.to_array().map(|v| f64::from(v).exp()));
            let toward = factor.transpose() * DVec2::new(g[0], g[1]);
            // ∂L/∂η₁₂ moves Σ along L (e₁e₂ᵀ + e₂e₁ᵀ) Lᵀ, twice over; θ does by (s₁² − s₂²)/(s₁ s₂)
            // of that.
            let across = 2.0 * s[0] * s[1] / (s[0] * s[0] - s[1] * s[1]) * g[4];
            let slopes = [toward.x, toward.y, g[2], g[3], across];
            let largest = slopes.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            if !slopes.iter().all(|v| v.abs() > 0.02 * largest && v.is_finite()) || old.log_scale.min_element() < -0.1 {
                continue; // Rounding may decide a sign, or the smallest scale stop the step.
            }
            compared += 1;
            let [xi_x, xi_y] = [slopes[0], slopes[1]].map(|v| -0.12 * v.signum());
            let moved = factor.inverse() * (new.mean - old.mean).as_dvec2();
            let eta = [slopes[2], slopes[3], slopes[4]].map(|v| -0.07 * v.signum());
            let eta = DMat2::from_cols(DVec2::new(eta[0], eta[2]), DVec2::new(eta[2], eta[1]));
            let stretch = DMat2::IDENTITY + eta + eta * eta * 0.5;
            let whitened = factor.inverse() * new.factor().as_dmat2();
            let shape = whitened * whitened.transpose();
            let right = moved.abs_diff_eq(DVec2::new(xi_x, xi_y), 1e-3)
                && shape.abs_diff_eq(stretch * stretch.transpose(), 1e-3);
            Failure::unless(right, || {
                format!(
                    "{blend:?}, Gaussian {i}: whitened move {moved} and covariance {shape} instead of ({xi_x}, {xi_y}) and {}",
                    stretch * stretch.transpose()
                )
            })?;
        }
        if compared < 8 {
            return Err(Failure::Nothing(format!("only {compared} of 40 Gaussians had gradients clear enough")));
        }
    }
    Ok(())
}
