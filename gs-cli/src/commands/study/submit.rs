//! `gs study submit`: hands a study to Slurm as an array of jobs.

use std::{
    env, fs,
    io::ErrorKind,
    path::{Path, PathBuf},
    process::Command,
};

use gs_io::Inputs;

use super::{
    arguments::SubmitArgs,
    prepare::{Prepared, prepare},
};
use crate::{
    failure::Failure,
    files::output_folder::OutputFolder,
    terminal::output::{self, quoted},
};

/// The script in the study's folder.
pub(super) const SCRIPT: &str = "work.sbatch";
/// The folder of the tasks' logs in the study's folder.
const LOGS: &str = "logs";

/// Makes the folder of a study, writes the script, and submits it.
pub(super) fn run(args: &SubmitArgs) -> Result<(), Failure> {
    let Prepared { folder, backends, words, places, .. } = prepare(&args.study, 1)?;
    output::note(&backends[0].reason);
    let absolute = |path: &Path| fs::canonicalize(path).map_err(|error| Failure::failed(error).at(path.display()));
    let path = absolute(folder.path())?;
    let data = places.data.as_deref().map(absolute).transpose()?;
    let program = env::current_exe().map_err(|error| Failure::failed(error).at("the path of this program"))?;
    let script = script(args, &folder_name(&path), &path, data.as_deref(), &program);
    let claim = args.study.overwrite.claim(&path, [SCRIPT], Inputs::default());
    let output = OutputFolder::begin(claim)?;
    output.make(LOGS)?;
    output.write(SCRIPT, script)?;
    let script = path.join(SCRIPT);
    let submitted = Command::new("sbatch").arg(&script).output();
    let said = match submitted {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let hint =
                format_args!("submit {} where there is one, or run gs study work {}", script.display(), quoted(&path));
            return Err(Failure::failed("sbatch: there is no such program here").hint(hint));
        }
        Err(error) => return Err(Failure::failed(error).at("sbatch")),
        Ok(ended) if !ended.status.success() => {
            let message = String::from_utf8_lossy(&ended.stderr).into_owned();
            return Err(Failure::failed(message).hint(format_args!("the script is {}", script.display())));
        }
        Ok(ended) => String::from_utf8_lossy(&ended.stdout).trim().to_owned(),
    };
    output::result(format_args!("{words}: {said}; see gs study status {}", quoted(&path)))
}

fn folder_name(path: &Path) -> String {
    path.file_name().map_or_else(|| "study".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// The script of the array.
fn script(args: &SubmitArgs, name: &str, folder: &Path, data: Option<&Path>, program: &Path) -> String {
    let SubmitArgs { array, cpus, jobs, time, partition, options, .. } = args;
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
    let data = data.map_or_else(String::new, |data| format!(" --data {}", quoted(data)));
    let (program, folder) = (quoted(program), quoted(folder));
    format!(
        "#!/bin/sh\n{directives}\
        # exec, so that Slurm's signals reach gs, which then gives its runs back.\n\
        exec {program} study work {folder} --threads {cpus} --jobs {jobs}{data}\n"
    )
}
