//! The Rasterizer on the CPU.
