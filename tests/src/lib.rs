//! The 64-bit oracle and the conformance suite that any Rasterizer can be put through.
