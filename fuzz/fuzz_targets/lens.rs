//! Lenses of any coefficients.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::lens(bytes));
