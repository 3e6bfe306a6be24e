//! The guards of the arithmetic, each with a name, so that a build for tests can leave one out and see who notices.
//!
//! A guard keeps a number that is possible, but that a formula has no room for, from becoming NaN, ∞ or garbage. In every ordinary build all of
//! them are on, and [`Guard::is_on`] is the constant `true`. With `--cfg guards="can-be-off"` one can be switched off while the program runs:
//! `cargo xtask guards` does so with each, and what `docs/guards.md` names beside it must fail. With `--cfg guards="off"` all that an ordinary
//! scene does without are left out, to measure what they cost.

/// The guards, and their names.
macro_rules! guards {
    ($($(#[$what:meta])* $guard:ident = $name:literal,)*) => {
        /// A guard; `docs/guards.md` says of each what it costs in accuracy, and which hard case needs it.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[repr(u8)]
        pub enum Guard {
            $($(#[$what])* $guard,)*
        }

        impl Guard {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$guard),*];

            /// Its name in `docs/guards.md`.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$guard => $name,)*
                }
            }
        }
    };
}

guards! {
    /// Parameters that are not finite are left out and counted.
    FiniteParameters = "finite-parameters",
    /// So are Gaussians whose projection is not finite: the mean, Σxx Σyy or det Σ′ overflow.
    FiniteProjection = "finite-projection",
    /// So are those whose colour is not finite, from which 0 · ∞ would reach pixels that they do not touch.
    FiniteColor = "finite-color",
    /// Means nearer than [`Camera::near`](crate::Camera) are left out: projection divides by their depth.
    NearPlane = "near-plane",
    /// [`MIN_QUATERNION_NORM2`](crate::constants::MIN_QUATERNION_NORM2): a rotation is of q/|q|.
    QuaternionNorm = "quaternion-norm",
    /// [`QUATERNION_SHRINK`](crate::constants::QUATERNION_SHRINK): |q|² overflows.
    QuaternionShrink = "quaternion-shrink",
    /// [`MIN_DETERMINANT_PX4`](crate::constants::MIN_DETERMINANT_PX4): the exponent divides by det Σ′.
    Determinant = "determinant",
    /// Opacities below the cut are left out: the ellipse of the cut reaches to √(2 ln(o/cut)).
    Transparent = "transparent",
    /// [`JACOBIAN_MARGIN`](crate::constants::JACOBIAN_MARGIN): how far out the perspective is followed.
    JacobianClamp = "jacobian-clamp",
    /// [`SAFE_SQUARES`](crate::constants::SAFE_SQUARES): a direction is found by a length's square.
    SafeSquares = "safe-squares",
    /// A camera at a mean sees it along +z: there is no direction from a point to itself.
    ZeroDirection = "zero-direction",
    /// A gradient through a factor that dilation alone gives an area is 0: L′⁻¹ does not exist.
    SingularFactor = "singular-factor",
    /// α is no more than [`ALPHA_MAX`](crate::constants::ALPHA_MAX): the backward pass divides by 1 − α.
    AlphaMax = "alpha-max",
    /// A pixel is full below [`TRANSMITTANCE_MIN`](crate::constants::TRANSMITTANCE_MIN).
    Full = "full",
    /// Exponentials that are made from the bits of their result are 0, or the smallest or largest there is, where that has no bits.
    ExponentRange = "exponent-range",
    /// The recurrence of weights starts afresh before it can leave the range of `f32`, and does not run along narrow Gaussians.
    Restart = "restart",
    /// The recurrence's factor is held less 1 where it is near 1, so that its rounding does not add up.
    GrowthLessOne = "growth-less-one",
    /// [`MAX_RESIDUAL`](crate::constants::MAX_RESIDUAL): ∂L/∂C is multiplied by weights of 0.
    MaxResidual = "max-residual",
    /// [`SSIM_MAX`](crate::constants::SSIM_MAX): SSIM is a quotient of fourth powers.
    SsimMax = "ssim-max",
    /// SSIM's variances and covariance are bounded as by their definition, whatever rounding leaves of differences of squares.
    SsimVariances = "ssim-variances",
    /// [`MAX_DERIVATIVE`](crate::constants::MAX_DERIVATIVE): Adam squares derivatives.
    MaxDerivative = "max-derivative",
    /// [`MAX_XI`](crate::constants::MAX_XI): a step in a covariance factor goes no further than the Gaussian reaches.
    MaxXi = "max-xi",
    /// [`MAX_ETA`](crate::constants::MAX_ETA): a step in a covariance factor is exp(η) to second order.
    MaxEta = "max-eta",
    /// First moments below 1e-30 become 0, before they are denormal.
    VanishingMoment = "vanishing-moment",
    /// Adam's ε is positive: where no gradient has ever been, a step is 0/ε.
    Epsilon = "epsilon",
    /// Adam keeps scales within [`Adam::min_scale`](crate::Adam) and [`Adam::max_scale`](crate::Adam).
    ScaleBounds = "scale-bounds",
    /// A turn between two axes of which one has no extent has no gradient: 0 · sinh(∞).
    FlatTurn = "flat-turn",
    /// What is not finite is pruned at the next round of densification, and at the next checkpoint.
    PruneNotFinite = "prune-not-finite",
    /// A run that has become worse than it was at first begins again: no gradient leads back to where nothing is drawn.
    FreshStart = "fresh-start",
    /// Densities, errors and gradients that are not finite make no Gaussian grow.
    FiniteScore = "finite-score",
    /// A loss that is not finite ends a run.
    FiniteLoss = "finite-loss",
}

#[cfg(not(any(guards = "can-be-off", guards = "off")))]
impl Guard {
    /// Whether it guards: in this build all do.
    #[inline(always)]
    pub const fn is_on(self) -> bool {
        true
    }
}

#[cfg(guards = "off")]
impl Guard {
    /// Whether it guards: in this build those alone without which ordinary scenes would not be rendered as they are.
    #[inline(always)]
    pub const fn is_on(self) -> bool {
        matches!(self, Self::Restart | Self::ExponentRange)
    }
}

#[cfg(guards = "can-be-off")]
mod switch {
    use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

    use super::Guard;

    /// No guard has this number.
    const NONE: u8 = u8::MAX;

    static OFF: AtomicU8 = AtomicU8::new(NONE);

    impl Guard {
        /// Whether it guards, in all threads of this process.
        #[inline(always)]
        pub fn is_on(self) -> bool {
            OFF.load(Relaxed) != self as u8
        }

        /// Switches this one off and the others on; with none, all are on.
        pub fn switch_off(guard: Option<Self>) {
            OFF.store(guard.map_or(NONE, |guard| guard as u8), Relaxed);
        }
    }
}
