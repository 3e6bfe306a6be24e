//! Puts random scenes, views and settings through gs-cpu: `cargo run --release -p gs-conformance
//! --example fuzzed_scenes -- [COUNT] [SEED]`. Half of them are 2D, half 3D. Prints each that
//! fails, and describes the first in full.

#![allow(clippy::print_stdout)]

use std::{env, process::ExitCode, time::Instant};

use gs_conformance::{
    Failure,
    fuzzed::{Fuzzed, check_backend, scene_2d, scene_3d},
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
        let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| {
            s.threads = Some(1);
            s.level = None;
        }))
        .map_err(|error| error.to_string())?;
        let (mut rng, started) = (Pcg64::seed_from_u64(seed), Instant::now());
        let mut failed = 0u64;
        for index in 0..count {
            let bytes: Vec<u8> = (0..rng.random_range(20..MOST_BYTES)).map(|_| rng.random()).collect();
            if let Err(failure) = try_one(&cpu, index, &bytes) {
                eprintln!("scene {index}: {failure}");
                if failed == 0 {
                    eprintln!("{}", message(index, &bytes));
                }
                failed += 1;
            }
        }
        let message =
            format!("{count} scenes from seed {seed}, {failed} failed, {:.1} s", started.elapsed().as_secs_f64());
        if failed == 0 { Ok(message) } else { Err(message) }
    };
    match run() {
        Ok(message) => {
            println!("{message}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn try_one(cpu: &CpuRasterizer, index: u64, bytes: &[u8]) -> Result<(), Failure> {
    if index.is_multiple_of(2) { check_backend(cpu, &scene_2d(bytes)) } else { check_backend(cpu, &scene_3d(bytes)) }
}

/// Describes the drawn scene without the target, which is long.
fn message(index: u64, bytes: &[u8]) -> String {
    if index.is_multiple_of(2) {
        let Fuzzed { scene, view, settings, loss, parameterization, rates, .. } = scene_2d(bytes);
        format!("{scene:#?}\n{view:?}\n{settings:?}\n{loss:?}, {parameterization:?}\n{rates:?}")
    } else {
        let Fuzzed { scene, view, settings, loss, parameterization, rates, .. } = scene_3d(bytes);
        format!("{scene:#?}\n{view:?}\n{settings:?}\n{loss:?}, {parameterization:?}\n{rates:?}")
    }
}
