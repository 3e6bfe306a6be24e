//! The reader of streamed SOG, and cuts through its levels.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::targets::streamed_sog(bytes));
