//! What keeps a training within limits: of time ([`Speed`]) and of Gaussians ([`reduce`]).

mod reduction;
mod speed;

pub use self::{
    reduction::{Reduced, reduce},
    speed::Speed,
};
