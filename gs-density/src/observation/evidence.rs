//! Evidence over several training views: how much each Gaussian contributes to them, and the errors
//! of the pixels that it covers.

use gs_core::{Error, check_len};

use super::{Observation, gaussian::DensityScene};

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
    /// Number of training views, drawn again in each round; 0 for all.
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
    /// Whether [`Evidence::splitting`] is needed, of the same views.
    pub splitting: bool,
}

impl Default for EvidenceRequest {
    fn default() -> Self {
        Self {
            views: 10,
            l1: 1.0,
            edges: 0.0,
            high_error: 0.1,
            blended: false,
            covered: false,
            geometry: false,
            splitting: false,
        }
    }
}

impl EvidenceRequest {
    /// Whether arrays of single views are needed.
    pub fn needs_views(&self) -> bool {
        self.blended || self.covered || self.geometry
    }

    /// Memory of the evidence from `count` training views for each Gaussian, bytes.
    pub fn bytes_per_gaussian(&self, count: u64) -> u64 {
        let number = size_of::<f32>() as u64;
        let views = if self.views == 0 { count } else { count.min(self.views.into()) };
        let of_view = 3 * u64::from(self.blended) + 3 * u64::from(self.covered) + 2 * u64::from(self.geometry);
        // Sums of six numbers, and of the views that show the Gaussian.
        let splitting = if self.splitting { 7 * number } else { 0 };
        views * of_view * number + splitting
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

/// Evidence over several training views, at the resolution of the training step. What is not
/// requested is empty.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// One entry for each view.
    pub views: Vec<ViewEvidence>,
    /// The splitting matrix S of each Gaussian, in its own standard deviations and the unit of the
    /// loss: the mean over the views that show it; xx, xy, xz, yy, yz, zz, `[N]`.
    ///
    /// If the Gaussian is replaced by two of half its opacity at μ ± L x, with Σ = L Lᵀ and L the
    /// product of its rotation and its scales, the loss of a view changes by ½ xᵀ S x to second
    /// order in x and first order in the opacity (*source:* Wang et al. 2025, arXiv 2505.05587;
    /// with the projection linearised at the mean).
    pub splitting: Vec<[f32; 6]>,
}

impl Evidence {
    /// The sum of one quantity over the views, each view times `weight(view)`, for the first `len`
    /// Gaussians (`[len]`), in the quantity's unit.
    ///
    /// # Panics
    /// Where a view's array is shorter than `len`, as an array that was not requested is.
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

    /// Removes the first `count` Gaussians from all arrays.
    pub fn remove_first(&mut self, count: usize) {
        self.splitting.drain(..count.min(self.splitting.len()));
        for ViewEvidence { blended, covered, depth, radius_px, .. } in &mut self.views {
            let sums = [blended, covered]
                .into_iter()
                .flat_map(|sums| [&mut sums.pixels, &mut sums.error, &mut sums.high_error]);
            sums.chain([depth, radius_px]).for_each(|array| drop(array.drain(..count.min(array.len()))));
        }
    }

    /// Checks that the requested arrays describe `len` Gaussians.
    fn check_lengths(&self, len: usize, request: &EvidenceRequest) -> Result<(), Error> {
        check_len("evidence", len, if request.splitting { self.splitting.len() } else { len })?;
        for ViewEvidence { blended, covered, depth, radius_px, .. } in &self.views {
            let sums = |wanted: bool, s: &PixelSums| {
                [s.pixels.len(), s.error.len(), s.high_error.len()].map(|found| if wanted { found } else { len })
            };
            let geometry = [depth.len(), radius_px.len()].map(|found| if request.geometry { found } else { len });
            let found = [sums(request.blended, blended), sums(request.covered, covered)].concat();
            found.into_iter().chain(geometry).try_for_each(|found| check_len("evidence", len, found))?;
        }
        Ok(())
    }
}

impl<'a, S: DensityScene> Observation<'a, S> {
    /// The evidence that a policy of this name has requested.
    ///
    /// # Errors
    /// [`Error::State`] where it is missing, [`Error::Length`] where it is of another scene.
    pub(crate) fn requested(&self, policy: &str, request: &EvidenceRequest) -> Result<&'a Evidence, Error> {
        let has_views = |evidence: &&Evidence| !request.needs_views() || !evidence.views.is_empty();
        let Some(evidence) = self.evidence.filter(has_views) else {
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
    fn memory_follows_the_views_and_what_is_gathered_of_each() {
        let few = EvidenceRequest { views: 4, covered: true, geometry: true, ..EvidenceRequest::default() };
        assert_eq!([few.bytes_per_gaussian(300), few.bytes_per_gaussian(2)], [4 * 5 * 4, 2 * 5 * 4]);
        assert_eq!(EvidenceRequest { views: 0, ..few }.bytes_per_gaussian(300), 300 * 5 * 4);
    }

    #[test]
    fn sums_are_weighted_by_view() {
        let view = |loss, pixels: &[f32]| ViewEvidence {
            loss,
            blended: PixelSums { pixels: pixels.to_vec(), ..PixelSums::default() },
            ..ViewEvidence::default()
        };
        let views = vec![view(0.5, &[1.0, 2.0]), view(2.0, &[0.0, 3.0])];
        let evidence = Evidence { views, ..Evidence::default() };
        assert_eq!(evidence.sum(2, |view| view.loss, |view| &view.blended.pixels), [0.5, 7.0]);
    }
}
