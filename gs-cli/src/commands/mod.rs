//! The commands.

pub(crate) mod convert;
pub(crate) mod doctor;
pub(crate) mod encode;
pub(crate) mod eval;
pub(crate) mod fit;
pub(crate) mod info;
pub(crate) mod page;
pub(crate) mod paper;
pub(crate) mod poses;
pub(crate) mod price;
pub(crate) mod render;
pub(crate) mod serve;
pub(crate) mod study;
pub(crate) mod train;
pub(crate) mod view;
