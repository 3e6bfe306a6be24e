//! The reader of .gltf and .glb.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::gltf(bytes));
