//! Between values of Python and of Rust: arrays, settings, errors, pictures in notebooks.

pub(crate) mod arrays;
pub(crate) mod errors;
pub(crate) mod notebook;
pub(crate) mod settings;
