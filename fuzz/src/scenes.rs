//! The targets that draw scenes: they check gs-cpu with gs-conformance's requirements.

use std::sync::LazyLock;

use gs_conformance::{Failure, fuzzed};
use gs_cpu::{CpuRasterizer, CpuSettings};

/// A rasterizer with one thread: the images are too small for more.
static RASTERIZER: LazyLock<CpuRasterizer> = LazyLock::new(|| {
    CpuRasterizer::new(CpuSettings::default().with(|s| {s.threads = Some(1); s.level = None;})).expect("a thread can be started")
});

/// A 2D scene from bytes.
pub fn scene_2d(bytes: &[u8]) {
    sound(fuzzed::check_backend(&*RASTERIZER, &fuzzed::scene_2d(bytes)));
}

/// A 3D scene from bytes.
pub fn scene_3d(bytes: &[u8]) {
    sound(fuzzed::check_backend(&*RASTERIZER, &fuzzed::scene_3d(bytes)));
}

fn sound(result: Result<(), Failure>) {
    if let Err(failure) = result {
        panic!("{failure}");
    }
}
