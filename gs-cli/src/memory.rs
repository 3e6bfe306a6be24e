//! Checks that there is enough memory for a command before it begins. A process that runs out of
//! memory halfway may be killed, and its work is lost.
//!
//! Linux reports how much memory a process may have. On other systems nothing is refused.

use std::{
    fmt::Display,
    fs,
    path::{Path, PathBuf},
};

use gs_core::memory::amount;
use gs_io::format_3d;

use crate::{failure::Failure, terminal::output};

/// A larger need is printed.
const LARGE: u64 = 1_000_000_000;

/// Address space that later threads reserve for their stacks and heaps. It counts even if it is not
/// used.
const THREADS_TO_COME: u64 = 2 * 66_000_000;

/// A pixel of an image: three `f32`.
const IMAGE: u64 = 12;

/// A pixel of one channel.
const PLANE: u64 = 4;

/// Memory for code, threads and tables.
const BASE: u64 = 60_000_000;

/// What drawing a scene takes for each Gaussian, beside a copy of its values: 1.7 million of degree 3 took 1,405 MB
/// (`benchmarks/2026-11-30-xeon-2-cores/blocks.md`).
const DRAWN: u64 = 320;

/// A part of an image that is drawn in parts.
const PART: u64 = 32 << 20;

/// The peak memory of a piece of work.
pub(crate) struct Need<'a> {
    /// The work: "fitting photo.jpg (8000x6000 px)".
    pub(crate) what: String,
    pub(crate) bytes: u64,
    /// Memory of the work that is in use already.
    pub(crate) held: u64,
    /// How to reduce the need: "take a smaller image".
    pub(crate) less: &'a str,
}

impl Need<'_> {
    /// Fails where this process may not have so much.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        let Self { what, bytes, held, less } = self;
        let Some(limit) = limits().into_iter().min_by_key(|limit| limit.left) else { return Ok(()) };
        if bytes.saturating_sub(*held) <= limit.left {
            return Ok(());
        }
        let Limit { whose, all, left } = limit;
        let (needed, left, all) = (amount(*bytes), amount(left), amount(all));
        let message = format_args!("takes about {needed} of memory, but only {left} of {whose} ({all}) are left");
        Err(Failure::failed(message).at(what).hint(format_args!("{less}, or allow more")))
    }

    /// Fails where this process may not have so much, and prints a large need.
    pub(crate) fn check_and_print(&self) -> Result<(), Failure> {
        self.check()?;
        if self.bytes > LARGE {
            output::note(format_args!("{} takes about {} of memory", self.what, amount(self.bytes)));
        }
        Ok(())
    }
}

/// Fails where an image is too large to be read.
pub(crate) fn check_image(path: &Path) -> Result<(), Failure> {
    let (width, height) = gs_io::read_image_size(path)?;
    let what = format!("reading {} ({width}x{height} px)", path.display());
    let bytes = gs_train::memory::reading((width, height));
    Need { what, bytes, held: 0, less: "take a smaller image" }.check()
}

/// Memory for drawing an image of this size, the image included, bytes.
fn drawing(size: (u32, u32)) -> u64 {
    let image = pixels(size) * IMAGE;
    BASE + image + image.min(PART)
}

/// Memory for comparing renderings of this size of a scene with `references` others of it, bytes.
pub(crate) fn comparing(size: (u32, u32), references: u64) -> u64 {
    // The forward pass, its transmittance, and the rendering.
    BASE + pixels(size) * ((2 + references) * IMAGE + PLANE)
}

/// Memory for profiling the steps of a training on an image of this size, bytes.
pub(crate) fn profiling(size: (u32, u32)) -> u64 {
    // The image and the target, what D-SSIM adds to it, and two passes.
    BASE + pixels(size) * (5 * IMAGE + 2 * (2 * IMAGE + PLANE))
}

/// Number of pixels in strips of 16 columns.
fn pixels((width, height): (u32, u32)) -> u64 {
    u64::from(width.next_multiple_of(16)) * u64::from(height)
}

/// Fails where a picture is too large to be rendered; prints a large need.
pub(crate) fn check_picture(what: impl Display, size: (u32, u32)) -> Result<(), Failure> {
    check_work("a picture of", what, size, drawing(size))
}

/// Fails where work on pictures of a scene takes too many `bytes`; prints a large need. `work` is
/// followed by the scene: "profiling".
pub(crate) fn check_work(
    work: &str,
    scene: impl Display,
    (width, height): (u32, u32),
    bytes: u64,
) -> Result<(), Failure> {
    let what = format!("{work} {scene} of {width}x{height} px");
    Need { what, bytes, held: 0, less: "make it smaller with --size" }.check_and_print()
}

/// Memory for comparing a scene with views, bytes: scenes of these numbers of Gaussians and SH degrees, and what drawing
/// the largest of them takes.
pub(crate) fn evaluating(scenes: impl IntoIterator<Item = (usize, u8)>) -> u64 {
    let scenes = scenes.into_iter().map(|(gaussians, degree)| {
        let gaussians = gaussians as u64;
        (gaussians * (44 + 12 * (u64::from(degree) + 1).pow(2)), gaussians * DRAWN)
    });
    let (all, drawing) =
        scenes.fold((0, 0), |(all, drawing), (values, drawn)| (all + values, drawing.max(values + drawn)));
    BASE + all + drawing
}

/// Fails where a 3D scene is too large to be read and processed. Any other file is left to its
/// reader.
pub(crate) fn check_3d(path: &Path) -> Result<(), Failure> {
    let Some(format) = format_3d(path)? else { return Ok(()) };
    let file = fs::metadata(path).map_or(0, |file| file.len());
    let bytes = format.memory_per_byte() * file;
    let less = "prune the scene, or reduce its SH degree";
    Need { what: format!("reading {}", path.display()), bytes, held: 0, less }.check_and_print()
}

/// Memory that this process may still have, bytes, if the system reports it.
pub(crate) fn room() -> Option<u64> {
    limits().into_iter().map(|limit| limit.left).min()
}

/// The peak memory of this process so far, if the system reports it.
pub(crate) fn peak() -> Option<u64> {
    kib(&text("/proc/self/status")?, "VmHWM")
}

/// A limit of memory.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Limit {
    /// The limit's name: "the address space of this process".
    whose: &'static str,
    all: u64,
    left: u64,
}

impl Limit {
    fn new(whose: &'static str, all: u64, used: u64) -> Self {
        Self { whose, all, left: all.saturating_sub(used) }
    }
}

/// All known limits.
fn limits() -> Vec<Limit> {
    let mut found = Vec::new();
    if let (Some(status), Some(limits)) = (text("/proc/self/status"), text("/proc/self/limits")) {
        found.extend(of_process(&status, &limits));
        let used = kib(&status, "VmRSS").unwrap_or(0);
        found.extend(text("/proc/meminfo").and_then(|info| of_machine(&info, used)));
    }
    if let Some(listing) = text("/proc/self/cgroup") {
        found.extend(of_cgroups(Path::new("/sys/fs/cgroup"), &listing));
    }
    found
}

/// The limits set by `ulimit -v` and `ulimit -d`.
fn of_process(status: &str, limits: &str) -> Vec<Limit> {
    let address_space = soft_limit(limits, "Max address space").zip(kib(status, "VmSize"));
    let data = soft_limit(limits, "Max data size").zip(kib(status, "VmData"));
    let address_space = address_space.map(|(all, used)| {
        Limit::new("the address space that this process may have (ulimit -v)", all, used + THREADS_TO_COME)
    });
    let data = data.map(|(all, used)| Limit::new("the data that this process may have (ulimit -d)", all, used));
    address_space.into_iter().chain(data).collect()
}

/// The machine's memory. What other programs use now is not subtracted, as it may be free in a
/// moment.
fn of_machine(info: &str, used: u64) -> Option<Limit> {
    let all = kib(info, "MemTotal")? + kib(info, "SwapTotal").unwrap_or(0);
    Some(Limit::new("this machine's memory", all, used))
}

/// The limits of a process's control groups, version 2 or 1, and of the groups around them.
fn of_cgroups(root: &Path, listing: &str) -> Vec<Limit> {
    let mut found = Vec::new();
    for line in listing.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(number), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next()) else {
            continue;
        };
        let (mount, most, used, cache) = match (number, controllers.split(',').any(|name| name == "memory")) {
            ("0", _) => (root.to_owned(), "memory.max", "memory.current", "inactive_file"),
            (_, true) => {
                let names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file");
                (root.join("memory"), names.0, names.1, names.2)
            }
            _ => continue,
        };
        let groups = Path::new(path.trim_start_matches('/')).ancestors().map(|group| mount.join(group));
        found.extend(groups.filter_map(|group| of_cgroup(&group, most, used, cache)));
    }
    found
}

fn of_cgroup(group: &Path, most: &str, used: &str, cache: &str) -> Option<Limit> {
    let number = |name: &str| text(group.join(name))?.trim().parse::<u64>().ok();
    let all = number(most)?;
    // Pages of files are released when memory is short.
    let stat = text(group.join("memory.stat")).unwrap_or_default();
    let cached = stat.lines().find_map(|line| line.strip_prefix(cache)?.trim().parse().ok()).unwrap_or(0);
    Some(Limit::new("this container's memory (cgroup)", all, number(used)?.saturating_sub(cached)))
}

fn text(path: impl Into<PathBuf>) -> Option<String> {
    fs::read_to_string(path.into()).ok()
}

/// The value of a line such as "VmSize:     123 kB", bytes.
fn kib(text: &str, name: &str) -> Option<u64> {
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    value.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// The soft limit of a line such as "Max data size     unlimited     unlimited     bytes"; none
/// where it is unlimited.
fn soft_limit(text: &str, name: &str) -> Option<u64> {
    text.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATUS: &str = "Name:\tgs\nVmPeak:\t  900 kB\nVmSize:\t  400000 kB\nVmHWM:\t 50 kB\nVmData:\t  1000 kB\n";
    const LIMITS: &str = "Limit                     Soft Limit           Hard Limit           Units     \n\
        Max data size             2048000              unlimited            bytes     \n\
        Max address space         4096000000           4096000000           bytes     \n";

    #[test]
    fn limits_of_the_process_exclude_its_use() {
        let [address_space, data] = of_process(STATUS, LIMITS).try_into().unwrap();
        assert_eq!(
            (address_space.all, address_space.left),
            (4_096_000_000, 4_096_000_000 - 409_600_000 - THREADS_TO_COME)
        );
        assert_eq!((data.all, data.left), (2_048_000, 1_024_000));
        assert_eq!(of_process(STATUS, &LIMITS.replace("4096000000", "unlimited")).len(), 1);
        assert_eq!(of_process("", LIMITS), []);
        let machine = of_machine("MemTotal:  1000 kB\nMemFree:  1 kB\nSwapTotal:   24 kB\n", 1024).unwrap();
        assert_eq!((machine.all, machine.left), (1024 * 1024, 1023 * 1024));
    }

    #[test]
    fn limits_of_all_enclosing_cgroups_count() {
        let place = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| {
            let path = place.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("a/memory.max", "5000\n");
        write("a/memory.current", "3000\n");
        write("a/memory.stat", "anon 7\ninactive_file 1000\n");
        write("a/b/memory.max", "max\n");
        write("a/b/memory.current", "10\n");
        let limits = |listing: &str| -> Vec<(u64, u64)> {
            of_cgroups(place.path(), listing).iter().map(|limit| (limit.all, limit.left)).collect()
        };
        assert_eq!(limits("0::/a/b\n"), [(5000, 3000)]);
        write("memory/c/memory.limit_in_bytes", "8000\n");
        write("memory/c/memory.usage_in_bytes", "500\n");
        assert_eq!(limits("5:cpu:/c\n4:memory:/c\n0::/\n"), [(8000, 7500)]);
        assert_eq!(limits("nonsense"), []);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn this_process_has_limits() {
        assert!(peak().unwrap() > 1_000_000);
        let limits = limits();
        assert!(limits.iter().any(|limit| limit.whose.contains("machine") && limit.left > 0 && limit.left < limit.all));
        let need = |bytes| Need { what: "a test".to_owned(), bytes, held: 0, less: "test less" };
        need(1).check_and_print().unwrap();
        let line = need(u64::MAX).check().unwrap_err().line().unwrap();
        let ends = line.ends_with("are left: test less, or allow more");
        assert!(line.starts_with("error: a test: takes about 18446744073.7 GB of memory, but only ") && ends, "{line}");
    }
}
