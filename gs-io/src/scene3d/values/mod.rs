//! The values of Gaussians as files have them: scales and opacities in other forms, degrees of
//! spherical harmonics, unit quaternions, other axes.

mod flips;
mod number;
mod quantity;
mod sh_degree;
mod sh_rotation;
mod transform;
mod unit;

pub(crate) use self::{
    flips::Flips,
    number::{Number, of_half},
    quantity::{
        byte_of_logit, finite_logit, log_of_scale, logit_of_opacity, logit_of_step, opacity_of_logit, scale_of_log,
    },
    sh_degree::{MAX_DEGREE, MAX_FILE_DEGREE, degree_of_rest, rest_of_degree},
    transform::apply as transform,
    unit::{UnitRotations, largest_of, with_largest},
};
