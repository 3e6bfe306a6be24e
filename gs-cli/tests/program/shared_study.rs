//! A study that several processes share: `gs study prepare`, `work`, `submit`, `status` and
//! `report`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Stdio},
};

use crate::{
    process::{Run, command, folder, gs, names_in, picture},
    study::{STUDY, study, tables},
};

fn words<'a>(action: &'a str, path: &'a Path) -> [&'a str; 3] {
    ["study", action, path.to_str().unwrap()]
}

/// Makes the folder of a study.
fn prepare(study: &Path, output: &Path) -> Run {
    gs(words("prepare", study).iter().chain(&["-o", output.to_str().unwrap(), "--backend", "cpu"]))
}

/// Starts a process that takes part.
fn start(output: &Path, flags: &[&str]) -> Child {
    let mut command = command();
    command.args(words("work", output)).args(["--threads", "1"]).args(flags);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// The rows that processes say they did, each with how often.
fn rows_done(runs: &[Run]) -> BTreeMap<usize, usize> {
    let mut rows = BTreeMap::new();
    for line in runs.iter().flat_map(|run| run.stderr.lines()) {
        if let Some(row) = line.strip_prefix("row ").and_then(|line| line.split(' ').next()?.parse().ok()) {
            *rows.entry(row).or_default() += 1;
        }
    }
    rows
}

#[test]
fn killed_and_stopped_processes_do_each_run_once() {
    let place = folder();
    let file = study(place.path());
    fs::write(&file, STUDY.replace("iterations = 60", "iterations = 600")).unwrap();
    let (alone, shared) = (place.path().join("alone"), place.path().join("shared"));
    gs(["study", file.to_str().unwrap(), "-o", alone.to_str().unwrap(), "--backend", "cpu"]).done();
    let prepared = prepare(&file, &shared).done();
    assert!(
        prepared
            .stdout
            .starts_with("small: 12 runs (2 arms, 2 images, 1 budget, 3 seeds); do them with gs study work ")
    );

    let mut processes = ["0/3", "1/3", "2/3"].map(|shard| start(&shared, &["--shard", shard]));
    // Both are somewhere in their first runs.
    while names_in(&shared.join("runs")).iter().filter(|name| name.ends_with(".claim")).count() < 3 {
        std::thread::yield_now();
    }
    processes[0].kill().unwrap();
    #[cfg(unix)]
    crate::process::signal(&processes[1], "-TERM", 1);
    let ended = processes.map(|process| Run::ended(process.wait_with_output().unwrap()));
    #[cfg(unix)]
    {
        assert_eq!((ended[0].status, ended[1].status), (None, Some(130)), "{ended:?}");
        assert!(ended[1].stderr.contains("stopped after ") && ended[1].stderr.contains("; to go on: gs study work "));
    }
    assert!(ended[2].stdout.contains(" done, none is left; see gs study report "), "{ended:?}");
    let rows = rows_done(&ended);
    assert!(rows.values().all(|&times| times == 1) && rows.len() >= 11, "{rows:?}");

    let status = gs(words("status", &shared)).done().stdout;
    assert_eq!(status, "small: 12 of 12 runs ended, 0 under way, 0 left by processes that died, 0 free\n");
    gs(words("report", &shared)).done();
    assert_eq!(tables(&shared), tables(&alone));
    assert_eq!(names_in(&shared.join("runs")), names_in(&alone.join("runs")), "no claim is left");
}

#[test]
fn a_report_covers_what_there_is_at_any_moment() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out");
    prepare(&file, &output).done();
    let none = gs(words("report", &output));
    assert!(none.refusal().contains("no run has ended yet: do runs with gs study work "), "{none:?}");
    assert_eq!(
        gs(words("status", &output)).done().stdout,
        "small: 0 of 12 runs ended, 0 under way, 0 left by processes that died, 12 free\n"
    );
    gs(words("work", &output)).done();
    let record = output.join("runs").join(&names_in(&output.join("runs"))[4]);
    let text = fs::read(&record).unwrap();
    fs::write(&record, &text[..text.len() - 9]).unwrap();
    let report = gs(words("report", &output)).done();
    assert!(report.stderr.contains(": its record was damaged (cut short?) and is removed"), "{report:?}");
    assert!(report.stderr.contains("1 of 12 runs are missing; tables and report are of the others"), "{report:?}");
    let csv = fs::read_to_string(output.join("runs.csv")).unwrap();
    assert_eq!((csv.matches(",finished,").count(), csv.matches(",missing,").count()), (11, 1));
    let again = gs(words("work", &output)).done();
    assert!(again.stdout.starts_with("1 run done, none is left"), "{again:?}");
    let whole = place.path().join("whole");
    gs(["study", file.to_str().unwrap(), "-o", whole.to_str().unwrap()]).done();
    gs(words("report", &output)).done();
    assert_eq!(tables(&output), tables(&whole));
}

#[test]
fn a_node_that_cannot_do_the_study_as_prepared_says_why_in_one_line() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out");
    prepare(&file, &output).done();
    let refused = |run: Run, expected: &str| {
        let line = run.refusal().to_owned();
        assert!(line.contains(expected), "{line}");
        assert_eq!(names_in(&output.join("runs")).len(), 0, "{line}");
    };
    let images = place.path().join("elsewhere");
    fs::create_dir(&images).unwrap();
    let image = place.path().join("picture-32x24.png");
    fs::rename(&image, images.join("picture-32x24.png")).unwrap();
    refused(
        gs(words("work", &output)),
        "picture-32x24.png: no such file in any folder: name the folder that has it with --data",
    );
    // Another picture under the same name.
    fs::rename(picture(place.path(), 24, 32), &image).unwrap();
    refused(gs(words("work", &output)), ") is not the one that the study began with: name the folder of the right one");
    #[cfg(target_arch = "x86_64")]
    refused(
        gs(words("work", &output).iter().chain(&["--simd", "baseline"])),
        ": a study has one backend and SIMD level for all machines",
    );
    let machine = output.join("machine.json");
    let text = fs::read_to_string(&machine).unwrap();
    fs::write(&machine, text.replace("\"version\": \"0.1", "\"version\": \"0.0")).unwrap();
    let data = ["--data", images.to_str().unwrap()];
    refused(gs(words("work", &output).iter().chain(&data)), "is a study by version 0.0.0");
    refused(gs(words("report", &output).iter().chain(&data)), "is a study by version 0.0.0");
    let mut newer: serde_json::Value = serde_json::from_str(&text).unwrap();
    newer["flags"][3] = "avx1024".into();
    fs::write(&machine, newer.to_string()).unwrap();
    refused(
        gs(words("work", &output).iter().chain(&data)),
        "--simd avx1024: this machine has no such SIMD level: choose from ",
    );
    fs::write(&machine, text).unwrap();
    gs(words("work", &output).iter().chain(&data)).done();
    refused_flag(&output, &["--shard", "3/3"], "parts are counted from 0: 3 is not less than 3");
    refused_flag(&output, &["--shard", "first"], "write it as I/N, such as 0/4");
    refused_flag(&output, &["--lease", "0"], "must be from 1 to 86400");
}

fn refused_flag(output: &Path, flags: &[&str], expected: &str) {
    let run = gs(words("work", output).iter().chain(flags));
    assert!(run.refusal().contains(expected) && run.status == Some(2), "{run:?}");
}

#[cfg(unix)]
#[test]
fn a_full_disk_ends_the_work_in_one_line_and_costs_no_row() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out");
    prepare(&file, &output).done();
    // Files may not become larger than a block, which holds a claim but no record.
    let script = "trap '' XFSZ; ulimit -f 1; exec \"$0\" study work \"$1\"";
    let mut limited = std::process::Command::new("sh");
    let run = Run::of(limited.args(["-c", script, env!("CARGO_BIN_EXE_gs"), output.to_str().unwrap()]));
    let last = run.stderr.lines().last().unwrap();
    assert!(run.status == Some(1) && last.starts_with("error: ") && last.contains(": cannot be written: "), "{run:?}");
    let left = names_in(&output.join("runs"));
    assert!(left.len() == 1 && left[0].ends_with(".0.claim"), "{left:?}");
    let status = gs(words("status", &output)).done().stdout;
    assert!(status.contains("0 of 12 runs ended, 0 under way, 0 left by processes that died, 12 free"), "{status}");
    assert!(gs(words("work", &output)).done().stdout.starts_with("12 runs done"));
}

/// A folder with a program of this name, which prints its arguments.
#[cfg(unix)]
fn stand_in(place: &Path, name: &str, says: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt as _;
    let bin = place.join("bin");
    fs::create_dir_all(&bin).unwrap();
    fs::write(bin.join(name), format!("#!/bin/sh\necho {says}\n")).unwrap();
    fs::set_permissions(bin.join(name), fs::Permissions::from_mode(0o755)).unwrap();
    bin
}

#[cfg(unix)]
#[test]
fn a_study_is_handed_to_slurm_as_an_array() {
    let place = folder();
    let file = study(place.path());
    let output = place.path().join("out of 100%");
    let submit = |path: &Path, flags: &[&str]| {
        let mut command = command();
        command.args(words("submit", &file)).args(["-o", output.to_str().unwrap(), "--array", "8", "--cpus", "4"]);
        Run::of(command.args(flags).env("PATH", path))
    };
    let none = submit(&place.path().join("nothing"), &[]);
    let last = none.stderr.lines().last().unwrap();
    let script = output.join("work.sbatch");
    let expected =
        format!("error: sbatch: there is no such program here: submit {} where there is one", script.display());
    assert!(none.status == Some(1) && last.starts_with(&expected), "{none:?}");

    let bin = stand_in(place.path(), "sbatch", "Submitted batch job 71");
    let flags = ["--resume", "--time", "2-00", "--partition", "long", "--jobs", "2", "--", "--account=physics"];
    let run = submit(&bin, &flags).done();
    assert!(
        run.stdout.contains("small: 12 runs (")
            && run.stdout.contains(": Submitted batch job 71; see gs study status ")
    );
    let text = fs::read_to_string(&script).unwrap();
    let place = place.path().display();
    for line in [
        "#SBATCH --job-name=\"gs-out of 100%\"",
        "#SBATCH --array=0-7",
        "#SBATCH --cpus-per-task=4",
        "#SBATCH --requeue",
        "#SBATCH --time=2-00",
        "#SBATCH --partition=long",
        "#SBATCH --account=physics",
        &format!("#SBATCH --output=\"{place}/out of 100%%/logs/%A_%a.log\""),
    ] {
        assert!(text.lines().any(|known| known == line), "{line}: {text}");
    }
    let last = text.lines().last().unwrap();
    assert!(last.ends_with(&format!(" study work '{place}/out of 100%' --threads 4 --jobs 2")), "{last}");
    assert!(submit(&bin, &["--resume", "--partition", "a b"]).refusal().contains("must be one word"));

    let squeue = format!("'RUNNING {0}\nRUNNING {0}\nPENDING {0}\nRUNNING /other/work.sbatch'", script.display());
    let bin = stand_in(Path::new(&place.to_string()), "squeue", &squeue);
    let status = Run::of(command().args(words("status", &output)).env("PATH", bin)).done();
    assert!(status.stdout.ends_with("Slurm: 1 task pending, 2 tasks running\n"), "{status:?}");
}
