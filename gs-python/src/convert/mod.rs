//! Between values of Python and of Rust: arrays, settings, errors.

pub(crate) mod arrays;
pub(crate) mod dataset;
pub(crate) mod errors;
pub(crate) mod settings;
