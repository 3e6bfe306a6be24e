//! The reader of 3DGS PLY.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::ply(bytes));
