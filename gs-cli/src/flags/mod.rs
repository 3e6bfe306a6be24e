//! Flags that several commands share, and the values of flags.

pub(crate) mod backend;
pub(crate) mod cameras;
pub(crate) mod cluster;
pub(crate) mod dataset;
pub(crate) mod effects_args;
pub(crate) mod render_args;
pub(crate) mod values;
