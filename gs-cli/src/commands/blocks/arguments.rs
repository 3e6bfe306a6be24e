//! The flags of `gs blocks`.

use std::{num::NonZeroU32, path::PathBuf, str::FromStr};

use clap::{Args, Subcommand};
use gs_train::blocks::Grid;

use crate::{
    commands::train::TrainSettingsArgs,
    files::output_folder::OverwriteArgs,
    flags::{
        backend::BackendArgs,
        cluster::{SlurmArgs, WorkerArgs},
        dataset::{DatasetArgs, MaxSize},
        values::{bytes, whole},
    },
};

const AFTER_HELP: &str = "\
Blocks are trained in four steps:
  gs blocks prepare DATASET -o DIR
      train a coarse model of the whole, divide the ground into cells of equal work, and plan what each \
block trains, with which views
  gs blocks work DIR
      train blocks until none is left, in any number of processes on any number of machines; gs blocks \
submit does it by Slurm
  gs blocks status DIR
      show what is done, and by whom
  gs blocks merge DIR
      join the blocks to DIR/scene.ply, and evaluate it on the held-out views

DIR then contains:
  coarse/           the coarse model, as gs train writes it
  blocks.json       the plan
  map.svg           a map of the plan: cells and cameras, with views, Gaussians, memory and time of each block
  starts/, runs/, scenes/   what blocks begin with; records, claims and checkpoints; results
  scene.ply         the Gaussians of all blocks; gs convert makes other formats of it
  lod/              its levels of detail, a streamed SOG, with gs blocks merge --lod
  evaluation.json   its quality on the held-out views, by block, and near the edges of cells, if there is \
memory for the whole scene
  seams.png         the held-out view that shows most of the edges: image, rendering and difference, which \
is darker away from edges

The result has the same bits for any number of processes, in any order, whatever has interrupted them.";

/// The flags of `gs blocks`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct BlocksArgs {
    #[command(subcommand)]
    pub(crate) action: BlocksAction,
}

/// The actions, in the order in which they are used.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum BlocksAction {
    /// Train a coarse model, and plan the blocks
    Prepare(Box<PrepareArgs>),
    /// Train blocks of a folder, with any number of other processes and machines
    Work(WorkArgs),
    /// Hand the blocks of a folder to Slurm as an array of jobs
    Submit(SubmitArgs),
    /// Show which blocks have ended, and who is doing others
    Status(FolderArgs),
    /// Join the blocks to one scene, and evaluate it
    Merge(MergeArgs),
}

/// Blocks to plan.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
The settings describe one training of the whole scene. Each block has its share of the \
Gaussians, by the work in its cell and margin, and of the steps, by its views. The coarse model is \
trained with the same settings on smaller images, by default with the preset's number of Gaussians for \
such images; exposure and poses are corrected there alone, and depth maps are used there alone.")]
pub(crate) struct PrepareArgs {
    /// The data set of posed images
    pub(crate) dataset: PathBuf,
    /// Folder for the blocks and the results; made if necessary
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Columns and rows of cells, of equal work; columns are to the right, rows ahead. auto makes about
    /// as few blocks as --memory allows
    #[arg(long, value_name = "auto|MxN", default_value = "auto")]
    pub(crate) blocks: BlocksGrid,
    /// The most memory of a process that trains a block, such as 8G, for --blocks auto [default: three
    /// quarters of what is free on this machine]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub(crate) memory: Option<u64>,
    /// Width of the margin in which a block also trains, at each side of its cell, as a share of the cell's work
    #[arg(long, value_name = "SHARE", default_value_t = 0.2)]
    pub(crate) margin: f64,
    /// Least share of a view's blending weights for a block to use the view
    #[arg(long, value_name = "SHARE", default_value_t = 0.05)]
    pub(crate) threshold: f64,
    /// Longer side of the images of the coarse model, px
    #[arg(long, value_name = "PX", default_value = "400", value_parser = whole::<u32>(16..))]
    pub(crate) coarse_size: u32,
    /// The most Gaussians of the coarse model [default: that of the preset for its images]
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..))]
    pub(crate) coarse_gaussians: Option<u32>,
    /// A coarse model to use in place of a new one: the output folder of gs train for the same data set. Its
    /// checkpoint.safetensors has the poses and the exposure, if they were corrected
    #[arg(long, value_name = "DIR", conflicts_with_all = ["coarse_size", "coarse_gaussians", "start", "exposure",
        "refine_poses"])]
    pub(crate) model: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) images: DatasetArgs,
    #[command(flatten)]
    pub(crate) settings: TrainSettingsArgs,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

impl PrepareArgs {
    /// The size of the coarse model's images.
    pub(crate) fn coarse_max_size(&self) -> MaxSize {
        let whole = self.images.reading.max_size.0.map_or(u32::MAX, NonZeroU32::get);
        MaxSize(NonZeroU32::new(self.coarse_size.min(whole)))
    }
}

/// A number of columns and rows, written MxN, or auto.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BlocksGrid {
    Auto,
    Of(Grid),
}

impl FromStr for BlocksGrid {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let parsed = text.split_once('x').and_then(|(columns, rows)| {
            Some((columns.parse().ok().filter(|count| *count > 0)?, rows.parse().ok().filter(|count| *count > 0)?))
        });
        match parsed {
            Some((columns, rows)) if columns <= 1000 && rows <= 1000 => Ok(Self::Of(Grid { columns, rows })),
            _ => Err("write it as MxN, such as 4x4, each from 1 to 1000, or auto".to_owned()),
        }
    }
}

/// The folder of blocks.
#[derive(Debug, Clone, Args)]
pub(crate) struct FolderArgs {
    /// The folder of the blocks
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
}

/// Where the data set of blocks is.
#[derive(Debug, Clone, Args)]
pub(crate) struct DataArgs {
    /// The data set [default: where it was when the blocks were prepared]
    #[arg(long, value_name = "DATASET")]
    pub(crate) data: Option<PathBuf>,
}

/// Blocks to take part in.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
The backend and the SIMD level are those that the blocks were prepared with, on all machines.

A block is trained by one process, which claims it. SIGTERM and Ctrl-C give it back at once; after \
SIGKILL or a crash, another process takes it over when the claim is older than the lease, by the clock of \
the file server. Either way it goes on from the block's checkpoint, which is stored every quarter of a \
lease and when the process is stopped. The process leaves when no block is left, or when all that are left \
have been with others for one lease. Exit status 0 means that, not that all blocks are done: gs blocks \
status shows it.")]
pub(crate) struct WorkArgs {
    #[command(flatten)]
    pub(crate) folder: FolderArgs,
    #[command(flatten)]
    pub(crate) data: DataArgs,
    /// Also do blocks again that have failed
    #[arg(long)]
    pub(crate) retry: bool,
    #[command(flatten)]
    pub(crate) worker: WorkerArgs,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

/// Blocks to hand to Slurm.
#[derive(Debug, Clone, Args)]
pub(crate) struct SubmitArgs {
    #[command(flatten)]
    pub(crate) folder: FolderArgs,
    #[command(flatten)]
    pub(crate) data: DataArgs,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    #[command(flatten)]
    pub(crate) slurm: SlurmArgs,
}

/// Blocks to join.
#[derive(Debug, Clone, Args)]
pub(crate) struct MergeArgs {
    #[command(flatten)]
    pub(crate) folder: FolderArgs,
    #[command(flatten)]
    pub(crate) data: DataArgs,
    /// Also write levels of detail, a streamed SOG in DIR/lod, block by block
    #[arg(long, conflicts_with = "compare")]
    pub(crate) lod: bool,
    /// Evaluate another scene of the same place in the same way, and write nothing
    #[arg(long, value_name = "SCENE")]
    pub(crate) compare: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_are_two_counts() {
        assert_eq!("4x2".parse(), Ok(BlocksGrid::Of(Grid { columns: 4, rows: 2 })));
        assert_eq!("auto".parse(), Ok(BlocksGrid::Auto));
        for bad in ["", "4", "0x2", "2x0", "2x", "x2", "2x2x2", "1001x1", "-1x2", "2,2"] {
            assert!(bad.parse::<BlocksGrid>().is_err(), "{bad}");
        }
    }
}
