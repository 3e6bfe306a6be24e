//! Whether the poses of a run are refined.

gs_core::choices! {
    /// Whether the poses of the training views' cameras are refined along with the scene.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum RefinePoses {
        /// The cameras stay as they are given.
        #[default]
        Off = "off": "Train with the cameras as they are",
        /// The cameras move along with the scene.
        On = "on": "Let the cameras move while the scene is trained",
        /// Like [`Self::On`] if a short trial before the run shows that poses are wrong: views that it does not
        /// train on match their images better after they are aligned. Otherwise like [`Self::Off`], with
        /// the same bits.
        Auto = "auto": "As on if a short trial shows that poses are wrong, otherwise as off",
    }
}

impl RefinePoses {
    pub(crate) fn is_off(&self) -> bool {
        *self == Self::Off
    }

    /// Fewest steps of a run in which the cameras of this many training views move.
    pub fn least_steps(views: usize) -> u32 {
        Self::steps(LEAST_EPOCHS, views)
    }

    /// Steps in so many epochs of so many views.
    pub(crate) fn steps(epochs: u32, views: usize) -> u32 {
        u32::try_from(views).unwrap_or(u32::MAX).saturating_mul(epochs)
    }
}

/// Fewest epochs of a run in which cameras move.
const LEAST_EPOCHS: u32 = 15;
