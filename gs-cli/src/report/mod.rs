//! The pictures and tables that commands leave behind.

pub(crate) mod chart;
pub(crate) mod curve;
pub(crate) mod ellipses;
