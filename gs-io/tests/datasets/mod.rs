//! Data sets: small ones made here, whole and broken, and the real ones where they are there.

mod colmap;
mod images;
mod lens;
mod made;
mod mutated;
mod real;
mod refusals;
mod transforms;
