//! The project's own commands: `cargo xtask test` runs all the tests, `cargo xtask cluster` studies
//! and blocks on a cluster of this machine, `cargo xtask poses` finds the poses of photographs, `cargo xtask
//! python` builds and tests the Python module, `cargo xtask web` the page, and `cargo xtask dist` makes a
//! release.
//!
//! This program depends on no crate, so that it compiles within a second on a fresh machine.

use std::process::ExitCode;

use xtask::{cluster, dist, poses, python, system::Options, test, web};

const HELP: &str = "\
Usage: cargo xtask test [--install] [--slow]
       cargo xtask cluster [--install]
       cargo xtask poses [--test] [--install]
       cargo xtask python [--test] [--install]
       cargo xtask web [--package] [--test] [--slow] [--install]
       cargo xtask dist [--test] [--install]

cargo xtask test runs the tests of the workspace, documentation tests included.

Options:
  --install  install what the tests need: Mesa's software Vulkan driver, where there is no
             graphics adapter. Without it nothing is installed, and tests that need an
             adapter are skipped and listed by name
  --slow     then run the slow tests (marked #[ignore]) in the release profile, and those of gs manual

Tests on real images and scenes read the folder that GS_DATA names, ../shared/data by default.
They pass without checking anything where it is absent.

cargo xtask cluster starts Slurm on this machine, in a folder of its own, and does two studies and a
scene in blocks there as arrays of tasks. One task of each is cancelled, and of two of them another is
killed. The tables, the scene and its evaluation must be those of one process.

Options:
  --install  install Debian's slurm-wlm and munge; without it and without them, nothing is checked

cargo xtask poses shows the COLMAP that gs poses would run.

Options:
  --test     find the poses of photographs with it: of a room that is made up, with PyCOLMAP too,
             and of the test data where they are; compare them with the known ones, and train
             briefly. This takes minutes
  --install  install Debian's colmap, and PyCOLMAP from PyPI in an environment of its own; without
             colmap, nothing is checked

cargo xtask python builds the Python module as a wheel into target/wheels, packed by tools from PyPI
in an environment of its own. Without Python 3.9 or later it says so and builds nothing.

Options:
  --test     build without optimising what does not compute, install the wheel into that
             environment, and run linter, type checker, tests and the tutorial. Tests that need
             PyTorch, JAX or Ray are skipped and listed by name
  --install  install Debian's python3-venv, where no Python can make environments

cargo xtask web builds the page for browsers into target/page, where gs page and gs serve find it. It
needs Rust's target wasm32-unknown-unknown, and uses wasm-opt where that is installed. With Rust's
component rust-src, the page has threads.

Options:
  --test     instead test a page that is built without optimising what does not compute, in headless
             Chromium and against the program, in target/web-test, where screenshots are kept.
             Without node, npm and Chromium, nothing is checked
  --slow     with --test, also build the WebAssembly for one thread, as a release has it; otherwise
             that for several threads stands in for it
  --install  install the target and the component, and put the page where a gs of cargo install finds
             it, into share/gs/page of cargo's folder; with --test or --package install Debian's
             chromium, nodejs and npm, and packages of npm
  --package  instead build the npm package, the viewer and the decoder of .gsi files, into
             target/web-package; with --test, test it

cargo xtask dist builds a release into target/dist, for Linux (x86-64 and 64-bit Arm, glibc 2.28 or
later) and Windows (x86-64): archives of the program with the page, completions, man pages and
licences, an SBOM for each, wheels, Debian packages, and SHA256SUMS. The same commit gives the same
bits. The tools come from PyPI, in an environment of their own. It runs on x86-64 Linux, with Python
3.11 or later, Node and npm.

Options:
  --test     then test it: the Windows program under Wine, the Arm program and its kernels under
             QEMU, the archive and the package in a bare Debian, the wheel in a fresh environment,
             the same bits on Linux and Windows, and cargo check for macOS, with root or sudo. It takes
             minutes. What a machine cannot run is skipped by name, and with --install an error
  --install  install Rust's targets and the component rust-src; with --test Debian's debootstrap,
             qemu-user-static and wine";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (name, flags) = arguments.split_first().map_or(("help", &[][..]), |(name, flags)| (name.as_str(), flags));
    if ["help", "-h", "--help"].contains(&name) || flags.iter().any(|flag| flag == "-h" || flag == "--help") {
        eprintln!("{HELP}");
        return ExitCode::SUCCESS;
    }
    type Run = fn(Options) -> Result<(), String>;
    let (run, known): (Run, &[&str]) = match name {
        "test" => (test::run, &["--install", "--slow"]),
        "cluster" => (cluster::run, &["--install"]),
        "poses" => (poses::run, &["--test", "--install"]),
        "python" => (python::run, &["--test", "--install"]),
        "web" => (web::run, &["--package", "--test", "--slow", "--install"]),
        "dist" => (dist::run, &["--test", "--install"]),
        other => return failed(&format!("unknown command {other}: see cargo xtask help"), 2),
    };
    match Options::parse(flags, known) {
        Ok(options) => run(options).map_or_else(|message| failed(&message, 1), |()| ExitCode::SUCCESS),
        Err(message) => failed(&format!("{message}: see cargo xtask help"), 2),
    }
}

fn failed(message: &str, status: u8) -> ExitCode {
    eprintln!("error: {message}");
    ExitCode::from(status)
}
