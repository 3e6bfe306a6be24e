//! The flags of `gs study`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use gs_lab::study::Selection;

use crate::{
    files::output_folder::OverwriteArgs,
    flags::{
        backend::BackendArgs,
        cluster::{SlurmArgs, WorkerArgs},
        values::whole,
    },
};

const AFTER_HELP: &str = concat!(
    "\
A study is arms (settings that differ) x images or 3D scenes x budgets x seeds, in a TOML file; \
these come with the program:
  set-up (or: paper)       the paper's experiment, its two criteria one by one, and no growth; \
needs no file, as the next five
  cold-start               small Gaussians on the border, and the cure
  lazy-convergence         the absolute threshold, forced growth and the hybrid
  thresholds               the threshold that works on targets of other contrast and frequency
  instability              the cost of the paper's clamp of scales at 1 px
  edges                    hard edges and soft ones, with growth and without
  absolute-vs-percentile   growth above a threshold or by rank, on images of the Kodak test set \
(--data)
  all-policies             every policy with its source's numbers, on the same images
  accuracy-in-training     what accuracy costs and buys in training: cuts, lists, steps, rounds, \
losses; on the same images
  density-in-3d            every policy for 3D scenes, at equal count, on lego, room, banana and \
lund_door (--data)
  init-by-density          start x policy, a factorial design, on room, banana and lund_door
  accuracy-in-3d-training  what approximations cost and buy in training 3D scenes
  start-without-sfm        start x wrong poses x refinement of poses: what COLMAP's points and poses buy; \
on six data sets
  defaults                 the presets of gs train, on eight data sets; a dozen CPU hours

The images of a study are files, or these synthetic targets:
  paper                    the paper's circle and square; in 8 bits a channel: paper-8bit
  paper-64px, paper-256px; paper-contrast-50, -25, -10; paper-soft-4px; paper-stripes-20px, -10px, \
-5px
  thin-lines, thin-lines-24px

A study file; preset, iterations and settings may be given for all arms or for one arm:

",
    include_str!("example.toml"),
    "
A study of 3D scenes has scenes in place of images: data sets as gs train reads them, in --data or \
beside the file. Its arms may also have start, as gs train --start. With like-gs-train = true they \
have the number of Gaussians and the start that gs train chooses for their preset, and \
pose-error = { degrees = 0.5, percent = 0.5 } makes the camera poses wrong; align-poses = true at the \
top of the file then measures right halves of held-out views, with cameras aligned to the left \
halves. All keys of a training's settings.toml go under settings. Factors expand into arms, one for each combination of their levels:

",
    include_str!("example-3d.toml"),
    "
--images, --scenes, --budgets, --seeds and --arms run a part of a study. Parts of a study add up in one \
folder: run another part, or the whole, into it with --resume, and only new runs are computed. \
Tables and report cover the part of the last command.

DIR then holds:
  report.html             which arm is better where, with intervals, curves, pictures and all \
settings; needs no network
  quality.csv             each arm at each budget: mean over images, spread over seeds
  differences.csv         every two arms: paired differences with 95 % intervals, and better, \
worse, can't tell (0 is in the interval) or no verdict (there is no interval, and a remark says why)
  runs.csv                one row per run
  views.csv               of scenes: the quality of each run on each held-out view
  effects.csv             of factors: main effects and interactions of two, with intervals
  claims.csv              of claims: verdicts, with how often each condition holds, and numbers
  times.csv, *-at-time.csv   the tables that depend on time
  plots/                  the report's curves as SVG
  study.toml, machine.json   the study, and the machine that ran it
  runs/, pictures/        the stored runs, each with its settings, and claims on runs that are under way

Several processes may work on one study, also on several machines that share DIR: see gs study work.

Each finished run is stored, so --resume does not repeat it, whatever has stopped the program. \
Tables do not depend on interruptions, --jobs and --threads; times are comparable with --jobs 1 on \
a quiet machine. On a machine that others use, too, write clock = \"cpu\" above the arms: times are \
then CPU time of the process, which does one run at a time."
);

/// The flags of `gs study`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct StudyArgs {
    #[command(subcommand)]
    pub(crate) action: Option<StudyAction>,
    #[command(flatten)]
    pub(crate) conduct: ConductArgs,
}

/// Other actions with a study, in the order in which they are used.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum StudyAction {
    /// Make the folder of a study, for gs study work
    Prepare(PrepareArgs),
    /// Do runs of the study in a folder, with any number of other processes and machines
    Work(WorkArgs),
    /// Make the folder of a study, and hand it to Slurm as an array of jobs
    Submit(SubmitArgs),
    /// Show how many runs of the study in a folder have ended, and who is doing others
    Status(HeldStudyArgs),
    /// Write tables and report of the runs that have ended so far
    Report(ReportArgs),
}

/// A study to run.
#[derive(Debug, Clone, Args)]
pub(crate) struct ConductArgs {
    #[command(flatten)]
    pub(crate) study: PrepareArgs,
    /// Runs in parallel, each with its share of the threads; the tables do not depend on it
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = whole::<u16>(1..=256))]
    pub(crate) jobs: u16,
}

/// A study, and the folder for its results.
#[derive(Debug, Clone, Args)]
pub(crate) struct PrepareArgs {
    /// The study: a TOML file, or the name of one that comes with the program
    #[arg(required = true)]
    pub(crate) study: Option<PathBuf>,
    /// Folder for the results; made if necessary [default: gs-out/NAME]
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    /// Folder of the images or data sets [default: $GS_DATA, or that of the study's file]
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,
    /// Continue the study in DIR; finished runs are not repeated
    #[arg(long)]
    pub(crate) resume: bool,
    #[command(flatten)]
    pub(crate) part: PartArgs,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

/// The part of a study to run.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Part of the study")]
pub(crate) struct PartArgs {
    /// Images of the study to run, by name or file name [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) images: Vec<String>,
    /// Scenes of the study to run, by name or folder name [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// Budgets of the study to run [default: all]
    #[arg(long, value_name = "COUNTS", value_delimiter = ',', value_parser = whole::<u32>(1..))]
    pub(crate) budgets: Vec<u32>,
    /// Seeds of the study to run [default: all]
    #[arg(long, value_name = "SEEDS", value_delimiter = ',', value_parser = whole::<u32>(0..))]
    pub(crate) seeds: Vec<u32>,
    /// Arms of the study to run [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) arms: Vec<String>,
}

impl PartArgs {
    /// The selection of the library.
    pub(crate) fn selection(&self) -> Selection {
        let Self { images, scenes, budgets, seeds, arms } = self.clone();
        Selection { images, scenes, budgets, seeds, arms }
    }
}

/// The study in a folder.
#[derive(Debug, Clone, Args)]
pub(crate) struct HeldStudyArgs {
    /// The folder of the study
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
    /// Folder of the images or data sets [default: $GS_DATA, or where the study found them]
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,
}

/// A study to take part in.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
The backend and the SIMD level are those that the study was prepared with, on all machines.

A run is done by one process, which claims it. SIGTERM and Ctrl-C give its runs back at once; after \
SIGKILL or a crash, another process takes them over when the claim is older than the lease, by the \
clock of the file server. Either way it goes on from the run's checkpoint, which a run stores every \
quarter of a lease and when it is stopped. The process leaves when no run is left, or when all that are left have \
been with others for one lease. Exit status 0 means that, not that the study is complete: gs study \
status shows it.")]
pub(crate) struct WorkArgs {
    #[command(flatten)]
    pub(crate) study: HeldStudyArgs,
    #[command(flatten)]
    pub(crate) worker: WorkerArgs,
    /// Runs in parallel, each with its share of the threads; the tables do not depend on it
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = whole::<u16>(1..=256))]
    pub(crate) jobs: u16,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

/// A study to hand to Slurm.
#[derive(Debug, Clone, Args)]
pub(crate) struct SubmitArgs {
    #[command(flatten)]
    pub(crate) study: PrepareArgs,
    #[command(flatten)]
    pub(crate) slurm: SlurmArgs,
    /// Runs in parallel in each task
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = whole::<u16>(1..=256))]
    pub(crate) jobs: u16,
}

/// A study to report on.
#[derive(Debug, Clone, Args)]
pub(crate) struct ReportArgs {
    #[command(flatten)]
    pub(crate) study: HeldStudyArgs,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
}

#[cfg(test)]
mod tests {
    use gs_lab::{Places, Plan, Study};

    use super::*;

    const EXAMPLE: &str = include_str!("example.toml");
    const EXAMPLE_3D: &str = include_str!("example-3d.toml");

    #[test]
    fn the_example_in_the_help_is_a_study_that_can_be_run() {
        assert!(AFTER_HELP.contains(EXAMPLE));
        let study = Study::from_toml(EXAMPLE, "example.toml").unwrap();
        assert_eq!(study.arms.len(), 2);
        // The image of the example does not exist.
        let part = Selection { images: vec!["paper".to_owned()], ..Selection::default() };
        assert_eq!(Plan::new(study.select(&part).unwrap(), &Places::default(), "test").unwrap().runs.len(), 20);
    }

    #[test]
    fn the_example_in_3d_is_a_study_whose_factors_expand() {
        assert!(AFTER_HELP.contains(EXAMPLE_3D));
        let study = Study::from_toml(EXAMPLE_3D, "example-3d.toml").unwrap();
        assert_eq!((study.arms.len(), study.runs()), (4, 64));
    }

    #[test]
    fn the_examples_fit_into_60_columns() {
        let longest = EXAMPLE.lines().chain(EXAMPLE_3D.lines()).map(str::len).max();
        assert!(longest <= Some(58), "{longest:?}");
    }

    #[test]
    fn the_help_names_all_studies_and_synthetic_targets() {
        for (name, _) in gs_lab::study::BUILT_IN {
            assert!(AFTER_HELP.contains(&format!("\n  {name} ")), "{name}");
        }
        let study = EXAMPLE.replace("1.png", "papr");
        let unknown = Plan::new(Study::from_toml(&study, "x.toml").unwrap(), &Places::default(), "test");
        let Err(gs_lab::Error::NoTarget { known, .. }) = unknown else { panic!("{unknown:?}") };
        for target in known.split(", ") {
            // Names that differ only in their ends are listed as the first name and further ends.
            let (start, end) = target.rsplit_once('-').unwrap_or((target, ""));
            let is_there =
                AFTER_HELP.contains(target) || AFTER_HELP.contains(start) && AFTER_HELP.contains(&format!(", -{end}"));
            assert!(is_there, "{target}");
        }
    }
}
