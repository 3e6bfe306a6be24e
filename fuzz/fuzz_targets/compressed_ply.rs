//! The reader of compressed PLY; the reader is that of `ply`, the seeds are others.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| gs_fuzz::decode(gs_io::SpatialFormat::CompressedPly, bytes));
