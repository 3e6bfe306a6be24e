//! COLMAP's text models.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::colmap_text(bytes));
