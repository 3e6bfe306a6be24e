//! The Gaussian that probably caused a loss that is not finite.

use std::fmt;

use gs_density::DensityGaussian;

use crate::task::Trainable;

/// The Gaussian that probably caused a divergence: the first whose parameters are not finite, or
/// else the one with the largest.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Suspect {
    /// Index in the scene.
    pub index: usize,
    /// Parameters except the opacity, by name and unit, after the step or, where the backend
    /// reports losses late, a few steps later.
    pub parameters: Vec<(&'static str, Vec<f32>)>,
    /// Opacity logit at that time.
    pub opacity_logit: f32,
    /// Number of Gaussians in the scene with parameters that are not finite.
    pub not_finite: usize,
}

impl Suspect {
    /// The suspect of a scene; `None` for an empty scene.
    pub(crate) fn of<S: Trainable>(scene: &S) -> Option<Self> {
        let worst = |index: usize| {
            let gaussian = scene.gaussian(index);
            let values = S::parameters(&gaussian).into_iter().flat_map(|(_, values)| values);
            let largest = values.fold(0.0f32, |m, v| if v.is_finite() { m.max(v.abs()) } else { f32::INFINITY });
            if gaussian.opacity_logit().is_nan() { f32::INFINITY } else { largest }
        };
        let worst: Vec<f32> = (0..scene.len()).map(worst).collect();
        let not_finite = worst.iter().filter(|&&worst| worst == f32::INFINITY).count();
        // The first of several equals.
        let index = (0..scene.len()).reduce(|a, b| if worst[b] > worst[a] { b } else { a })?;
        let gaussian = scene.gaussian(index);
        let (parameters, opacity_logit) = (S::parameters(&gaussian), gaussian.opacity_logit());
        Some(Self { index, parameters, opacity_logit, not_finite })
    }
}

impl fmt::Display for Suspect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Gaussian {} (", self.index)?;
        for (name, values) in &self.parameters {
            match values.as_slice() {
                [value] => write!(f, "{name} {value}, ")?,
                // The first few of many, such as SH coefficients.
                values => write!(f, "{name} {:?}, ", &values[..values.len().min(6)])?,
            }
        }
        write!(f, "opacity logit {})", self.opacity_logit)?;
        if self.not_finite > 1 {
            write!(f, " or another of the {} that are not finite", self.not_finite)?;
        }
        Ok(())
    }
}
