//! What commands that share jobs with other processes have in common: flags of workers, their log, and Slurm.

use std::{
    collections::BTreeMap,
    env, fs,
    io::ErrorKind,
    path::{Path, PathBuf},
    process::Command,
    sync::atomic::{AtomicUsize, Ordering},
    time::Duration,
};

use clap::Args;
use gs_core::counted;
use gs_io::FolderClaim;
use gs_jobs::{AtEnd, Shard, WorkSettings, slurm};
use gs_lab::run::{Conducted, Job, Watcher};

use super::values::whole;
use crate::{
    failure::Failure,
    files::output_folder::OutputFolder,
    terminal::{
        interrupt::{AT_NEXT_STEP, Interrupt},
        output::{self, quoted},
        progress_bar::Printer,
    },
};

/// The script in the folder of the jobs.
pub(crate) const SCRIPT: &str = "work.sbatch";
/// The folder of the tasks' logs in the folder of the jobs.
const LOGS: &str = "logs";

/// How a process takes part in jobs that others do, too.
#[derive(Debug, Clone, Args)]
pub(crate) struct WorkerArgs {
    /// Begin with part I (from 0) of N, then help with the others; with more than fifty processes,
    /// give each its own [default: the task of a Slurm array, or none]
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub(crate) shard: Option<Shard>,
    /// Seconds without a sign of life after which others take over this process' runs
    #[arg(long, value_name = "S", default_value_t = 120, value_parser = whole::<u32>(1..=86_400))]
    pub(crate) lease: u32,
}

impl WorkerArgs {
    /// The settings of the library.
    pub(crate) fn settings(&self) -> WorkSettings {
        WorkSettings::default().with(|s| {
            s.shard = self.shard.or_else(slurm::shard);
            s.lease = Duration::from_secs(self.lease.into());
            s.at_end = AtEnd::Leave;
            s.worker.extend(slurm::task().map(|task| format!(", job {task}")));
        })
    }
}

/// A part of the jobs, written I/N.
fn shard(text: &str) -> Result<Shard, String> {
    let parsed = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
    match parsed {
        Some((index, count)) if index < count => Ok(Shard { index, count }),
        Some((index, count)) => Err(format!("parts are counted from 0: {index} is not less than {count}")),
        None => Err("write it as I/N, such as 0/4".to_owned()),
    }
}

/// Prints a line for each job that this process does, as for the log of a task.
pub(crate) struct WorkLog<'a, J> {
    /// A job, in words.
    name: &'a (dyn Fn(&J) -> String + Sync),
    interrupt: Interrupt,
    done: AtomicUsize,
}

impl<'a, J: Job> WorkLog<'a, J> {
    /// Begins to listen to signals.
    pub(crate) fn begin(name: &'a (dyn Fn(&J) -> String + Sync)) -> Self {
        Self { name, interrupt: Interrupt::listen(Printer::above(None), AT_NEXT_STEP), done: AtomicUsize::new(0) }
    }

    /// Says how the work in a folder has ended. A `job` is done by `gs COMMAND work`; `then` is what follows the last.
    pub(crate) fn end(
        self,
        conducted: Conducted,
        [job, command, then]: [&str; 3],
        folder: &Path,
    ) -> Result<(), Failure> {
        let (done, folder) = (counted(self.done.into_inner(), job), quoted(folder));
        match conducted {
            Conducted::Stopped => {
                Err(Failure::interrupted(format_args!("stopped after {done}; to go on: gs {command} work {folder}")))
            }
            Conducted::Whole => output::result(format_args!("{done} done, none is left; {then} {folder}")),
            _ => output::result(format_args!(
                "{done} done, the others are with other processes; see gs {command} status {folder}"
            )),
        }
    }
}

impl<J: Job> Watcher<J> for WorkLog<'_, J> {
    fn begun(&self, job: &J) {
        output::note(format_args!("note: {} begins", (self.name)(job)));
    }

    fn resumed(&self, job: &J, step: u32) {
        output::note(format_args!("note: {} goes on from its checkpoint at step {step}", (self.name)(job)));
    }

    fn warned(&self, job: &J, message: &str) {
        output::note(format_args!("note: {}: {message}", (self.name)(job)));
    }

    fn ended(&self, job: &J, outcome: &J::Outcome) {
        self.done.fetch_add(1, Ordering::Relaxed);
        output::note(format_args!("{}: {outcome}", (self.name)(job)));
    }

    fn wants_stop(&self) -> bool {
        self.interrupt.requested()
    }
}

/// Heading of the flags that sbatch takes.
const SLURM: &str = "Slurm";

/// Jobs to hand to Slurm.
#[derive(Debug, Clone, Args)]
pub(crate) struct SlurmArgs {
    /// Number of tasks; each does runs until none is left
    #[arg(long, help_heading = SLURM, value_name = "N", value_parser = whole::<u32>(1..=1_000_000))]
    pub(crate) array: u32,
    /// Cores of each task
    #[arg(long, help_heading = SLURM, value_name = "CORES", default_value_t = 1, value_parser = whole::<u16>(1..=1024))]
    pub(crate) cpus: u16,
    /// Time limit of each task, as sbatch takes it: 90 (minutes), 12:00:00, 2-00
    #[arg(long, help_heading = SLURM, value_name = "TIME", value_parser = word)]
    pub(crate) time: Option<String>,
    /// Partition of the cluster
    #[arg(long, help_heading = SLURM, value_name = "NAME", value_parser = word)]
    pub(crate) partition: Option<String>,
    /// Further options of sbatch, such as --account=physics --gres=gpu:1
    #[arg(last = true, help_heading = SLURM, value_name = "OPTION", value_parser = word)]
    pub(crate) options: Vec<String>,
}

/// A value that is one word of a script.
fn word(text: &str) -> Result<String, String> {
    let is_word = !text.is_empty() && text.chars().all(|c| c.is_ascii_graphic() && !"\"'`$\\#;&|<>".contains(c));
    if is_word { Ok(text.to_owned()) } else { Err("must be one word without quotes and signs of the shell".to_owned()) }
}

impl SlurmArgs {
    /// Writes the script of an array of tasks that run `gs COMMAND FOLDER FLAGS`, and submits it; returns what sbatch
    /// said. The claim is to [`SCRIPT`] in the folder, which is absolute.
    pub(crate) fn submit(&self, claim: FolderClaim, command: &str, flags: &str) -> Result<String, Failure> {
        let path = claim.path.clone();
        let program = env::current_exe().map_err(|error| Failure::failed(error).at("the path of this program"))?;
        let output = OutputFolder::begin(claim)?;
        output.make(LOGS)?;
        output.write(SCRIPT, self.script(&path, &program, command, flags))?;
        let script = path.join(SCRIPT);
        match Command::new("sbatch").arg(&script).output() {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let hint = format_args!(
                    "submit {} where there is one, or run gs {command} {}",
                    script.display(),
                    quoted(&path)
                );
                Err(Failure::failed("sbatch: there is no such program here").hint(hint))
            }
            Err(error) => Err(Failure::failed(error).at("sbatch")),
            Ok(ended) if !ended.status.success() => {
                let message = String::from_utf8_lossy(&ended.stderr).into_owned();
                Err(Failure::failed(message).hint(format_args!("the script is {}", script.display())))
            }
            Ok(ended) => Ok(String::from_utf8_lossy(&ended.stdout).trim().to_owned()),
        }
    }

    /// The script of the array.
    fn script(&self, folder: &Path, program: &Path, command: &str, flags: &str) -> String {
        let Self { array, cpus, time, partition, options } = self;
        let name = folder.file_name().map_or_else(|| "jobs".into(), |name| name.to_string_lossy());
        // Slurm replaces % and a letter in names of logs.
        let logs: PathBuf = folder.join(LOGS);
        let logs = logs.display().to_string().replace('%', "%%");
        let mut lines = vec![
            format!("--job-name=\"gs-{name}\""),
            format!("--array=0-{}", array - 1),
            format!("--cpus-per-task={cpus}"),
            format!("--output=\"{logs}/%A_%a.log\""),
            "--open-mode=append".to_owned(),
            "--requeue".to_owned(),
        ];
        lines.extend(time.iter().map(|time| format!("--time={time}")));
        lines.extend(partition.iter().map(|partition| format!("--partition={partition}")));
        lines.extend(options.iter().cloned());
        let directives: String = lines.iter().map(|line| format!("#SBATCH {line}\n")).collect();
        let (program, folder) = (quoted(program), quoted(folder));
        format!(
            "#!/bin/sh\n{directives}\
            # exec, so that Slurm's signals reach gs, which then gives its runs back.\n\
            exec {program} {command} {folder} --threads {cpus}{flags}\n"
        )
    }
}

/// An absolute path.
pub(crate) fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    fs::canonicalize(path).map_err(|error| Failure::failed(error).at(path.display()))
}

/// Prints the tasks of a folder's jobs that Slurm knows, by their states, where there is Slurm. `what` are the jobs.
pub(crate) fn print_slurm_states(folder: &Path, what: &str) -> Result<(), Failure> {
    slurm_states(folder, what).map_or(Ok(()), |states| output::result(format_args!("Slurm: {states}")))
}

fn slurm_states(folder: &Path, what: &str) -> Option<String> {
    let script = fs::canonicalize(folder.join(SCRIPT)).ok()?;
    let listed = Command::new("squeue").args(["--noheader", "--array", "--format=%T %o"]).output().ok()?;
    if !listed.status.success() {
        return Some(String::from_utf8_lossy(&listed.stderr).trim().to_owned());
    }
    let mut states = BTreeMap::<String, usize>::new();
    for line in String::from_utf8_lossy(&listed.stdout).lines() {
        if let Some((state, command)) = line.split_once(' ')
            && Path::new(command.trim()) == script
        {
            *states.entry(state.to_lowercase()).or_default() += 1;
        }
    }
    let states: Vec<String> =
        states.into_iter().map(|(state, tasks)| format!("{} {state}", counted(tasks, "task"))).collect();
    Some(if states.is_empty() { format!("no task of the {what}") } else { states.join(", ") })
}
