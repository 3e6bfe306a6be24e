//! gs-cpu under 2D scenes, canvases, settings and training steps of any kind.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::scenes::scene_2d(bytes));
