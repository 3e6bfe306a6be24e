//! What keeps scales from going to zero.

use super::textbook::Guards;

/// Length of the needle whose other scale goes to zero, px.
pub(super) const NEEDLE_PX: f32 = 10.0;

gs_core::choices! {
    /// What keeps scales from going to zero, with its name in reports.
    pub(super) enum Guard {
        /// No guard.
        Off = "none",
        /// ε = 1e-6 px⁴ added to the determinant.
        Epsilon = "ε = 1e-6 on the determinant",
        /// The paper's guards (§3.4.2): no scale below 1 px, and ε, which the paper does not state.
        Paper = "the paper's: σ ≥ 1 px and ε",
        /// This project's guards, as in the product.
        Project = "this project's: σ ≥ 0.25 px",
    }
}

impl Guard {
    /// The guards of the textbook solver; `None` for the product, which has its own.
    pub(super) fn of_textbook(self) -> Option<Guards> {
        let (min_scale_px, epsilon_px4) = match self {
            Self::Off => (None, 0.0),
            Self::Epsilon => (None, 1e-6),
            Self::Paper => (Some(1.0), 1e-6),
            Self::Project => return None,
        };
        Some(Guards { min_scale_px, epsilon_px4 })
    }
}
