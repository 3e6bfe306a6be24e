//! What all benchmarks share: options, the head of a report, timing, and table cells.

use std::error::Error;

use clap::Parser;
use gs_core::Choice as _;
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};

/// The result of a benchmark's `main`.
pub(crate) type Outcome = Result<(), Box<dyn Error>>;

/// The options of every benchmark, after `--`.
#[derive(Debug, Clone, Parser)]
#[command(about = None, version = None)]
pub(crate) struct Options {
    /// SIMD level: baseline, avx2 or avx512 [default: the machine's best]
    #[arg(long, value_parser = |name: &str| SimdLevel::from_name(name).ok_or("there is no such level"))]
    pub(crate) level: Option<SimdLevel>,
    /// Largest number of threads [default: as many as the machine offers]
    #[arg(long)]
    threads: Option<usize>,
    /// Runs for a few seconds, to see that the benchmark works
    #[arg(long)]
    quick: bool,
    /// Passed by `cargo bench`. Without it, as in `cargo test --all-targets`, the run is quick
    #[arg(long, hide = true)]
    bench: bool,
}

impl Options {
    /// Whether this is a quick run.
    pub(crate) fn is_quick(&self) -> bool {
        self.quick || !self.bench
    }

    /// `full`, or `quick` in a quick run.
    pub(crate) fn pick<T>(&self, full: T, quick: T) -> T {
        if self.is_quick() { quick } else { full }
    }

    /// The SIMD level in use.
    pub(crate) fn level(&self) -> SimdLevel {
        self.level.unwrap_or_else(SimdLevel::best)
    }

    /// The most threads in use.
    pub(crate) fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
    }

    /// The CPU backend with `threads` threads.
    pub(crate) fn rasterizer(&self, threads: usize) -> Result<CpuRasterizer, gs_core::Error> {
        self.rasterizer_at(self.level(), threads)
    }

    /// The CPU backend at another level.
    pub(crate) fn rasterizer_at(&self, level: SimdLevel, threads: usize) -> Result<CpuRasterizer, gs_core::Error> {
        CpuRasterizer::new(CpuSettings::default().with(|s| {
            s.threads = Some(threads);
            s.level = Some(level);
        }))
    }
}

/// Prints a report's head: what was measured, on which machine, when, with how many threads, and on
/// which `data`.
pub(crate) fn print_head(title: &str, options: &Options, threads: &[usize], data: &str) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let date = humantime::format_rfc3339_seconds(std::time::SystemTime::now());
    let threads = threads.iter().map(usize::to_string).collect::<Vec<_>>().join(" and ");
    println!("# {title}\n");
    println!("- machine: {}, {cores} cores", cpu_model());
    println!("- date: {date}");
    println!("- SIMD level: {}; threads: {threads}", options.level());
    println!("- data: {data}");
    println!("- times are medians, with their 10 % and 90 % quantiles in brackets");
    if options.is_quick() {
        println!("- a quick run: to see that it works, not to keep");
    }
}

/// The CPU's name, if the system provides it.
fn cpu_model() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    model.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

/// Prints a heading of a report's section.
pub(crate) fn print_section(title: &str) {
    println!("\n## {title}\n");
}

/// Prints the header of a table.
pub(crate) fn print_columns(names: &[&str]) {
    print_row(names);
    print_row(&vec!["---"; names.len()]);
}

/// Prints a line of a table.
pub(crate) fn print_row<T: AsRef<str>>(cells: &[T]) {
    let cells: Vec<&str> = cells.iter().map(AsRef::as_ref).collect();
    println!("| {} |", cells.join(" | "));
}
