//! `cargo xtask miri`: tests under Miri, which interprets a program step by step, and ends it where it does what the language forbids.
//!
//! The libraries of this workspace have no `unsafe` of their own. What they rest on has: vectors (fearless_simd, glam), threads (rayon and
//! crossbeam), views of bytes (bytemuck, safetensors, image). So what is chosen are the tests that drive these hardest for the time they
//! take, property tests first. What Miri cannot run of them, or takes minutes over, is marked so beside the test, and property tests draw
//! fewer and smaller cases (`gs_conformance::properties`).

use std::process::{Command, Stdio};

use crate::test;

/// How to install what is missing.
const INSTALL: &str = "rustup toolchain install nightly --component miri,rust-src";

/// Processors as of this level have AVX2, so that there the levels of gs-cpu are all but AVX-512, of which Miri knows too few instructions.
const PROCESSOR: &str = "-Ctarget-cpu=x86-64-v3";

/// Tests that run with the same flags.
struct Group {
    /// What cargo is told to test.
    targets: &'static [&'static str],
    /// Tests whose names contain one of these; all where there are none.
    names: &'static [&'static str],
    /// Miri's flags.
    flags: &'static [&'static str],
}

/// Sines and exponentials are the same each time. Miri would add an error drawn at random; that a machine's functions answer alike is what
/// "the same bits for every number of threads" rests on.
const SAME_BITS: &str = "-Zmiri-deterministic-floats";

/// Rayon's queues (crossbeam-epoch) get from a list's link to what is around it, which Stacked Borrows forbids and Tree Borrows allows, and
/// keep tags in pointers, by way of integers. Its threads may outlive the pool that is dropped, and count as leaks then.
const THREADS: [&str; 3] = ["-Zmiri-tree-borrows", "-Zmiri-permissive-provenance", "-Zmiri-ignore-leaks"];

const GROUPS: &[Group] = &[
    // glam's vectors, and the arithmetic that everything else is made of.
    Group { targets: &["--package", "gs-core", "--package", "gs-oracle", "--lib"], names: &[], flags: &[SAME_BITS] },
    // Property tests of policies: those that compare, and those that look at images.
    Group {
        targets: &["--package", "gs-density", "--test", "criteria"],
        names: &["permuting", "the_budget_is_kept", "what_is_not_finite"],
        flags: &[SAME_BITS],
    },
    Group {
        targets: &["--package", "gs-density", "--test", "relocation"],
        names: &["budgets_are_met", "the_same_random_numbers"],
        flags: &[SAME_BITS, THREADS[0], THREADS[1], THREADS[2]],
    },
    // Property tests of readers and writers; these make files.
    Group {
        targets: &[
            "--package",
            "gs-io",
            "--test",
            "scenes",
            "--test",
            "spatial",
            "--test",
            "images",
            "--test",
            "datasets",
        ],
        names: &["survive", "is_the_identity", "gltf_keeps", "splat_stays", "flipped_bytes", "mutated"],
        flags: &[SAME_BITS, "-Zmiri-disable-isolation"],
    },
    // Vectors at every level, and how they are sorted and laid out.
    Group {
        targets: &["--package", "gs-cpu", "--lib"],
        names: &[],
        flags: &[SAME_BITS, THREADS[0], THREADS[1], THREADS[2]],
    },
    // Drawn scenes through every kernel of gs-cpu, on two threads.
    Group {
        targets: &["--package", "gs-conformance", "--test", "cpu", "--test", "cpu_spatial", "--test", "fuzzed"],
        names: &["drawn_images", "drawn_gradients", "the_processor_owes"],
        flags: &[SAME_BITS, THREADS[0], THREADS[1], THREADS[2]],
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
        // nextest runs the tests side by side, and Miri has but one thread.
        let runner: &[&str] = if test::has_nextest() { &["nextest", "run"] } else { &["test"] };
        let arguments = [runner, &["--no-fail-fast"], self.targets, &["--"], self.names].concat();
        let flags = self.flags.join(" ");
        let line = format!("MIRIFLAGS=\"{flags}\" cargo +nightly miri {}", arguments.join(" "));
        let mut command = miri(&arguments);
        command.env("MIRIFLAGS", flags);
        if cfg!(target_arch = "x86_64") {
            command.env("RUSTFLAGS", PROCESSOR);
        }
        test::run_in_workspace(&line, &mut command)
    }
}
