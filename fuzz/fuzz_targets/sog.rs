//! The reader of bundled SOG.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::sog(bytes));
