//! The definition of a study: what is compared, and the runs that follow from it.
//!
//! A [`Study`] is read from a TOML file, or is one of those [`built_in()`]. [`Arm`]s and `Factor`s
//! say how its fits or trainings differ, `StudyTarget`s what they are of, and a [`Plan`] lists its
//! [`Run`]s, each with all its settings and an address.

mod arm;
mod built_in;
mod claim;
mod clock;
mod column;
mod definition;
pub(crate) mod digest;
mod machine;
pub mod overrides;
mod plan;
mod selection;
mod settings;
mod target;

pub use self::{
    arm::{Arm, PoseError},
    built_in::{BUILT_IN, built_in},
    definition::Study,
    machine::Machine,
    plan::{Plan, Run, VERSION},
    selection::Selection,
    target::{DatasetReading, Places},
};
pub(crate) use self::{
    claim::{Choice, Join, Other, Per, Quantity, StatedClaim},
    clock::Clock,
    column::{Column, Measure},
    definition::Matching,
    settings::{ArmSettings, Planned},
    target::{StudyTarget, TargetContent},
};
