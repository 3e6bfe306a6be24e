//! Density control from Python: a policy, what it is told, and the edits that it plans.

pub(crate) mod observation;
pub(crate) mod plan;
pub(crate) mod policy;
