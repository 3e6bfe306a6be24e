//! What an approximation costs: in time and error ([`frontier`]), of each effect of a rendering
//! ([`effects`]), and in colours that jump while the camera moves ([`popping`]).

pub mod effects;
pub mod frontier;
pub mod popping;
