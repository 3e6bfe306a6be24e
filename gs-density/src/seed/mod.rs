//! Seeding: placing new Gaussians, without parents, where an image needs them.
//!
//! Weights per pixel (a gradient, a residual) become a capped density. Positions are drawn from it
//! in strata along a Hilbert curve, which spreads them far more evenly than independent draws. Steps
//! of Lloyd's algorithm spread them further. [`Seeding`] gives each a size from the local density and
//! a shape from the local structure of the image.

mod density_map;
mod gaussians;
mod hilbert;
mod lloyd;
mod plane;
mod structure;

pub(crate) use gaussians::mean_around;
pub use gaussians::{Seeding, gradient_magnitude, mean_color};
pub use plane::Plane;
pub(crate) use {density_map::DensityMap, hilbert::HilbertOrder, structure::Structure};
