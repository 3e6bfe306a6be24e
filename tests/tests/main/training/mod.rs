//! Training with gs-cpu and gs-wgpu, on fixtures that it shares with the tests of gs-train.

/// Shared with other tests, which use all of it.
#[allow(dead_code)]
#[path = "../../../../gs-train/tests/main/fixture_2d.rs"]
mod fixture_2d;
/// Shared with other tests, which use all of it.
#[allow(dead_code)]
#[path = "../../../../gs-train/tests/main/fixture_3d.rs"]
mod fixture_3d;

mod evidence;
mod kodak;
mod late;
mod wgpu_bytes;
mod wgpu_lost_device;
