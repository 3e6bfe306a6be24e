//! The reader of SPZ of every version.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::spz(bytes));
