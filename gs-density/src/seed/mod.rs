//! Seeding: placing new Gaussians, without parents, where an image needs them.
//!
//! Weights per pixel (a gradient, a residual) become a capped [`DensityMap`]. Positions are drawn
//! from it in strata along a Hilbert curve ([`HilbertOrder`]), which spreads them far more evenly
//! than independent draws. [`DensityMap::relax`] spreads them further. [`seed_gaussians`] gives
//! each a size from the local density and a shape from the local [`Structure`].

mod density_map;
mod gaussians;
mod hilbert;
mod lloyd;
mod plane;
mod structure;

pub(crate) use gaussians::mean_around;
pub use gaussians::{SeedShape, mean_color, seed_gaussians};
pub use {density_map::DensityMap, hilbert::HilbertOrder, plane::Plane, structure::Structure};
