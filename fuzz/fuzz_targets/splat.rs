//! The reader of .splat.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::decode(gs_io::SpatialFormat::Splat, bytes));
