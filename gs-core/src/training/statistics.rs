//! Statistics that training collects per Gaussian for density policies, and counts of culled
//! Gaussians.

use serde::{Deserialize, Serialize};

/// Per-Gaussian statistics since the last edit, `[N]` each, in the order of the scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DensityStatistics {
    /// Sum over steps of the collected statistic: see [`Statistics`](crate::effects::Statistics)
    /// for its values and units. Zeros where none is collected.
    ///
    /// There is one sum: two statistics must not be mixed without an edit between them.
    pub signal_sum: Vec<f32>,
    /// Sum over steps of the weight of the statistic: the number of steps in which the Gaussian was
    /// drawn, and for [`PixelGradient`](crate::effects::Statistics::PixelGradient) the number of
    /// pixels in all of them. At most [`u32::MAX`].
    pub visible: Vec<u32>,
}

impl DensityStatistics {
    /// Statistics of `len` Gaussians that were never drawn.
    pub fn zeros(len: usize) -> Self {
        Self { signal_sum: vec![0.0; len], visible: vec![0; len] }
    }

    /// Weighted mean of the collected statistic of Gaussian `index` over the steps in which it was
    /// drawn; 0 without such steps.
    pub fn mean_signal(&self, index: usize) -> f32 {
        self.signal_sum[index] / self.visible[index].max(1) as f32
    }
}

/// Why a forward pass leaves a Gaussian out; see the fields of [`Culled`]. Exhaustive: backends
/// must agree on all causes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CullCause {
    /// [`Culled::not_finite`].
    NotFinite,
    /// [`Culled::near`].
    Near,
    /// [`Culled::degenerate`].
    Degenerate,
    /// [`Culled::transparent`].
    Transparent,
    /// [`Culled::outside`].
    Outside,
}

/// Numbers of Gaussians that a forward pass left out, by cause.
///
/// Each is counted under the first cause that applies: dropout, then in the order of
/// [`perspective`](crate::math::perspective) for 3D scenes and of the fields for 2D scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Culled {
    /// Gaussians with a parameter, or a covariance made of them, that is NaN or infinite.
    pub not_finite: u32,
    /// Gaussians whose mean is nearer than the near plane, or behind the camera. 3D scenes.
    pub near: u32,
    /// Gaussians with det Σ′ below [`MIN_DETERMINANT_PX4`](crate::constants::MIN_DETERMINANT_PX4),
    /// or with a quaternion without direction.
    pub degenerate: u32,
    /// Gaussians with an opacity below the α cut, and those that [`Dropout`](crate::Dropout) leaves out.
    pub transparent: u32,
    /// Gaussians that touch no pixel of the view above the cut.
    pub outside: u32,
}

impl Culled {
    /// Counts one more Gaussian.
    pub fn count(&mut self, cause: CullCause) {
        *match cause {
            CullCause::NotFinite => &mut self.not_finite,
            CullCause::Near => &mut self.near,
            CullCause::Degenerate => &mut self.degenerate,
            CullCause::Transparent => &mut self.transparent,
            CullCause::Outside => &mut self.outside,
        } += 1;
    }

    /// Sums of two counts, such as those of two views, saturating.
    pub fn plus(self, other: Self) -> Self {
        Self {
            not_finite: self.not_finite.saturating_add(other.not_finite),
            near: self.near.saturating_add(other.near),
            degenerate: self.degenerate.saturating_add(other.degenerate),
            transparent: self.transparent.saturating_add(other.transparent),
            outside: self.outside.saturating_add(other.outside),
        }
    }

    /// Number of Gaussians left out for any cause.
    pub fn total(self) -> u64 {
        let Self { not_finite, near, degenerate, transparent, outside } = self;
        [not_finite, near, degenerate, transparent, outside].map(u64::from).iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_many_views_do_not_overflow() {
        let many = Culled { near: u32::MAX, outside: 3, ..Culled::default() };
        let both = many.plus(Culled { near: 1, transparent: 2, ..Culled::default() });
        assert_eq!(both, Culled { near: u32::MAX, transparent: 2, outside: 3, ..Culled::default() });
        assert_eq!(both.total(), u64::from(u32::MAX) + 5);
    }
}
