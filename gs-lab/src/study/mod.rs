//! The definition of a study: what is compared, and the runs that follow from it.
//!
//! A [`Study`] is read from a TOML file, or is one of those [`built_in()`]. [`Arm`]s and [`Factor`]s
//! say how its fits or trainings differ, [`StudyTarget`]s what they are of, and a [`Plan`] lists its
//! [`Run`]s, each with all its settings and an address.

mod arm;
mod built_in;
mod claim;
mod clock;
mod column;
mod definition;
pub(crate) mod digest;
mod key_lines;
mod machine;
pub mod overrides;
mod plan;
mod selection;
mod settings;
mod target;

pub use self::{
    arm::{AnyPolicy, Arm, Factor, OwnPolicy},
    built_in::{BUILT_IN, built_in},
    clock::Clock,
    column::Column,
    definition::{Matching, Study},
    digest::{of_scene as scene_digest, of_scene_3d as scene_digest_3d},
    machine::Machine,
    plan::{Plan, Run, VERSION},
    selection::Selection,
    settings::RunSettings,
    target::{Alpha, DatasetReading, Places, StudyTarget, TargetContent},
};
pub(crate) use self::{
    claim::{Choice, Join, Other, Per, Quantity, StatedClaim},
    column::Measure,
    settings::Planned,
};
pub use crate::synthetic::SyntheticTarget;
