//! The test of `cargo xtask cluster`: studies and a scene in blocks on a Slurm cluster of this machine, with tasks
//! that are cancelled and killed, against the same jobs in one process.

mod slurm;

use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    thread,
    time::{Duration, Instant},
};

use self::slurm::Slurm;
use xtask::system::{at, built_example, built_program, entries, has_program, is_root, output, started, step};

/// Tasks of each array, as its command says.
const TASKS: usize = 4;

/// Longest time for a whole array.
const LIMIT: Duration = Duration::from_secs(300);

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

/// Commands of gs, in a folder with the data set `posed`, that do jobs on a cluster and in one process. NAME is
/// that of the case.
struct Kind {
    /// The last one submits the array.
    submit: &'static [&'static str],
    status: &'static str,
    /// Makes the results once all jobs have ended.
    end: &'static str,
    alone: &'static [&'static str],
    /// Files of `NAME.cluster` and `NAME.alone` that must be the same, byte for byte.
    results: &'static [&'static str],
}

const STUDY: Kind = Kind {
    submit: &["study submit NAME.toml -o NAME.cluster --array 4 --backend cpu"],
    status: "study status NAME.cluster",
    end: "study report NAME.cluster",
    alone: &["study NAME.toml -o NAME.alone --backend cpu --jobs 2"],
    results: &["runs.csv", "quality.csv", "differences.csv"],
};

/// Four blocks, each of which takes as long as a run of [`TRAININGS`].
const BLOCKS: Kind = Kind {
    submit: &[
        "train posed -o NAME.coarse --preset quick -i 1000 -n 60 --backend cpu",
        "blocks prepare posed -o NAME.cluster --blocks 2x2 --model NAME.coarse --preset quick -i 60000 -n 120 --backend cpu",
        "blocks submit NAME.cluster --array 4",
    ],
    status: "blocks status NAME.cluster",
    end: "blocks merge NAME.cluster",
    alone: &[
        "blocks prepare posed -o NAME.alone --blocks 2x2 --model NAME.coarse --preset quick -i 60000 -n 120 --backend cpu",
        "blocks work NAME.alone",
        "blocks merge NAME.alone",
    ],
    results: &["scene.ply", "evaluation.json"],
};

/// Jobs that are done twice.
struct Case {
    name: &'static str,
    kind: Kind,
    /// Content of `NAME.toml`.
    text: &'static str,
    /// Jobs that must have ended before a task is cancelled.
    ended: usize,
    /// Whether another task is killed and requeued; there must be enough jobs for that.
    kills: bool,
    /// Whether the job of the cancelled task must go on from its checkpoint. Jobs must take long
    /// enough for that.
    resumes: bool,
}

const CASES: [Case; 3] = [
    Case { name: "fits", kind: STUDY, text: FITS, ended: 6, kills: true, resumes: false },
    Case { name: "trainings", kind: STUDY, text: TRAININGS, ended: 0, kills: false, resumes: true },
    Case { name: "city", kind: BLOCKS, text: "", ended: 0, kills: true, resumes: true },
];

fn main() -> ExitCode {
    started(|_| run())
}

/// Does all cases on a cluster and in one process, and compares them.
fn run() -> Result<(), String> {
    if let Some(missing) = slurm::PROGRAMS.iter().find(|program| !has_program(program)) {
        let how = if is_root() { "cargo xtask cluster --install" } else { "cargo xtask cluster --install, as root" };
        eprintln!("skipped: there is no {missing}: jobs on a cluster; install Slurm with {how}");
        return Ok(());
    }
    let (gs, posed_images) = (built_program()?, built_example("posed_images")?);
    let place = env::temp_dir().join(format!("gs-cluster-{}", std::process::id()));
    fs::create_dir(&place).map_err(at(&place))?;
    step(Command::new(posed_images).arg(place.join("posed")))?;
    let started = Instant::now();
    let checked = Slurm::start(&place)
        .and_then(|slurm| CASES.iter().try_for_each(|case| check(&Watched { case, gs: &gs, slurm: &slurm }, &place)));
    match &checked {
        Ok(()) => {
            eprintln!("the results are the same on the cluster and in one process; {:.0?}", started.elapsed());
            let _ = fs::remove_dir_all(&place);
        }
        Err(_) => eprintln!("everything is left in {}", place.display()),
    }
    checked
}

/// Does the jobs twice and compares the results.
fn check(jobs: &Watched<'_>, place: &Path) -> Result<(), String> {
    let Case { name, kind, text, ended, kills, resumes } = jobs.case;
    let [file, cluster, alone] = ["toml", "cluster", "alone"].map(|end| place.join(format!("{name}.{end}")));
    fs::write(&file, text).map_err(at(&file))?;
    let said = jobs.all(kind.submit)?;
    let job = said.split_once("Submitted batch job ").and_then(|(_, rest)| rest.split(';').next());
    let job = job.ok_or_else(|| format!("no job was submitted: {said}"))?.trim();
    eprintln!("{}", said.trim());
    cancel(jobs, job, *ended)?;
    let killed = if *kills { Some(kill_and_requeue(jobs, job)?) } else { None };
    jobs.wait("the end of the array", |_| Ok(jobs.slurm.states(job)?.is_empty().then_some(())))?;
    let status = jobs.all(&[kind.status])?;
    eprint!("{status}");
    jobs.all(&[kind.end])?;

    let started = Instant::now();
    jobs.all(kind.alone)?;
    eprintln!("one process: {:.0?}", started.elapsed());
    for result in kind.results {
        let read = |folder: &Path| fs::read(folder.join(result)).map_err(|error| format!("{result}: {error}"));
        if read(&cluster)? != read(&alone)? {
            return Err(format!("{result} is not the same in {} and {}", cluster.display(), alone.display()));
        }
    }
    let logs = logs(&cluster)?;
    let (_, count) = counts(&status).ok_or_else(|| format!("no number of jobs: {status}"))?;
    once(&logs, count, killed)?;
    if *resumes { resumed(&logs) } else { Ok(()) }
}

/// Jobs at work on the cluster.
struct Watched<'a> {
    case: &'a Case,
    gs: &'a Path,
    slurm: &'a Slurm,
}

impl Watched<'_> {
    /// Runs commands of gs, and returns what they print.
    fn all(&self, commands: &[&str]) -> Result<String, String> {
        let run = |line: &&str| self.slurm.command(self.gs, line.replace("NAME", self.case.name).split(' '));
        commands.iter().map(run).collect()
    }

    /// Waits until the state of the jobs, in the words of gs, gives a value.
    fn wait<T>(&self, what: &str, found: impl Fn(&str) -> Result<Option<T>, String>) -> Result<T, String> {
        let started = Instant::now();
        loop {
            let status = self.all(&[self.case.kind.status])?;
            if let Some(found) = found(&status)? {
                return Ok(found);
            }
            if started.elapsed() > LIMIT {
                return Err(format!("waited {LIMIT:?} for {what}: {status}"));
            }
            thread::sleep(Duration::from_millis(100));
        }
    }

    /// The number of a job that a task is doing, from 1, and the task's process.
    fn doing(&self, job: &str, task: u32) -> Result<(usize, u32), String> {
        let job = format!(", job {job}_{task}: last sign of life");
        self.wait(&format!("a job of task {task}"), |status| {
            let line = status.lines().find(|line| line.contains(&job));
            Ok(line.and_then(|line| {
                let process = line.split_once(", process ")?.1.split(',').next()?.parse().ok()?;
                Some((number(line)?, process))
            }))
        })
    }
}

/// The number of the job that a line is about: `row 3 …`, `block 3 …`.
fn number(line: &str) -> Option<usize> {
    line.strip_prefix("row ").or(line.strip_prefix("block "))?.split(' ').next()?.parse().ok()
}

/// How many jobs have ended, and of how many: `… 3 of 4 …`.
fn counts(status: &str) -> Option<(usize, usize)> {
    let (before, after) = status.split_once(" of ")?;
    Some((before.split(' ').next_back()?.parse().ok()?, after.split(' ').next()?.parse().ok()?))
}

/// Cancels task 0 in the middle of a job, once so many have ended.
fn cancel(jobs: &Watched<'_>, job: &str, ended: usize) -> Result<(), String> {
    jobs.wait("the first jobs", |status| Ok(counts(status).filter(|(known, _)| *known >= ended)))?;
    let (number, _) = jobs.doing(job, 0)?;
    jobs.slurm.run("scancel", &[&format!("{job}_0")])?;
    eprintln!("cancelled task 0, which was doing number {number}");
    Ok(())
}

/// Kills task 1 in the middle of a job, and lets Slurm start it again. Returns the job's number.
fn kill_and_requeue(jobs: &Watched<'_>, job: &str) -> Result<usize, String> {
    let (number, process) = jobs.doing(job, 1)?;
    output(Command::new("kill").args(["-KILL", &process.to_string()]))?;
    eprintln!("killed task 1, which was doing number {number}");
    let task = format!("{job}_1");
    jobs.wait("the end of the killed task", |_| {
        Ok((!jobs.slurm.states(job)?.iter().any(|(known, state)| *known == task && state == "RUNNING")).then_some(()))
    })?;
    jobs.slurm.run("scontrol", &["requeue", &task])?;
    Ok(number)
}

/// The logs of an array's tasks.
fn logs(cluster: &Path) -> Result<Vec<String>, String> {
    let read = |log: &PathBuf| fs::read_to_string(log).map_err(at(log));
    entries(&cluster.join("logs"))?.iter().map(read).collect()
}

/// Checks in the logs that no job was done twice, and that each was done, but for the one during
/// which a task was killed: that may have ended before its line was written.
fn once(logs: &[String], count: usize, killed: Option<usize>) -> Result<(), String> {
    let mut done = BTreeMap::<usize, usize>::new();
    // A line about the end of a job ends with its time.
    for line in logs.iter().flat_map(|log| log.lines()).filter(|line| line.ends_with(" s")) {
        number(line).into_iter().for_each(|number| *done.entry(number).or_default() += 1);
    }
    if let Some((number, times)) = done.iter().find(|(_, times)| **times > 1) {
        return Err(format!("number {number} was done {times} times"));
    }
    if let Some(number) = (1..=count).find(|number| !done.contains_key(number) && Some(*number) != killed) {
        return Err(format!("no task says that it did number {number}"));
    }
    // The cancelled task stops; the killed one cannot say so.
    let stopped = logs.iter().map(|log| log.matches("stopped after ").count()).sum::<usize>();
    if (stopped, logs.len()) != (1, TASKS) {
        return Err(format!("{} tasks have logs, and {stopped} say that they stopped", logs.len()));
    }
    eprintln!("{count} jobs by {TASKS} tasks, each done once");
    Ok(())
}

/// Checks in the logs that a job went on from a checkpoint, as that of the cancelled task must.
fn resumed(logs: &[String]) -> Result<(), String> {
    let mut lines = logs.iter().flat_map(|log| log.lines());
    let line = lines.find(|line| line.contains("goes on from its checkpoint at step "));
    eprintln!("{}", line.ok_or("no task says that a job went on from its checkpoint")?);
    Ok(())
}
