//! The laboratory from end to end.

mod claims;
mod clock;
mod comparisons;
#[cfg(feature = "object-store-tests")]
mod in_object_store;
mod interrupted;
mod scenes;
mod studies;
mod user_files;
mod wgpu_lost_device;
