//! `cargo xtask miri`: tests under Miri, which interprets a program step by step, and ends it where it does what the language forbids.
//!
//! The libraries of this workspace have no `unsafe` of their own. What they rest on has: vectors (fearless_simd, glam), threads (rayon and
//! crossbeam), decoders of files (image, flate2, safetensors, serde_json). So what is chosen are the tests that drive these hardest for the time they
//! take, property tests first. What Miri cannot run of them, or takes minutes over, is marked so beside the test, and property tests draw
//! fewer and smaller cases (`gs_conformance::properties`).

use std::process::{Command, Stdio};

use crate::test;

/// How to install what is missing.
const INSTALL: &str = "rustup toolchain install nightly --component miri,rust-src";

/// Processors as of this level have AVX2, so that there the levels of gs-cpu are all but AVX-512, of which Miri knows too few instructions.
const PROCESSOR: &str = "-Ctarget-cpu=x86-64-v3";

/// Sines and exponentials are the same each time. Miri would add an error drawn at random; that a machine's functions answer alike is what
/// "the same bits for every number of threads" rests on.
const SAME_BITS: &str = "-Zmiri-deterministic-floats";

/// Rayon's queues (crossbeam-epoch) get from a list's link to what is around it, which Stacked Borrows forbids and Tree Borrows allows, and
/// keep tags in pointers, by way of integers. Its threads may outlive the pool that is dropped, and count as leaks then.
const THREADS: &str = "-Zmiri-tree-borrows -Zmiri-permissive-provenance -Zmiri-ignore-leaks";

/// Folders for a test's files are made and listed.
const FILES: &str = "-Zmiri-disable-isolation";

/// Tests that run with the same flags. Lists are separated by spaces.
struct Group {
    /// What cargo is told to test.
    targets: &'static str,
    /// Tests whose names contain one of these; all where there are none.
    names: &'static str,
    /// Miri's flags beside [`SAME_BITS`].
    flags: &'static str,
}

const GROUPS: &[Group] = &[
    // glam's vectors, and the arithmetic that everything else is made of.
    Group { targets: "--package gs-core --package gs-oracle --lib", names: "", flags: "" },
    // Property tests of policies: those that compare, and those that look at images.
    Group {
        targets: "--package gs-density --test criteria",
        names: "permuting the_budget_is_kept what_is_not_finite",
        flags: "",
    },
    Group {
        targets: "--package gs-density --test relocation",
        names: "budgets_are_met the_same_random_numbers",
        flags: THREADS,
    },
    // Property tests of readers and writers.
    Group {
        targets: "--package gs-io --test scenes --test 3D --test images --test datasets",
        names: "survive_a_round_trip is_the_identity gltf_keeps splat_stays flipped_bytes mutated",
        flags: FILES,
    },
    // Vectors at every level, and how images are laid out for them.
    Group { targets: "--package gs-cpu --lib", names: "", flags: THREADS },
    // Drawn scenes through every kernel of gs-cpu.
    Group {
        targets: "--package gs-conformance --test cpu --test cpu_3d --test fuzzed",
        names: "drawn_images drawn_gradients the_processor_owes",
        flags: THREADS,
    },
];

/// Runs all groups to their end, as one takes minutes; what failed is said last.
pub(crate) fn run() -> Result<(), String> {
    prepare()?;
    let failed: Vec<String> = GROUPS.iter().filter_map(|group| group.run().err()).collect();
    if failed.is_empty() { Ok(()) } else { Err(failed.join("\nerror: ")) }
}

/// Builds the standard library that Miri interprets, where that is still to be done.
fn prepare() -> Result<(), String> {
    let status = miri(&["setup"]).stdin(Stdio::null()).status();
    if status.is_ok_and(|status| status.success()) {
        Ok(())
    } else {
        Err(format!("Miri is not installed, or lacks the sources of the standard library: {INSTALL}"))
    }
}

/// Cargo of the nightly toolchain, which alone has Miri.
fn miri(arguments: &[&str]) -> Command {
    let mut cargo = Command::new("rustup");
    cargo.args(["run", "nightly", "cargo", "miri"]).args(arguments);
    cargo
}

impl Group {
    fn run(&self) -> Result<(), String> {
        // nextest runs tests side by side; Miri itself takes one after the other.
        let runner = if test::has_nextest() { "nextest run" } else { "test" };
        let words = format!("{runner} --no-fail-fast {} -- {}", self.targets, self.names);
        let flags = format!("{SAME_BITS} {}", self.flags);
        let mut command = miri(&words.split_whitespace().collect::<Vec<_>>());
        command.env("MIRIFLAGS", &flags);
        if cfg!(target_arch = "x86_64") {
            command.env("RUSTFLAGS", PROCESSOR);
        }
        test::run_in_workspace(&format!("MIRIFLAGS=\"{flags}\" cargo +nightly miri {words}"), &mut command)
    }
}
