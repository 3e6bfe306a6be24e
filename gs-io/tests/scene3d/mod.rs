//! 3D scenes round-trip as exactly as their format allows, real files are read as intended, and no
//! file makes a reader panic.

mod bad_input;
mod mutations;
mod nodes;
mod rad;
mod real_files;
mod round_trips;
mod samples;
mod streamed;
mod tiles;
mod world;
