//! The reader of compressed PLY.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::compressed_ply(bytes));
