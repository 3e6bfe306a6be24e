//! Densification of one Gaussian: cloned where it is small, split where it is large.
//!
//! One becomes two either way. The *original* keeps its slot in the scene, and so its place in the
//! order of blending; the *copy* is added right behind it. Engines differ in the details of both;
//! here each such detail is a setting.

use gs_core::{
    Error,
    constants::{MIN_SCALE_PX, SPLIT_PHI},
    edit::{Birth, Change, Moments, Origin, Place},
    logit, sigmoid,
};
use serde::{Deserialize, Serialize};

use super::{correction::OpacityCorrection, size::SizeThreshold};
use crate::observation::{DensityGaussian, DensityScene, Observation, Rng};

gs_core::impl_with!(Densify, LongAxisSplit);

/// Positions of the two halves of a split.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SplitPlacement {
    /// At two points drawn independently from the parent (paper §2.2.2, 3DGS).
    #[default]
    Drawn,
    /// On the parent's long axis, half of the parent's largest scale to either side of its mean.
    LongAxis,
    /// On the parent's long axis, with the sizes and opacity of [`LongAxisSplit`] instead of
    /// [`Densify::shrink`].
    LongAxisSplit(LongAxisSplit),
}

/// A split into two halves side by side along the long axis that together look much like the
/// parent.
///
/// The halves are half as long, a little narrower and fainter. The drawn halves of 3DGS overlap by
/// chance, hide more than the parent did and lose its shape. *Source:* Deng et al. 2024, "Efficient
/// Density Control for 3D Gaussian Splatting", and 2025, "Improving Densification in 3D Gaussian
/// Splatting for High-Fidelity Rendering"; the numbers come from their code.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct LongAxisSplit {
    /// Distance of either half from the parent's mean, in units of its largest scale; not negative.
    /// Default 1.5.
    pub offset: f32,
    /// Factor of the largest scale, above 0 and at most 1. Default 0.5.
    pub length: f32,
    /// Factor of the other scales, above 0 and at most 1. Default 0.85.
    pub width: f32,
    /// Factor of the opacity (in scenes without opacities: of the colour), above 0 and at most 1.
    /// Default 0.6.
    pub opacity: f32,
}

impl Default for LongAxisSplit {
    fn default() -> Self {
        Self { offset: 1.5, length: 0.5, width: 0.85, opacity: 0.6 }
    }
}

impl LongAxisSplit {
    /// The numbers of Improved-GS (Deng et al. 2025).
    pub(crate) const IMPROVED_GS: Self = Self { offset: 1.35, length: 0.55, width: 0.893, opacity: 0.6 };

    fn halves<G: DensityGaussian>(&self, parent: &G, has_opacity: bool) -> [G; 2] {
        [-self.offset, self.offset].map(|offset| {
            let mut half = parent.moved_along(offset);
            half.reshape(self.length, self.width);
            if has_opacity {
                half.set_opacity_logit(logit(sigmoid(parent.opacity_logit()) * self.opacity));
            } else {
                half.map_color(|color| color * self.opacity);
            }
            half
        })
    }

    fn validate(&self) -> Result<(), Error> {
        Error::within("long-axis-split.offset", self.offset, 0.0..=f32::MAX, "0 or more, and finite")?;
        for (what, factor) in [
            ("long-axis-split.length", self.length),
            ("long-axis-split.width", self.width),
            ("long-axis-split.opacity", self.opacity),
        ] {
            Error::within(what, factor, f32::MIN_POSITIVE..=1.0, "above 0 and at most 1")?;
        }
        Ok(())
    }
}

/// Checks the moments that new Gaussians start with.
pub(crate) fn check_newcomers(moments: Moments) -> Result<(), Error> {
    if moments == Moments::Inherit {
        return Err(Error::setting("newcomers", "inherit", "fresh or zeroed"));
    }
    Ok(())
}

/// Settings of cloning and splitting. The defaults follow 3DGS, except [`Self::newcomers`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Densify {
    /// Gaussians larger than this are split, the others cloned. Default 0.01 of the extent (3DGS:
    /// `percent_dense`).
    pub split_above: SizeThreshold,
    /// Factor φ by which splitting divides all scales, at least 1; not used by a [`LongAxisSplit`].
    /// Default [`SPLIT_PHI`].
    pub shrink: f32,
    /// Positions of the halves of a split. Default drawn.
    pub split_placement: SplitPlacement,
    /// Correction of the opacities. Default none.
    pub opacity_correction: OpacityCorrection,
    /// Moments of clones and of both halves of a split, which have moved: fresh, the default, or
    /// zeroed, as in the code of 3DGS. The original of a clone keeps its own.
    pub newcomers: Moments,
}

impl Default for Densify {
    fn default() -> Self {
        Self {
            split_above: SizeThreshold::ExtentFraction(0.01),
            shrink: SPLIT_PHI,
            split_placement: SplitPlacement::Drawn,
            opacity_correction: OpacityCorrection::None,
            newcomers: Moments::Fresh,
        }
    }
}

impl Densify {
    /// Splits all Gaussians of a 3D scene that grow into these halves.
    pub(crate) fn into_halves(halves: LongAxisSplit) -> Self {
        Self {
            split_above: SizeThreshold::WorldUnits(f32::MIN_POSITIVE),
            split_placement: SplitPlacement::LongAxisSplit(halves),
            ..Self::default()
        }
    }

    /// Splits along the long axis only, without cloning (*source:* as for [`LongAxisSplit`]).
    pub(crate) fn along_long_axes() -> Self {
        Self {
            split_above: SizeThreshold::Pixels(MIN_SCALE_PX),
            split_placement: SplitPlacement::LongAxisSplit(LongAxisSplit::default()),
            ..Self::default()
        }
    }

    /// Makes two of Gaussian `index` of the observed scene: the change of the original (`None`
    /// where it stays the same), and the copy.
    ///
    /// # Panics
    /// Where the scene has no such Gaussian.
    pub fn grow<S: DensityScene>(
        &self,
        index: u32,
        observation: &Observation<'_, S>,
        rng: &mut Rng,
    ) -> (Option<Change<S::Gaussian>>, Birth<S::Gaussian>) {
        let parent = observation.scene.gaussian(index as usize);
        let (pair, origin) = if self.split_above.is_exceeded(&parent, observation.extent) {
            (self.split(&parent, observation.scene.has_opacity(), rng), Origin::Split)
        } else {
            // The clone stands where its original does, as in the code of 3DGS. The two separate by
            // their different moments, under `Blend::Over` also by their order.
            ([parent.clone(), parent], Origin::Clone)
        };
        self.replaced(index, observation, pair, origin)
    }

    /// The change and the birth that put these two Gaussians, with corrected opacities, in the
    /// place of Gaussian `index`.
    pub(crate) fn replaced<S: DensityScene>(
        &self,
        index: u32,
        observation: &Observation<'_, S>,
        mut pair: [S::Gaussian; 2],
        origin: Origin,
    ) -> (Option<Change<S::Gaussian>>, Birth<S::Gaussian>) {
        for half in &mut pair {
            self.opacity_correction.apply(half, observation.scene.has_opacity());
        }
        let [original, copy] = pair;
        let moments = if origin == Origin::Split { self.newcomers } else { Moments::Inherit };
        let is_touched = original != observation.scene.gaussian(index as usize) || moments != Moments::Inherit;
        let change = is_touched.then_some(Change { index, gaussian: original, moments });
        let (parent, place) = (Some(index), Place::BehindParent);
        (change, Birth { gaussian: copy, parent, moments: self.newcomers, origin, place })
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        Error::within("densify.shrink", self.shrink, 1.0..=f32::MAX, "at least 1 and finite")?;
        if let SplitPlacement::LongAxisSplit(split) = &self.split_placement {
            split.validate()?;
        }
        check_newcomers(self.newcomers)?;
        self.split_above.validate("densify.split-above")
    }

    fn split<G: DensityGaussian>(&self, parent: &G, has_opacity: bool, rng: &mut Rng) -> [G; 2] {
        let mut halves = match self.split_placement {
            SplitPlacement::Drawn => [parent.drawn(rng), parent.drawn(rng)],
            SplitPlacement::LongAxis => [parent.moved_along(-0.5), parent.moved_along(0.5)],
            SplitPlacement::LongAxisSplit(split) => return split.halves(parent, has_opacity),
        };
        halves.iter_mut().for_each(|half| half.resize(-self.shrink.ln()));
        halves
    }
}
