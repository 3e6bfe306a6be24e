//! `cargo xtask cluster`: a study on a Slurm cluster of this machine, with tasks that are cancelled
//! and killed, against the same study in one process.

mod slurm;

use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use self::slurm::Slurm;
use crate::system::{built_example, built_program, install_packages, is_root, step};

/// Tasks of the array.
const TASKS: u32 = 4;

/// Longest time for the whole array.
const LIMIT: Duration = Duration::from_secs(150);

/// Tables that must be the same in both studies, byte for byte.
const TABLES: [&str; 4] = ["runs.csv", "quality.csv", "differences.csv", "results.json"];

/// 24 fits of about a second.
const FITS: &str = "\
name = 'cluster'
images = ['paper', 'thin-lines']
budgets = [400, 800]
seeds = [0, 1, 2]
preset = 'paper'
iterations = 1000
[[arm]]
name = 'none'
settings.policy.kind = 'none'
[[arm]]
name = 'percentile'
settings.policy.kind = 'percentile'
";

/// Two trainings of the data set that the example `posed_images` writes. Each takes several times
/// longer than Slurm needs to cancel a task, so the cancelled one leaves a checkpoint.
const TRAININGS: &str = "\
name = 'cluster-3d'
scenes = ['posed']
budgets = [60]
seeds = [0]
preset = 'quick'
iterations = 100000
[[arm]]
name = 'none'
settings.policy.kind = 'none'
[[arm]]
name = 'percentile'
settings.policy.kind = 'percentile'
";

/// A study that is done twice.
struct Study {
    name: &'static str,
    text: &'static str,
    /// Runs that must have ended before a task is cancelled.
    ended: u32,
    /// Whether another task is killed and requeued; the study needs enough runs for that.
    kills: bool,
    /// Whether the run of the cancelled task must go on from its checkpoint. Runs must take long
    /// enough for that.
    resumes: bool,
}

const STUDIES: [Study; 2] = [
    Study { name: "fits", text: FITS, ended: 6, kills: true, resumes: false },
    Study { name: "trainings", text: TRAININGS, ended: 0, kills: false, resumes: true },
];

/// Does the studies on a cluster and in one process, and compares them.
pub(crate) fn run(install: bool) -> Result<(), String> {
    if install {
        install_packages(&["slurm-wlm", "munge"])
            .map_err(|error| format!("{error}: install Slurm by hand, or run without --install"))?;
    }
    if let Some(missing) = slurm::PROGRAMS.iter().find(|program| !has(program)) {
        let how = if is_root() { "cargo xtask cluster --install" } else { "cargo xtask cluster --install, as root" };
        eprintln!("skipped: there is no {missing}: the study on a cluster; install Slurm with {how}");
        return Ok(());
    }
    let (gs, posed_images) = (built_program()?, built_example("posed_images")?);
    let place = env::temp_dir().join(format!("gs-cluster-{}", std::process::id()));
    fs::create_dir(&place).map_err(|error| format!("{}: {error}", place.display()))?;
    step(Command::new(posed_images).arg(place.join("posed")))?;
    let started = Instant::now();
    let checked =
        Slurm::start(&place).and_then(|slurm| STUDIES.iter().try_for_each(|study| check(study, &gs, &place, &slurm)));
    match &checked {
        Ok(()) => {
            eprintln!("the studies are the same on the cluster and in one process; {:.0?}", started.elapsed());
            let _ = fs::remove_dir_all(&place);
        }
        Err(_) => eprintln!("everything is left in {}", place.display()),
    }
    checked
}

/// Whether there is a program of this name.
fn has(program: &str) -> bool {
    let paths = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&paths).chain(["/usr/sbin".into()]).any(|folder| folder.join(program).is_file())
}

/// Does a study twice and compares the tables.
fn check(of: &Study, gs: &Path, place: &Path, slurm: &Slurm) -> Result<(), String> {
    let [file, cluster, alone] = ["toml", "cluster", "alone"].map(|kind| place.join(format!("{}.{kind}", of.name)));
    fs::write(&file, of.text).map_err(|error| format!("{}: {error}", file.display()))?;
    let cpu = ["--backend", "cpu"].map(str::to_owned);
    let (study, output) = (file.display().to_string(), cluster.display().to_string());
    let words = ["study", "submit", &study, "-o", &output, "--array", &TASKS.to_string()].map(str::to_owned);
    let said = slurm.command(gs, words.iter().chain(&cpu))?;
    let job = said.split_once("Submitted batch job ").and_then(|(_, rest)| rest.split(';').next());
    let job = job.ok_or_else(|| format!("no job was submitted: {said}"))?.trim().to_owned();
    eprintln!("{}", said.trim());
    let study = Watched { gs, folder: &cluster, slurm };
    cancel(&study, &job, of.ended)?;
    let killed = if of.kills { Some(kill_and_requeue(&study, &job)?) } else { None };
    study.wait("the end of the array", |_| Ok(slurm.states(&job)?.is_empty().then_some(())))?;
    eprint!("{}", slurm.command(gs, ["study", "status", &output])?);
    slurm.command(gs, ["study", "report", &output])?;

    let started = Instant::now();
    let words =
        ["study", &file.display().to_string(), "-o", &alone.display().to_string(), "--jobs", "2"].map(str::to_owned);
    slurm.command(gs, words.iter().chain(&cpu))?;
    eprintln!("one process with --jobs 2: {:.0?}", started.elapsed());
    for table in TABLES {
        let read = |folder: &Path| fs::read(folder.join(table)).map_err(|error| format!("{table}: {error}"));
        if read(&cluster)? != read(&alone)? {
            return Err(format!("{table} is not the same in {} and {}", cluster.display(), alone.display()));
        }
    }
    let logs = logs(&cluster)?;
    once(&logs, &alone, killed)?;
    match of.resumes {
        true => resumed(&logs),
        false => Ok(()),
    }
}

/// A study at work on the cluster.
struct Watched<'a> {
    gs: &'a Path,
    folder: &'a Path,
    slurm: &'a Slurm,
}

impl Watched<'_> {
    /// Waits until the state of the study, in the words of `gs study status`, gives a value.
    fn wait<T>(&self, what: &str, found: impl Fn(&str) -> Result<Option<T>, String>) -> Result<T, String> {
        let started = Instant::now();
        loop {
            let status = self.slurm.command(self.gs, ["study", "status", &self.folder.display().to_string()])?;
            if let Some(found) = found(&status)? {
                return Ok(found);
            }
            if started.elapsed() > LIMIT {
                return Err(format!("waited {LIMIT:?} for {what}: {status}"));
            }
            thread::sleep(Duration::from_millis(100));
        }
    }

    /// A row that a task is doing, and the task's process.
    fn doing(&self, job: &str, task: u32) -> Result<(u32, u32), String> {
        let job = format!(", job {job}_{task}: last sign of life");
        self.wait(&format!("a run of task {task}"), |status| {
            let line = status.lines().find(|line| line.contains(&job));
            Ok(line.and_then(|line| {
                let row = line.strip_prefix("row ")?.split(' ').next()?.parse().ok()?;
                let process = line.split_once(", process ")?.1.split(',').next()?.parse().ok()?;
                Some((row, process))
            }))
        })
    }
}

/// Cancels task 0 in the middle of a run, once so many runs have ended.
fn cancel(study: &Watched<'_>, job: &str, ended: u32) -> Result<(), String> {
    study.wait("the first runs", |status| {
        let known = status.split_once(": ").and_then(|(_, counts)| counts.split(' ').next()?.parse::<u32>().ok());
        Ok(known.filter(|known| *known >= ended))
    })?;
    let (row, _) = study.doing(job, 0)?;
    study.slurm.run("scancel", &[&format!("{job}_0")])?;
    eprintln!("cancelled task 0, which was doing row {row}");
    Ok(())
}

/// Kills task 1 in the middle of a run, and lets Slurm start it again. Returns the row.
fn kill_and_requeue(study: &Watched<'_>, job: &str) -> Result<u32, String> {
    let (row, process) = study.doing(job, 1)?;
    let killed = Command::new("kill").args(["-KILL", &process.to_string()]).status();
    if !killed.is_ok_and(|status| status.success()) {
        return Err(format!("process {process} could not be killed"));
    }
    eprintln!("killed task 1, which was doing row {row}");
    let task = format!("{job}_1");
    study.wait("the end of the killed task", |_| {
        Ok((!study.slurm.states(job)?.iter().any(|(known, state)| *known == task && state == "RUNNING")).then_some(()))
    })?;
    study.slurm.run("scontrol", &["requeue", &task])?;
    Ok(row)
}

/// The logs of a study's tasks.
fn logs(cluster: &Path) -> Result<Vec<String>, String> {
    let logs = fs::read_dir(cluster.join("logs")).map_err(|error| format!("logs: {error}"))?;
    let read = |path: PathBuf| fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()));
    logs.flatten().map(|log| read(log.path())).collect()
}

/// Checks in the logs that no run was done twice, and that each was done, but for the one during
/// which a task was killed: that may have ended before its line was written.
fn once(logs: &[String], alone: &Path, killed: Option<u32>) -> Result<(), String> {
    let mut done = BTreeMap::<u32, usize>::new();
    for line in logs.iter().flat_map(|log| log.lines()) {
        if let Some(row) = line.strip_prefix("row ").and_then(|line| line.split(' ').next()?.parse().ok()) {
            *done.entry(row).or_default() += 1;
        }
    }
    let table = fs::read_to_string(alone.join("runs.csv")).map_err(|error| format!("runs.csv: {error}"))?;
    let rows = table.lines().count() as u32 - 1;
    if let Some((row, times)) = done.iter().find(|(_, times)| **times > 1) {
        return Err(format!("row {row} was done {times} times"));
    }
    if let Some(row) = (1..=rows).find(|row| !done.contains_key(row) && Some(*row) != killed) {
        return Err(format!("no task says that it did row {row}"));
    }
    // The cancelled task stops; the killed one cannot say so.
    let stopped = logs.iter().map(|log| log.matches("stopped after ").count()).sum::<usize>();
    if (stopped, logs.len()) != (1, TASKS as usize) {
        return Err(format!("{} tasks have logs, and {stopped} say that they stopped", logs.len()));
    }
    eprintln!("{rows} runs by {TASKS} tasks, each done once");
    Ok(())
}

/// Checks in the logs that a run went on from a checkpoint, as that of the cancelled task must.
fn resumed(logs: &[String]) -> Result<(), String> {
    let mut lines = logs.iter().flat_map(|log| log.lines());
    let line = lines.find(|line| line.contains("goes on from its checkpoint at step "));
    eprintln!("{}", line.ok_or("no task says that a run went on from its checkpoint")?);
    Ok(())
}

/// The words of a command, for messages.
fn line(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
}

/// Runs a command and returns its standard output. Its standard error is part of an error.
fn output(command: &mut Command) -> Result<String, String> {
    let words = line(command);
    let ended = command.stdin(Stdio::null()).output().map_err(|error| format!("{words}: {error}"))?;
    match ended.status.success() {
        true => Ok(String::from_utf8_lossy(&ended.stdout).into_owned()),
        false => Err(format!("{words}: {}: {}", ended.status, String::from_utf8_lossy(&ended.stderr).trim())),
    }
}
