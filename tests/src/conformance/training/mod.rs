//! Cases of training: steps of the optimizer, losses, targets, and steps that fuse several stages.

mod losses;
mod optimizer;
mod steps;
mod steps_3d;
mod targets;

pub(crate) use self::{losses::*, optimizer::*, steps::*, steps_3d::*, targets::*};
