//! 3D scenes come back as they were or as near as their format says, real files read as their makers meant them, and nothing in
//! a file makes a reader panic or believe it.

mod bad_input;
mod mutations;
mod nodes;
mod real_files;
mod round_trips;
mod samples;
