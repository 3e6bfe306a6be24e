//! The Gaussian that probably caused a loss that is not finite.

use std::fmt;

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
