//! Tests of policies. One binary for all modules, so that the tests link once.

mod criteria;
mod evidence;
mod growth;
mod relocation;
mod scene3d;
