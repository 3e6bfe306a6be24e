//! Data sets: small ones made here, whole and broken, and the real ones where they are there.

mod colmap;
mod lens;
mod made;
mod mutated;
mod photographs;
mod real;
mod refusals;
mod transforms;
