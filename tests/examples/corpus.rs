//! Puts every backend of this repository through the corpus of hard cases and prints what became of
//! each: gs-cpu at every SIMD level of this machine, gs-wgpu with every kind of kernels that its
//! adapter has. `cargo run --release -p gs-conformance --example corpus [CASES] [BACKENDS]`, where
//! only cases and backends are run whose names contain the words. Exits with 1 if anything is not
//! as expected.
//!
//! Images are so small that a backend alone keeps no processor busy: so there are as many backends
//! at a time as there are processors, and each table is printed when it is whole.

#![allow(clippy::print_stdout)]

use pollster::FutureExt as _;
use std::{
    fmt,
    process::ExitCode,
    sync::Mutex,
    thread::{available_parallelism, scope},
    time::Instant,
};

use gs_conformance::{
    Failure,
    corpus::{Record, corpus_2d, corpus_3d, poison_2d, poison_3d, run},
};
use gs_core::{Optimizer, Scene2d, Scene3d};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};

/// A backend to be put through the corpus.
#[derive(Clone, Copy)]
enum Backend {
    Cpu(SimdLevel),
    Wgpu(Kernels),
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu(level) => write!(f, "gs-cpu, {level}"),
            Self::Wgpu(kernels) => write!(f, "gs-wgpu, {kernels:?}"),
        }
    }
}

impl Backend {
    /// All backends, the slowest first.
    fn all() -> Vec<Self> {
        let wgpu = [Kernels::Portable, Kernels::Subgroups].map(Self::Wgpu);
        wgpu.into_iter().chain(SimdLevel::available().into_iter().map(Self::Cpu)).collect()
    }

    /// All cases whose names contain `word`; an error where this machine has no such backend.
    fn records(self, word: &str) -> Result<Vec<Record>, gs_core::Error> {
        Ok(match self {
            // Threads would only wait for each other on such images.
            Self::Cpu(level) => records(
                &CpuRasterizer::new(CpuSettings::default().with(|s| {
                    s.threads = Some(1);
                    s.level = Some(level);
                }))?,
                word,
            ),
            Self::Wgpu(kernels) => records(
                &WgpuRasterizer::new(WgpuSettings::default().with(|s| s.kernels = Some(kernels))).block_on()?,
                word,
            ),
        })
    }
}

fn records<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(rasterizer: &R, word: &str) -> Vec<Record> {
    let scene_2d = corpus_2d().into_iter().filter(|case| case.name.contains(word));
    let scene_3d = corpus_3d().into_iter().filter(|case| case.name.contains(word));
    let mut records: Vec<Record> = scene_2d.map(|case| run(rasterizer, &case)).collect();
    records.extend(scene_3d.map(|case| run(rasterizer, &case)));
    if "poison".contains(word) {
        records.extend(poison_2d(rasterizer));
        records.extend(poison_3d(rasterizer));
    }
    records
}

/// How many cases were run, and how many were not as expected.
#[derive(Default)]
struct Tally {
    run: usize,
    unexpected: usize,
}

impl Tally {
    fn add(&mut self, backend: Backend, start: Instant, records: Result<Vec<Record>, gs_core::Error>) {
        let records = match records {
            Ok(records) => records,
            Err(error) => return println!("{backend}: {error}"),
        };
        println!("{backend}, {:.0} s", start.elapsed().as_secs_f64());
        for record in records {
            self.run += 1;
            self.unexpected += usize::from(!record.is_as_expected());
            println!("  {record}");
        }
    }
}

fn main() -> Result<ExitCode, Failure> {
    let [word, backends] = [1, 2].map(|n| std::env::args().nth(n).unwrap_or_default());
    let start = Instant::now();
    let due = Backend::all().into_iter().filter(|backend| backend.to_string().contains(&backends));
    let (due, tally) = (Mutex::new(due), Mutex::new(Tally::default()));
    let next = || due.lock().ok()?.next();
    scope(|scope| {
        for _ in 0..available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(backend) = next() {
                    let start = Instant::now();
                    let records = backend.records(&word);
                    if let Ok(mut tally) = tally.lock() {
                        tally.add(backend, start, records);
                    }
                }
            });
        }
    });
    let Tally { run, unexpected } = tally.into_inner().unwrap_or_default();
    println!("{run} cases, {unexpected} not as expected, {:.0} s", start.elapsed().as_secs_f64());
    Ok(if unexpected == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
