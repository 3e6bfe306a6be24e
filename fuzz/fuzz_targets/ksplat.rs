//! The reader of .ksplat.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::ksplat(bytes));
