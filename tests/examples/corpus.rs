//! Puts every backend of this repository through the corpus of hard cases and prints what became of each: gs-cpu at every SIMD level of this
//! machine, gs-wgpu with every kind of kernels that its adapter has. `cargo run -p gs-conformance --example corpus [CASES] [BACKENDS]`, where
//! only cases and backends are run whose names contain the words. Exits with 1 if anything is not as expected.

#![allow(clippy::print_stdout)]

use std::{process::ExitCode, time::Instant};

use gs_conformance::{
    Failure,
    corpus::{Record, planar_corpus, poison_planar, poison_spatial, run, spatial_corpus},
};
use gs_core::{PlanarScene, Rasterizer, SpatialScene};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};

/// How many cases were run, and how many were not as expected.
#[derive(Default)]
struct Tally {
    run: usize,
    unexpected: usize,
}

impl Tally {
    fn add(&mut self, record: &Record) {
        self.run += 1;
        self.unexpected += usize::from(!record.is_as_expected());
        println!("  {record}");
    }

    /// All cases whose names contain `word`.
    fn backend<R: Rasterizer<PlanarScene> + Rasterizer<SpatialScene>>(
        &mut self,
        name: &str,
        rasterizer: &R,
        word: &str,
    ) {
        println!("{name}");
        println!(" planar scenes");
        for case in planar_corpus().iter().filter(|case| case.name.contains(word)) {
            self.add(&run(rasterizer, case));
        }
        println!(" spatial scenes");
        for case in spatial_corpus().iter().filter(|case| case.name.contains(word)) {
            self.add(&run(rasterizer, case));
        }
        if "poison".contains(word) {
            poison_planar(rasterizer).iter().chain(&poison_spatial(rasterizer)).for_each(|record| self.add(record));
        }
    }
}

fn main() -> Result<ExitCode, Failure> {
    let [word, backends] = [1, 2].map(|n| std::env::args().nth(n).unwrap_or_default());
    let start = Instant::now();
    let mut tally = Tally::default();
    for level in SimdLevel::available() {
        let name = format!("gs-cpu, {level}");
        if !name.contains(&backends) {
            continue;
        }
        // The cases' images are small: what threads would do there is wait for each other.
        let rasterizer = CpuRasterizer::new(CpuSettings { threads: Some(1), level: Some(level) })?;
        tally.backend(&name, &rasterizer, &word);
    }
    for kernels in [Kernels::Portable, Kernels::Subgroups, Kernels::Vectors] {
        let name = format!("gs-wgpu, {kernels:?}");
        if !name.contains(&backends) {
            continue;
        }
        match WgpuRasterizer::new(WgpuSettings { kernels: Some(kernels), ..WgpuSettings::default() }) {
            Ok(rasterizer) => tally.backend(&name, &rasterizer, &word),
            Err(error) => println!("{name}: {error}"),
        }
    }
    println!("{} cases, {} not as expected, {:.0} s", tally.run, tally.unexpected, start.elapsed().as_secs_f64());
    Ok(if tally.unexpected == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
