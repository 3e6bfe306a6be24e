//! The commands that answer at once; `fit` has a folder of its own.

pub(crate) mod adapters;
pub(crate) mod convert;
pub(crate) mod doctor;
pub(crate) mod eval;
pub(crate) mod info;
pub(crate) mod popping;
pub(crate) mod render;
