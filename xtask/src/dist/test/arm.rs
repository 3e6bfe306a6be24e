//! The kernels for Arm against the oracle, and the program for Arm with one thread and with two.

use std::process::Command;

use super::{
    Bench, Outcome, expect, output,
    program::{ON_ARM, Program, equal},
};
use crate::{dist::build::PROFILE, system::target};

const TRIPLE: &str = "aarch64-unknown-linux-gnu";

/// The tests of gs-conformance that compare the CPU backend with the oracle, and numbers of threads.
const TESTS: [&str; 3] = [
    "cpu::conforms_at_every_level_and_number_of_threads",
    "cpu_3d::conforms_at_every_level_and_number_of_threads",
    "cpu::images_and_gradients_have_the_same_bits_for_every_number_of_threads",
];

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    let folder = bench.folder("arm")?;
    let Some(gs) = Program::arm(bench, &folder)? else {
        return Ok(Outcome::Skipped("there is no QEMU for 64-bit Arm; --install installs it".to_owned()));
    };
    for threads in ["1", "2"] {
        gs.run(&folder, &["fit", "-n", "300", "-i", "10", "--threads", threads, "-o", threads])?;
    }
    let scenes = ["1", "2"].map(|threads| folder.join(threads).join("scene.gs2d.safetensors"));
    expect(equal(&scenes[0], &scenes[1])?, || "a fit with two threads differs from one with one".to_owned())?;
    let seen = output(conformance(bench)?.args(TESTS).arg("--exact"))?;
    expect(seen.contains(&format!("{} passed", TESTS.len())), || seen.clone())?;
    Ok(Outcome::Passed("NEON conforms to the oracle in 2D and 3D; bits equal for 1, 2 and 7 threads".to_owned()))
}

/// The test program of gs-conformance for Arm, with the kernels of the release, under QEMU.
fn conformance(bench: &Bench<'_>) -> Result<Command, String> {
    let mut build = bench.tools.command("cargo-zigbuild");
    build.args(["zigbuild", "--locked", "--profile", PROFILE, "-p", "gs-conformance", "--test", "main"]);
    build.args(["--target", &format!("{TRIPLE}.2.28"), "--message-format", "json-render-diagnostics"]);
    let messages = output(build.arg("--target-dir").arg(target()))?;
    // The only message with a program that can be run.
    let path = messages.lines().find_map(|line| line.split("\"executable\":\"").nth(1)?.split('"').next());
    let path = path.ok_or_else(|| format!("no test program was built: {messages}"))?;
    let mut run = Command::new(ON_ARM[0]);
    run.args(&ON_ARM[1..]).arg(path);
    Ok(run)
}
