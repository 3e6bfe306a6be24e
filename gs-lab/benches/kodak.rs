//! Quality of fits of images against the number of Gaussians and against time, for every
//! preset, and the cost of a narrower SIMD level.
//!
//! `cargo bench -p gs-lab --bench kodak -- [--level avx2] [--threads N] [--quick] [--csv FILE]`

#![allow(clippy::print_stdout)]

#[path = "measure/images.rs"]
mod images;
mod measure;

use pollster::FutureExt as _;
use std::{error::Error, fmt::Write, path::PathBuf};

use clap::Parser;
use gs_core::{metrics::mean, profile::Quantiles};
use gs_cpu::{CpuRasterizer, SimdLevel};
use gs_train::{Control, FitSummary, Observer, Preset, Progress, fit};
use images::{BenchImage, BenchImages};
use measure::{Options, Outcome, print_columns, print_head, print_row, print_section};

/// The count for which quality against time is measured.
const GAUSSIANS: u32 = 9_000;

/// PSNR of GaussianImage (ECCV 2024) with 9,000 Gaussians: mean of all 24 Kodak images, in 29.9 s
/// on an RTX 4090.
const ANCHOR_DB: f64 = 32.05;

#[derive(Debug, Parser)]
struct KodakOptions {
    #[command(flatten)]
    common: Options,
    /// Also writes a line per fit to FILE
    #[arg(long)]
    csv: Option<PathBuf>,
}

/// A fit with its trajectory.
struct Run {
    preset: Preset,
    gaussians: u32,
    image: String,
    summary: FitSummary,
    trajectory: Trajectory,
}

/// (seconds of fitting, PSNR in dB), in order. Measuring the PSNR is not part of the time.
#[derive(Debug, Default)]
struct Trajectory {
    points: Vec<(f64, f64)>,
}

impl Observer for Trajectory {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        progress.step.is_multiple_of((progress.iterations / 50).max(1)) || progress.is_last()
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        self.points.extend(progress.quality.as_ref().map(|quality| (progress.seconds, quality.psnr)));
        Control::Continue
    }
}

impl Trajectory {
    /// PSNR at a time: interpolated between measurements, constant after the last, `None` before
    /// the first.
    fn at(&self, seconds: f64) -> Option<f64> {
        let after = self.points.partition_point(|&(s, _)| s <= seconds);
        let &(from, low) = self.points.get(after.checked_sub(1)?)?;
        let Some(&(to, high)) = self.points.get(after) else { return Some(low) };
        Some(low + (high - low) * (seconds - from) / (to - from))
    }
}

fn main() -> Outcome {
    let options = KodakOptions::parse();
    let common = &options.common;
    let mut images = BenchImages::load()?;
    let found = images.all.len();
    images.all.truncate(common.pick(usize::MAX, 2));
    let all = &images.all;
    let cut = if all.len() < found { format!(", of which the first {}", all.len()) } else { String::new() };
    let used = format!("{}{cut}", images.origin);
    print_head("Fits of images", common, &[common.threads()], &used);
    let rasterizer = common.rasterizer(common.threads())?;
    fit_one(&rasterizer, &all[0], Preset::Quick, 1_000)?; // Threads and caches are warm from here on.

    let mut runs = Vec::new();
    let counts: &[u32] = common.pick(&[1_000, 3_000, GAUSSIANS, 20_000, 70_000], &[1_000, GAUSSIANS]);
    let presets: &[Preset] = common.pick(&[Preset::Quick, Preset::Standard, Preset::Best], &[Preset::Quick]);
    for &preset in presets {
        print_section(&format!("Preset {preset}"));
        print_columns(&["Gaussians", "PSNR, dB", "MS-SSIM", "fitting, s (mean)", "fitting, s (median)"]);
        for &gaussians in counts.iter().filter(|&&n| preset != Preset::Best || n == GAUSSIANS) {
            let first = runs.len();
            for image in all {
                runs.push(fit_one(&rasterizer, image, preset, gaussians)?);
            }
            let runs: &[Run] = &runs[first..];
            print_row(&[count(u64::from(gaussians)), psnr(runs), ms_ssim(runs), seconds(runs), cell(times(runs))]);
        }
    }
    for &gaussians in counts {
        print_section(&format!("{} Gaussians", count(u64::from(gaussians))));
        print_columns(&["preset", "PSNR, dB", "MS-SSIM", "fitting, s (mean)"]);
        for runs in runs.chunks(all.len()).filter(|runs| runs[0].gaussians == gaussians) {
            print_row(&[runs[0].preset.name().to_owned(), psnr(runs), ms_ssim(runs), seconds(runs)]);
        }
    }
    print_trajectories(&runs, all.len());
    compare_levels(common, all)?;
    if let Some(path) = &options.csv {
        std::fs::write(path, as_csv(&runs, &rasterizer))
            .map_err(|e| format!("{} cannot be written: {e}", path.display()))?;
    }
    Ok(())
}

fn fit_one(
    rasterizer: &CpuRasterizer,
    of: &BenchImage,
    preset: Preset,
    gaussians: u32,
) -> Result<Run, gs_train::Error> {
    let mut trajectory = Trajectory::default();
    let summary =
        fit(rasterizer, &of.image, preset.settings(gaussians, of.image.size()), &mut trajectory).block_on()?.summary;
    Ok(Run { preset, gaussians, image: of.name.clone(), summary, trajectory })
}

fn psnr(runs: &[Run]) -> String {
    format!("{:.2}", mean(runs.iter().map(|run| run.summary.psnr)))
}

/// Mean over the images that are large enough for MS-SSIM.
fn ms_ssim(runs: &[Run]) -> String {
    format!("{:.4}", mean(runs.iter().filter_map(|run| run.summary.ms_ssim)))
}

fn seconds(runs: &[Run]) -> String {
    number(mean(runs.iter().map(|run| run.summary.seconds)))
}

fn times(runs: &[Run]) -> Quantiles {
    Quantiles::of(&runs.iter().map(|run| run.summary.seconds).collect::<Vec<_>>())
}

/// Mean PSNR over all images at a time; `None` before the first measurement of each fit.
fn mean_trajectory(runs: &[Run], seconds: f64) -> Option<f64> {
    let at = runs.iter().map(|run| run.trajectory.at(seconds)).collect::<Option<Vec<f64>>>()?;
    Some(mean(at))
}

/// Prints quality against time at [`GAUSSIANS`], and when GaussianImage's PSNR is reached.
fn print_trajectories(runs: &[Run], images: usize) {
    let presets: Vec<&[Run]> = runs.chunks(images).filter(|runs| runs[0].gaussians == GAUSSIANS).collect();
    print_section(&format!("Quality against time, {} Gaussians", count(u64::from(GAUSSIANS))));
    println!("Mean PSNR over the images, dB, after these seconds of fitting; constant after the end.\n");
    let mut columns = vec!["seconds"];
    columns.extend(presets.iter().map(|runs| runs[0].preset.name()));
    print_columns(&columns);
    let times = [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 5.0];
    let end = runs.iter().map(|run| run.summary.seconds).fold(0.0, f64::max);
    for seconds in times.into_iter().filter(|&seconds| seconds < end) {
        let cell = |runs: &&[Run]| mean_trajectory(runs, seconds).map_or("–".to_owned(), |db| format!("{db:.2}"));
        let mut row = vec![seconds.to_string()];
        row.extend(presets.iter().map(cell));
        print_row(&row);
    }
    println!();
    for runs in presets {
        let last = runs.iter().map(|run| run.summary.seconds).fold(0.0, f64::max);
        let passed = (0..)
            .map(|i| f64::from(i) * 1e-3)
            .take_while(|&t| t <= last)
            .find(|&t| mean_trajectory(runs, t).is_some_and(|db| db >= ANCHOR_DB));
        let when = passed.map_or("not at all".to_owned(), |t| format!("at {t:.3} s"));
        println!("- {} passes {ANCHOR_DB} dB {when}", runs[0].preset);
    }
}

/// Prints how much longer a fit takes at AVX2 than at the best level, from alternating pairs of
/// fits.
fn compare_levels(options: &Options, images: &[BenchImage]) -> Result<(), Box<dyn Error>> {
    let (best, narrow) = (SimdLevel::best(), SimdLevel::Avx2);
    if best <= narrow || !SimdLevel::available().contains(&narrow) {
        return Ok(());
    }
    let preset = options.pick(Preset::Standard, Preset::Quick);
    let rasterizers =
        [options.rasterizer_at(best, options.threads())?, options.rasterizer_at(narrow, options.threads())?];
    let (mut seconds, mut ratios, mut losses) = ([Vec::new(), Vec::new()], Vec::new(), Vec::new());
    for round in 0..options.pick(3, 1) {
        for (i, image) in images.iter().enumerate() {
            // The levels take turns in going first.
            let first = (round + i) % 2;
            let one = fit_one(&rasterizers[first], image, preset, GAUSSIANS)?.summary;
            let other = fit_one(&rasterizers[1 - first], image, preset, GAUSSIANS)?.summary;
            let [wide, narrow] = if first == 0 { [one, other] } else { [other, one] };
            ratios.push(narrow.seconds / wide.seconds);
            losses.push(narrow.psnr - wide.psnr);
            seconds[0].push(wide.seconds);
            seconds[1].push(narrow.seconds);
        }
    }
    print_section(&format!("{narrow} against {best}: preset {preset}, {} Gaussians", count(u64::from(GAUSSIANS))));
    println!("{} pairs of fits; the goal is a ratio of at most 1.6.\n", ratios.len());
    print_columns(&[&format!("{best}, s"), &format!("{narrow}, s"), "ratio of a pair", "difference, dB (mean)"]);
    let cells = [&seconds[0], &seconds[1], &ratios].map(|numbers| cell(Quantiles::of(numbers)));
    let [wide, narrow, ratio] = cells;
    print_row(&[wide, narrow, ratio, format!("{:+.3}", mean(losses))]);
    Ok(())
}

fn as_csv(runs: &[Run], rasterizer: &CpuRasterizer) -> String {
    let mut csv = "image,preset,gaussians,level,threads,seconds,psnr,ms_ssim\n".to_owned();
    let (level, threads) = (rasterizer.simd_level(), rasterizer.threads());
    for Run { preset, image, summary, .. } in runs {
        let FitSummary { gaussians, seconds, psnr, .. } = summary;
        let ms_ssim = summary.ms_ssim.map_or(String::new(), |value| format!("{value:.6}"));
        let line = format!("{image},{preset},{gaussians},{level},{threads},{seconds:.6},{psnr:.4},{ms_ssim}");
        writeln!(csv, "{line}").expect("a string takes all that is written to it");
    }
    csv
}

/// Median and 10 % and 90 % quantiles as a table's cell: "1.23 (1.20–1.31)".
fn cell(Quantiles { low, median, high }: Quantiles) -> String {
    format!("{} ({}–{})", number(median), number(low), number(high))
}

/// A number with three significant digits.
fn number(value: f64) -> String {
    let digits = if value == 0.0 || !value.is_finite() { 0 } else { value.abs().log10().floor() as i32 };
    format!("{value:.*}", (2 - digits).clamp(0, 6) as usize)
}

/// A count with thousands separators: "1,000,000".
fn count(value: u64) -> String {
    let digits = value.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().map(|g| std::str::from_utf8(g).expect("digits are text")).collect();
    groups.join(",")
}
