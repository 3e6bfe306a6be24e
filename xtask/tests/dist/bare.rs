//! A bare Debian, with neither Rust nor a C compiler, in which the archive is unpacked and the package installed.

use std::{path::Path, process::Command, time::Instant};

use super::bench::{Bench, Outcome, expect};
use xtask::system::{VERSION, is_root, output, root, target};

/// The longest time from the archive to a picture, seconds.
const LIMIT: f64 = 20.0;

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    if cfg!(not(all(target_arch = "x86_64", target_os = "linux"))) {
        return Ok(Outcome::Skipped("it needs x86-64 Linux".to_owned()));
    }
    if !is_root() && output(Command::new("sudo").args(["--non-interactive", "true"])).is_err() {
        return Ok(Outcome::Skipped("it needs root, or sudo without a password".to_owned()));
    }
    if !bench.has("debootstrap", &["debootstrap"])? {
        return Ok(Outcome::Skipped("there is no debootstrap; --install installs it".to_owned()));
    }
    let system = target().join("dist-tools/debian");
    if !system.exists() {
        // What is incomplete, since something failed, has another name.
        let part = system.with_extension("part");
        output(root("rm").arg("-rf").arg(&part))?;
        output(root("debootstrap").args(["--variant=minbase", "bookworm"]).arg(&part))?;
        output(root("mv").arg(&part).arg(&system))?;
    }
    let archive = format!("gs-{VERSION}-x86_64-linux");
    let package = format!("gaussian-splats_{VERSION}_amd64.deb");
    for file in [format!("{archive}.tar.gz"), package.clone()] {
        output(root("cp").arg(bench.release.join(&file)).arg(system.join("root")))?;
    }
    // The program finds its page by /proc, which is there for this command alone.
    let inside = |script: &str| {
        let mut command = root("unshare");
        command.args(["--mount", "chroot"]).arg(&system);
        output(command.args(["sh", "-ec", &format!("mount -t proc proc /proc; {script}")]))
    };
    inside("for tool in cc rustc cargo; do if command -v $tool; then exit 1; fi; done")?;
    inside("cd /root; rm -rf gs-out gs-[0-9]*[!z]")?;
    let started = Instant::now();
    inside(&format!("cd /root; tar -xf {archive}.tar.gz; {archive}/bin/gs fit; test -s gs-out/reconstruction.png"))?;
    let seconds = started.elapsed().as_secs_f64();
    expect(seconds <= LIMIT, || format!("{seconds:.1} s from the archive to a picture, and not {LIMIT}"))?;
    inside(&format!("cd /root; {archive}/bin/gs page gs-out -o page.html; test -s page.html"))?;
    in_package(&inside, &package, &system)?;
    Ok(Outcome::Passed(format!(
        "{seconds:.1} s from the archive to a picture of gs fit; the package installs and runs"
    )))
}

/// Installs the package, uses it, and removes it.
fn in_package(inside: &dyn Fn(&str) -> Result<String, String>, package: &str, system: &Path) -> Result<(), String> {
    inside(&format!(
        "cd /root; dpkg -i {package}; rm -rf gs-out; gaussian-splats fit; test -s gs-out/reconstruction.png"
    ))?;
    inside("cd /root; gaussian-splats page gs-out -o page.html; dpkg -r gaussian-splats; rm -rf gs-out page.html")?;
    expect(!system.join("usr/lib/gaussian-splats").exists(), || "the package leaves files behind".to_owned())
}
