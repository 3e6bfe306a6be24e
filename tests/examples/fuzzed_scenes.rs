//! Puts random scenes, views and settings through gs-cpu: `cargo run --release -p gs-conformance --example fuzzed_scenes -- [COUNT] [SEED]`.
//! Half of them are planar, half in space. The first that fails ends it; its number and what was drawn are told.

#![allow(clippy::print_stdout)]

use std::{env, process::ExitCode, time::Instant};

use gs_conformance::{
    Failure,
    fuzzed::{owes, planar, spatial},
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Enough for the largest scene there is.
const MOST_BYTES: usize = 800;

fn main() -> ExitCode {
    let number = |position: usize, usual: u64| match env::args().nth(position) {
        None => Ok(usual),
        Some(word) => word.parse().map_err(|error| format!("`{word}`: {error}")),
    };
    let run = || -> Result<String, String> {
        let (count, seed) = (number(1, 10_000)?, number(2, 0)?);
        let cpu =
            CpuRasterizer::new(CpuSettings { threads: Some(1), level: None }).map_err(|error| error.to_string())?;
        let (mut rng, started) = (Pcg64::seed_from_u64(seed), Instant::now());
        for index in 0..count {
            let bytes: Vec<u8> = (0..rng.random_range(20..MOST_BYTES)).map(|_| rng.random()).collect();
            try_one(&cpu, index, &bytes).map_err(|failure| format!("scene {index}: {failure}"))?;
        }
        Ok(format!("{count} scenes from seed {seed}, none failed, {:.1} s", started.elapsed().as_secs_f64()))
    };
    match run() {
        Ok(told) => {
            println!("{told}");
            ExitCode::SUCCESS
        }
        Err(told) => {
            eprintln!("{told}");
            ExitCode::FAILURE
        }
    }
}

fn try_one(cpu: &CpuRasterizer, index: u64, bytes: &[u8]) -> Result<(), Failure> {
    if index.is_multiple_of(2) {
        let drawn = planar(bytes);
        owes(cpu, &drawn).map_err(|failure| failure.at(format!("{drawn:?}")))
    } else {
        let drawn = spatial(bytes);
        owes(cpu, &drawn).map_err(|failure| failure.at(format!("{drawn:?}")))
    }
}
