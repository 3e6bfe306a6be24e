//! Evidence over several training views: how much each Gaussian contributes to them, and the errors
//! of the pixels that it covers.

use gs_core::Error;

use crate::{gaussian::DensityScene, observation::Observation};

gs_core::impl_with!(EvidenceRequest);

/// The evidence that a policy needs in one round.
///
/// The error of a pixel is e = `l1` · ê + `edges` · ĝ. ê is the mean of |C − Y| over the channels,
/// and ĝ the response of an edge filter to the target (8 times the pixel minus its neighbours, of
/// its grey value, clamped to 0..=1), both scaled to 0..=1 within the view. Pixels that a mask
/// leaves out do not count.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct EvidenceRequest {
    /// Number of training views, drawn anew in each round; 0 for all.
    pub views: u32,
    /// Weight of the difference to the target in a pixel's error. Default 1.
    pub l1: f32,
    /// Weight of the target's edges in a pixel's error. Default 0.
    pub edges: f32,
    /// ê above which a pixel counts as one of high error, 0..=1. Default 0.1 (FastGS).
    pub high_error: f32,
    /// Whether [`ViewEvidence::blended`] is needed.
    pub blended: bool,
    /// Whether [`ViewEvidence::covered`] is needed.
    pub covered: bool,
    /// Whether [`ViewEvidence::depth`] and [`ViewEvidence::radius_px`] are needed.
    pub geometry: bool,
}

impl Default for EvidenceRequest {
    fn default() -> Self {
        Self { views: 10, l1: 1.0, edges: 0.0, high_error: 0.1, blended: false, covered: false, geometry: false }
    }
}

impl EvidenceRequest {
    /// A request that covers both: the larger number of views, and the pixel error of `self`.
    #[must_use]
    pub fn and(self, other: Option<Self>) -> Self {
        let Some(other) = other else { return self };
        Self {
            views: if self.views == 0 || other.views == 0 { 0 } else { self.views.max(other.views) },
            blended: self.blended || other.blended,
            covered: self.covered || other.covered,
            geometry: self.geometry || other.geometry,
            ..self
        }
    }
}

/// Weighted sums over the pixels of one view, one value per Gaussian (`[N]`); empty if they are not
/// requested.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PixelSums {
    /// Σ w, px.
    pub pixels: Vec<f32>,
    /// Σ w e, with the error e of [`EvidenceRequest`].
    pub error: Vec<f32>,
    /// Σ w over the pixels of high error, px.
    pub high_error: Vec<f32>,
}

/// The evidence of one training view about each Gaussian.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ViewEvidence {
    /// The training loss of the view.
    pub loss: f32,
    /// Sums with the blending weight T α (w under [`Blend::Sum`](gs_core::Blend::Sum)), which is
    /// the Gaussian's contribution to the image.
    pub blended: PixelSums,
    /// Sums with weight 1 in the Gaussian's footprint: the pixels where its α is above the cut,
    /// whether or not other Gaussians hide it there.
    pub covered: PixelSums,
    /// Depth of the mean along the viewing axis, world units; 0 for a Gaussian that is not drawn.
    pub depth: Vec<f32>,
    /// Three standard deviations along the longer axis of the projection, px; 0 for a Gaussian that
    /// is not drawn.
    pub radius_px: Vec<f32>,
}

/// Evidence over several training views, at the resolution of the training step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// One entry for each view.
    pub views: Vec<ViewEvidence>,
}

impl Evidence {
    /// The sum of one quantity over the views, each view times `weight(view)`, `[len]`.
    ///
    /// # Panics
    /// Where a view's array is shorter than `len`.
    pub fn sum<'a>(
        &'a self,
        len: usize,
        weight: impl Fn(&ViewEvidence) -> f32,
        of: impl Fn(&'a ViewEvidence) -> &'a [f32],
    ) -> Vec<f64> {
        let mut sums = vec![0.0; len];
        for view in &self.views {
            let (weight, values) = (f64::from(weight(view)), &of(view)[..len]);
            sums.iter_mut().zip(values).for_each(|(sum, &value)| *sum += weight * f64::from(value));
        }
        sums
    }

    /// Checks that the requested arrays describe `len` Gaussians.
    fn check_lengths(&self, len: usize, request: &EvidenceRequest) -> Result<(), Error> {
        for ViewEvidence { blended, covered, depth, radius_px, .. } in &self.views {
            let sums = |wanted: bool, s: &PixelSums| {
                [s.pixels.len(), s.error.len(), s.high_error.len()].map(|found| if wanted { found } else { len })
            };
            let geometry = [depth.len(), radius_px.len()].map(|found| if request.geometry { found } else { len });
            let found = [sums(request.blended, blended), sums(request.covered, covered)].concat();
            if let Some(found) = found.into_iter().chain(geometry).find(|&found| found != len) {
                return Err(Error::Length { what: "evidence", expected: len, found });
            }
        }
        Ok(())
    }
}

impl<'a, S: DensityScene> Observation<'a, S> {
    /// The evidence that a policy of this name has requested.
    ///
    /// # Errors
    /// [`Error::State`] where it is missing, [`Error::Length`] where it is of another scene.
    pub fn requested(&self, policy: &str, request: &EvidenceRequest) -> Result<&'a Evidence, Error> {
        let Some(evidence) = self.evidence.filter(|evidence| !evidence.views.is_empty()) else {
            return Err(Error::State(format!("policy `{policy}` needs evidence over several views")));
        };
        evidence.check_lengths(self.scene.len(), request)?;
        Ok(evidence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_joined() {
        let few = EvidenceRequest { views: 4, edges: 2.0, covered: true, ..EvidenceRequest::default() };
        let many = EvidenceRequest { views: 9, blended: true, ..EvidenceRequest::default() };
        let both = few.and(Some(many));
        assert_eq!((both.views, both.edges, both.blended, both.covered, both.geometry), (9, 2.0, true, true, false));
        assert_eq!(few.and(Some(EvidenceRequest { views: 0, ..many })).views, 0);
        assert_eq!(few.and(None), few);
    }

    #[test]
    fn sums_are_weighted_by_view() {
        let view = |loss, pixels: &[f32]| ViewEvidence {
            loss,
            blended: PixelSums { pixels: pixels.to_vec(), ..PixelSums::default() },
            ..ViewEvidence::default()
        };
        let evidence = Evidence { views: vec![view(0.5, &[1.0, 2.0]), view(2.0, &[0.0, 3.0])] };
        assert_eq!(evidence.sum(2, |view| view.loss, |view| &view.blended.pixels), [0.5, 7.0]);
    }
}
