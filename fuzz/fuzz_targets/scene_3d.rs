//! gs-cpu under 3D scenes, cameras, settings and training steps of any kind.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::scenes::scene_3d(bytes));
