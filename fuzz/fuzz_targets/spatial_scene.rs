//! gs-cpu under scenes in space, cameras, settings and training steps of any kind.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::scenes::spatial_scene(bytes));
