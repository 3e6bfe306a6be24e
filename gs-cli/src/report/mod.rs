//! The pictures and tables that a fit leaves behind.

pub(crate) mod curve;
pub(crate) mod ellipses;
