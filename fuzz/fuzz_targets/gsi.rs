//! The decoder of compressed pictures.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::gsi(bytes));
