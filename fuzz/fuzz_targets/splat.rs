//! The reader of .splat.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::splat(bytes));
