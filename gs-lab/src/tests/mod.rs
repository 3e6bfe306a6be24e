//! Studies from end to end.

mod aligned_poses;
mod blocks;
mod claims;
mod clock;
mod comparisons;
mod interrupted;
mod scenes;
mod studies;
mod user_files;
mod wgpu_lost_device;
