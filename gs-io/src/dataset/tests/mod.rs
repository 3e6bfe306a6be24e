//! Data sets: small ones made here, valid and broken, and real ones if they are there.

mod colmap;
mod corpus;
mod depth;
mod dialects;
mod images;
mod lens;
mod llff;
mod made;
mod metashape;
mod models;
mod mutated;
mod names;
mod opensfm;
mod panorama;
mod real;
mod realityscan;
mod refusals;
mod splits;
mod transforms;
mod wide;
mod world;
