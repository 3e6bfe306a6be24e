//! `cargo xtask effects`: what an effect costs that is off, beside kernels in which it was never written.
//!
//! The benchmark `effects` of gs-cpu is built as it is, and once for each effect with `--cfg never_written`, which leaves that effect out of the
//! kernels. These programs take turns, so that what else the machine does meets all of them.

use std::{
    path::PathBuf,
    process::{Command, Stdio},
};

use crate::{test, wrapper};

const EFFECTS: [&str; 4] = ["order", "harmonics", "antialias", "background"];

/// Turns; each is of a median of its own.
const TURNS: usize = 12;

/// Builds the benchmarks and prints the table.
#[expect(clippy::print_stdout, reason = "the table is what is asked for")]
pub(crate) fn run() -> Result<(), String> {
    let mut programs = vec![("as it is, all effects off".to_owned(), build(None)?)];
    for effect in EFFECTS {
        programs.push((format!("{effect} never written"), build(Some(effect))?));
    }
    // What two of the same differ by is the noise.
    programs.push(("as it is, once more".to_owned(), programs[0].1.clone()));
    let rows = programs.len();
    let mut times = vec![Vec::new(); rows];
    for turn in 0..TURNS {
        eprintln!("== turn {} of {TURNS}", turn + 1);
        // Nobody is always the first.
        for row in (0..rows).map(|row| (row + turn) % rows) {
            times[row].push(measure(&programs[row].1)?);
        }
    }
    for (scene, name) in SCENES.iter().enumerate() {
        println!("\n| {name} | ms | times the first, median (quartiles) |\n|---|---|---|");
        for row in 0..rows {
            let of = |row: usize| times[row].iter().map(move |times| times[scene]);
            let ratios = sorted(of(row).zip(of(0)).map(|(time, first)| time / first));
            let [low, middle, high] = [0.25, 0.5, 0.75].map(|part| quantile(&ratios, part));
            let time = quantile(&sorted(of(row)), 0.5);
            println!("| {} | {time:.2} | {middle:.3} ({low:.3} to {high:.3}) |", programs[row].0);
        }
    }
    Ok(())
}

/// What the benchmark measures where it is asked for what is off, in its order.
const SCENES: [&str; 2] = ["250,000 Gaussians in 3D", "70,000 Gaussians in 2D"];

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Between two values in proportion.
fn quantile(sorted: &[f64], part: f64) -> f64 {
    let place = (sorted.len() - 1) as f64 * part;
    let (below, above) = (place.floor() as usize, place.ceil() as usize);
    sorted[below] + (sorted[above] - sorted[below]) * place.fract()
}

/// Builds the benchmark without an effect in its kernels, if one is named; where it is then.
fn build(never_written: Option<&str>) -> Result<PathBuf, String> {
    let folder = test::workspace().join("target").join("never-written").join(never_written.unwrap_or("none"));
    let mut cargo = Command::new(test::cargo_program());
    cargo.current_dir(test::workspace()).args(["bench", "--package", "gs-cpu", "--bench", "effects", "--no-run"]);
    cargo.args(["--message-format", "json-render-diagnostics", "--target-dir"]).arg(&folder).stderr(Stdio::inherit());
    if let Some(effect) = never_written {
        cargo.envs(wrapper::environment(&format!("never_written=\"{effect}\""))?);
    }
    eprintln!("== {cargo:?}");
    let built = cargo.output().map_err(|source| format!("cargo: {source}"))?;
    let told = String::from_utf8_lossy(&built.stdout);
    let program = told.split("\"executable\":\"").skip(1).filter_map(|rest| rest.split('"').next()).last();
    match program {
        Some(program) if built.status.success() => Ok(program.into()),
        _ => Err(format!("the benchmark could not be built: {}", built.status)),
    }
}

/// Milliseconds of each scene.
fn measure(program: &PathBuf) -> Result<Vec<f64>, String> {
    let told =
        Command::new(program).arg("off").output().map_err(|source| format!("{}: {source}", program.display()))?;
    let text = String::from_utf8_lossy(&told.stdout);
    let times: Vec<f64> = text.lines().filter_map(|line| line.parse().ok()).collect();
    match told.status.success() && times.len() == SCENES.len() {
        true => Ok(times),
        false => Err(format!("{}: {}: {text}", program.display(), told.status)),
    }
}
