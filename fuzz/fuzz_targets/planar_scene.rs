//! gs-cpu under planar scenes, canvases, settings and training steps of any kind.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::scenes::planar_scene(bytes));
