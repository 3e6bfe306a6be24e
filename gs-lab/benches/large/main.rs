//! Training on a large capture, which the benchmark makes itself: what the first step waits for,
//! the steps, everything else, memory, and quality.
//!
//! `cargo bench -p gs-lab --bench large -- [--views 400] [--gaussians 1e6] [--width 4000]
//! [--max-size 1600] [--steps 20] [--folder FOLDER]`

#![allow(clippy::print_stdout)]

mod city;
#[path = "../measure/mod.rs"]
mod measure;

use std::{
    fs,
    num::NonZeroU32,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use clap::Parser;
use gs_cpu::CpuRasterizer;
use gs_io::dataset::{DatasetSettings, read_dataset};
use gs_train::{
    MetricsLog, TrainPreset, Trainer3d,
    train::{StartName, Views},
};
use measure::{Options, Outcome, print_columns, print_head, print_row, print_section};
use pollster::FutureExt as _;

use self::city::{Capture, City};

/// Every n-th photograph is held out.
const HELD_OUT: u32 = 8;

#[derive(Debug, Parser)]
struct LargeOptions {
    #[command(flatten)]
    common: Options,
    /// Photographs of the capture [default: 400]
    #[arg(long)]
    views: Option<u32>,
    /// Gaussians of the city that is photographed [default: 1e6]
    #[arg(long)]
    gaussians: Option<f64>,
    /// Columns of a photograph, px [default: 4000]
    #[arg(long)]
    width: Option<u32>,
    /// Longer side of the images trained on, px
    #[arg(long, default_value_t = 1600)]
    max_size: u32,
    /// Steps of the training [default: 20]
    #[arg(long)]
    steps: Option<u32>,
    /// Folder of the capture, which is kept and used again [default: one that is removed]
    #[arg(long)]
    folder: Option<PathBuf>,
}

impl LargeOptions {
    fn capture(&self) -> Capture {
        let gaussians = self.gaussians.unwrap_or(self.common.pick(1e6, 3e3)) as usize;
        Capture {
            city: City { gaussians, blocks: self.common.pick(6, 1), seed: 0 },
            views: self.views.unwrap_or(self.common.pick(400, 8)),
            width: self.width.unwrap_or(self.common.pick(4_000, 120)),
            points: gaussians / 10,
        }
    }
}

/// Wall and CPU time of a part, and the most memory up to its end.
struct Part {
    name: &'static str,
    wall: Duration,
    cpu: Duration,
    peak_bytes: Option<u64>,
}

/// Does a part and notes what it took.
fn part<T>(parts: &mut Vec<Part>, name: &'static str, work: impl FnOnce() -> T) -> T {
    let (wall, cpu) = (Instant::now(), cpu_time::ProcessTime::now());
    let result = work();
    parts.push(Part { name, wall: wall.elapsed(), cpu: cpu.elapsed(), peak_bytes: peak_bytes() });
    result
}

/// The most memory that this process has held, if the system says so.
fn peak_bytes() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? * 1024)
}

/// Makes the capture, unless `folder` holds it.
fn make(capture: &Capture, folder: &Path, on: &CpuRasterizer) -> Outcome {
    let (note, description) = (folder.join("capture.txt"), format!("{capture:?}\n"));
    if fs::read_to_string(&note).is_ok_and(|text| text == description) {
        return Ok(());
    }
    capture.write(on, folder, |done| {
        if done % 50 == 0 {
            eprintln!("{done} of {} photographs", capture.views);
        }
    })?;
    fs::write(note, description)?;
    Ok(())
}

fn main() -> Outcome {
    let options = LargeOptions::parse();
    let capture = options.capture();
    let on = options.common.rasterizer(options.common.threads())?;
    let temporary = tempfile::tempdir()?;
    let folder = options.folder.as_deref().unwrap_or(temporary.path());
    make(&capture, folder, &on)?;

    let steps = options.steps.unwrap_or(options.common.pick(20, 3));
    // On Linux, this forgets the most memory so far.
    let _ = fs::write("/proc/self/clear_refs", "5");
    let mut parts = Vec::new();
    let dataset = part(&mut parts, "reading poses and sizes", || {
        read_dataset(
            folder,
            &DatasetSettings::default().with(|s| {
                s.test_every = NonZeroU32::new(HELD_OUT);
                s.max_side = NonZeroU32::new(options.max_size);
            }),
        )
    })?;
    let views = Views::of_dataset(&dataset);
    let settings = TrainPreset::Quick.settings_for(Some(steps), dataset.kind, views.train_cameras());
    let gaussians = settings.gaussians.max(dataset.points.len() as u32);
    let settings = settings.with_gaussians(gaussians);
    let start = StartName::usual(&dataset).of(&dataset)?;
    let mut trainer = part(&mut parts, "until the first step", || {
        Trainer3d::from_views(on.for_3d(), views, start, settings).block_on()
    })?;
    let beginning = trainer.seconds();
    let mut log = MetricsLog::for_steps(steps);
    part(&mut parts, "steps, with the log's evaluations", || trainer.run(&mut log).block_on())?;
    let of_steps = trainer.seconds() - beginning;
    let evaluation = part(&mut parts, "evaluation", || trainer.evaluate(&|_, _, _| Ok(())).block_on())?;

    let Capture { city, views, width, .. } = capture;
    let data = format!(
        "{views} photographs of {width} × {} px of a city of {} Gaussians, {} points",
        width * 3 / 4,
        city.gaussians,
        dataset.points.len()
    );
    print_head("Training on a large capture", &options.common, &[options.common.threads()], &data);
    print_section(&format!(
        "`quick`, {steps} steps on images of at most {} px, {} held out",
        options.max_size,
        evaluation.views.len()
    ));
    print_columns(&["part", "wall time, s", "CPU time, s", "most memory so far, MB"]);
    for Part { name, wall, cpu, peak_bytes } in &parts {
        let memory = peak_bytes.map_or_else(String::new, |bytes| (bytes / 1_000_000).to_string());
        print_row(&[
            (*name).to_owned(),
            format!("{:.2}", wall.as_secs_f64()),
            format!("{:.2}", cpu.as_secs_f64()),
            memory,
        ]);
    }
    let all: f64 = parts.iter().map(|part| part.wall.as_secs_f64()).sum();
    println!("\nThe steps alone: {of_steps:.2} s; everything: {:.2} times that.", all / of_steps);
    println!(
        "{} Gaussians; held-out views: PSNR {:.2} dB, SSIM {:.4}.",
        trainer.count(),
        evaluation.psnr,
        evaluation.ssim
    );
    Ok(())
}
