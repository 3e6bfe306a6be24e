//! The kernels for Arm against the oracle, and the program for Arm with one thread and with two.

use std::{path::PathBuf, process::Command};

use super::{
    bench::{Bench, Outcome, expect},
    program::{ON_ARM, Program, equal},
};
use xtask::{
    dist::{build::PROFILE, tools::Tools},
    system::{output, target},
};

const TRIPLE: &str = "aarch64-unknown-linux-gnu";

/// The tests of gs-conformance that compare the CPU backend with the oracle, and numbers of threads.
const TESTS: [&str; 3] = [
    "cpu::conforms_at_the_best_level",
    "cpu_3d::conforms_at_the_best_level",
    "cpu::images_and_gradients_have_the_same_bits_for_every_number_of_threads",
];

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    let folder = bench.folder("arm")?;
    let Some(gs) = Program::arm(bench, &folder)? else {
        return Ok(Outcome::Skipped("there is no QEMU for 64-bit Arm; --install installs it".to_owned()));
    };
    let dataset = bench.dataset.display().to_string();
    for threads in ["1", "2"] {
        let image = format!("{threads}/image");
        gs.run(&folder, &["fit", "-n", "300", "-i", "10", "--threads", threads, "-o", &image])?;
        let size = ["-i", "20", "--max-size", "64", "-o"];
        gs.run(&folder, &[&["train", &dataset, "--threads", threads], &size[..], &[threads]].concat())?;
    }
    for file in ["image/scene.gs2d.safetensors", "scene.ply"] {
        let [one, two] = ["1", "2"].map(|threads| folder.join(threads).join(file));
        expect(equal(&one, &two)?, || format!("{file} with two threads differs from that with one"))?;
    }
    let mut conformance = Command::new(ON_ARM[0]);
    conformance.args(&ON_ARM[1..]).arg(&bench.conformance).args(TESTS).arg("--exact");
    let seen = output(&mut conformance)?;
    expect(seen.contains(&format!("{} passed", TESTS.len())), || seen.clone())?;
    Ok(Outcome::Passed("NEON conforms to the oracle in 2D and 3D; bits equal for 1, 2 and 7 threads".to_owned()))
}

/// Builds the test program of gs-conformance for Arm, with the kernels of the release.
pub(super) fn built(tools: &Tools) -> Result<PathBuf, String> {
    let mut build = tools.command("cargo-zigbuild");
    build.args(["zigbuild", "--locked", "--profile", PROFILE, "-p", "gs-conformance", "--test", "main"]);
    build.args(["--target", &format!("{TRIPLE}.2.28"), "--message-format", "json-render-diagnostics"]);
    let messages = output(build.arg("--target-dir").arg(target()))?;
    // The only message with a program that can be run.
    let path = messages.lines().find_map(|line| line.split("\"executable\":\"").nth(1)?.split('"').next());
    path.map(PathBuf::from).ok_or_else(|| format!("no test program was built: {messages}"))
}
