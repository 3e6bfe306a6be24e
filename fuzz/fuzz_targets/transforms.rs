//! Data sets with a `transforms.json`.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::transforms(bytes));
