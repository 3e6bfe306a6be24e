//! The commands.

pub(crate) mod convert;
pub(crate) mod doctor;
pub(crate) mod effects;
pub(crate) mod encode;
pub(crate) mod eval;
pub(crate) mod fit;
pub(crate) mod frontier;
pub(crate) mod info;
pub(crate) mod paper;
pub(crate) mod popping;
pub(crate) mod profile;
pub(crate) mod render;
pub(crate) mod study;
pub(crate) mod train;
pub(crate) mod view;
