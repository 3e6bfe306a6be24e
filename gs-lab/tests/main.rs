//! Tests of what only benchmarks use: their programs run no tests themselves.

#[path = "../benches/city/mod.rs"]
mod city;
mod compression;
