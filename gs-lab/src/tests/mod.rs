//! The laboratory from end to end. One binary for all modules, so that the tests link once.

mod claims;
mod clock;
mod comparisons;
mod compression;
mod interrupted;
mod scenes;
mod studies;
mod user_files;
mod wgpu_lost_device;
