//! `gs blocks prepare`: the coarse model, and the plan.

use std::{
    collections::BTreeMap,
    fmt::Display,
    fs,
    path::{Path, PathBuf},
};

use gs_backend::FutureExt as _;
use gs_core::{Error as CoreError, Scene as _, counted, duration, effects::Antialias, memory::amount};
use gs_io::{Inputs, read_checkpoint};
use gs_lab::{
    blocks::{BlocksFolder, BlocksOrigin, map},
    study::Machine,
};
use gs_train::{
    Error as TrainError,
    blocks::{BlocksPlan, BlocksSettings, Grid, settle},
    train::Views,
};

use super::{
    arguments::{BlocksGrid, PrepareArgs},
    folder_and_views::IMAGE_MEMORY,
};
use crate::{
    commands::train::{self, TrainArgs, TrainSettingsArgs},
    failure::Failure,
    files::{
        output_folder::{self, OutputFolder},
        scene,
    },
    flags::{
        cluster::absolute,
        dataset::{DatasetArgs, ReadingArgs},
    },
    memory,
    terminal::output::{self, quoted},
    training::arguments::RunArgs,
};

const MAP: &str = "map.svg";
const COARSE: &str = "coarse";
const CHECKPOINT: &str = "checkpoint.safetensors";
const SUMMARY: &str = "summary.json";

/// Seconds of a trial of the speed of training.
const TRIAL: f64 = 5.0;

/// Trains the coarse model, and plans the blocks.
pub(super) fn run(args: &PrepareArgs) -> Result<(), Failure> {
    if args.settings.minutes.is_some() {
        let message = "--minutes: blocks have no time limit, as any number of processes do them";
        return Err(Failure::usage(message).hint("use --iterations"));
    }
    if args.settings.exactly {
        let message = "--exactly: the margins of blocks are left out of the result, so their counts are not exact";
        return Err(Failure::usage(message).hint("leave it out"));
    }
    BlocksFolder::refuse_existing(&args.output)?;
    let mut claim = args.overwrite.claim(&args.output, [MAP], Inputs::from_iter([&args.dataset]));
    claim.folders.extend(BlocksFolder::FOLDERS.map(str::to_owned));
    output_folder::check(&claim)?;
    let dataset = args.images.read(&args.dataset)?;
    let mut settings = train::settings(&args.settings, &dataset)?;
    let (grid, most) = first_grid(args)?;
    let division = BlocksSettings { grid, margin: args.margin, threshold: args.threshold };
    division.validate().map_err(Failure::usage)?;
    let coarse = match &args.model {
        Some(model) if model.is_file() => {
            let message = format!("--model: {} is a file", model.display());
            return Err(Failure::usage(message).hint("name the output folder of gs train that it is in"));
        }
        Some(model) => model.clone(),
        None => train_coarse(args)?,
    };
    let mut model = scene::read_3d(&coarse)?;
    if args.settings.antialias.is_none() && args.settings.settings.is_none() {
        settings.render.effects.antialias = model.trained_with.antialias.unwrap_or(Antialias::Dilate);
    }
    model.scene = model.scene.with_degree(settings.render.effects.sh_degree);
    let dataset = args.images.read_for(&model, &args.dataset)?;
    let mut views = Views { keep_bytes: IMAGE_MEMORY, ..Views::of_dataset(&dataset) };
    let checkpoint = coarse.join(CHECKPOINT);
    let metadata = match checkpoint.is_file() {
        true => read_checkpoint(&checkpoint)?.metadata,
        false => {
            refuse_unsettled(&coarse)?;
            BTreeMap::new()
        }
    };
    let settled = settle(&mut views, &metadata).map_err(|error| Failure::from(error).at(checkpoint.display()))?;
    let backend = args.backend.open()?;
    output::note(&backend.reason);
    let output = OutputFolder::begin(claim)?;
    let origin = BlocksOrigin {
        machine: Machine::of(&backend.rasterizer),
        dataset: absolute(&args.dataset)?,
        reading: serde_json::to_value(&args.images).map_err(Failure::failed)?,
        frame: dataset.frame,
    };
    let mut preparing = BlocksFolder::prepare(&args.output, &settings.render, &origin)?;
    let plan = divided(division, most, |division| {
        let store = |block: usize, scene: &_| Ok(preparing.store(block, scene)?);
        let (settled, settings) = (settled.clone(), settings.clone());
        BlocksPlan::new(&backend.rasterizer, &model.scene, &views, settled, settings, division, store).block_on()
    });
    let plan = plan.inspect_err(|_| preparing.abandon())?;
    // This map has no times. It stays if the trial is stopped, when the folder is already complete.
    let drawn = output.write(MAP, map(&plan, views.train_cameras(), &[]));
    drawn.inspect_err(|_| preparing.abandon())?;
    let folder = preparing.finish(origin, plan)?;
    let seconds = folder.expected_seconds(&backend.rasterizer, &views, TRIAL).block_on().unwrap_or_else(|error| {
        output::note(format_args!("note: how long the blocks take is not known: a trial failed ({error})"));
        Vec::new()
    });
    output.write(MAP, map(folder.plan(), views.train_cameras(), &seconds))?;
    summary(&folder, model.scene.len(), views.train.len(), &seconds)
}

/// The grid to try first, and the memory that a block may take, if the grid is to follow from it.
fn first_grid(args: &PrepareArgs) -> Result<(Grid, Option<u64>), Failure> {
    match (args.blocks, args.memory) {
        (BlocksGrid::Of(_), Some(_)) => Err(Failure::usage("--memory is for --blocks auto: leave out one of the two")),
        (BlocksGrid::Of(grid), None) => Ok((grid, None)),
        (BlocksGrid::Auto, memory) => {
            let unknown = || Failure::usage("--memory: this system does not say how much memory there is");
            let most = memory
                .or_else(|| Some(memory::room()? / 4 * 3))
                .ok_or_else(|| unknown().hint("set it, such as --memory 8G"))?;
            Ok((Grid { columns: 1, rows: 1 }, Some(most)))
        }
    }
}

/// Plans a division, or more and more blocks until each of them takes at most this much memory.
fn divided(
    mut division: BlocksSettings,
    most: Option<u64>,
    mut plan: impl FnMut(BlocksSettings) -> Result<BlocksPlan, TrainError>,
) -> Result<BlocksPlan, Failure> {
    // What the smallest division so far needs, and how many in a row need more.
    let (mut least, mut takes, mut in_vain) = (u64::MAX, String::new(), 0);
    loop {
        let Grid { columns, rows } = division.grid;
        let tried = plan(division);
        let refused = |why: &dyn Display| {
            let message = format!("--memory {}: {takes}, and {why}", amount(most.unwrap_or_default()));
            Failure::failed(message).hint("allow more, or reduce --max-size or --coarse-gaussians")
        };
        let tried = match tried {
            // The scene cannot be divided so far.
            Err(TrainError::Core(error @ CoreError::Setting { .. })) if least < u64::MAX => {
                return Err(refused(&format_args!("there cannot be more ({error})")));
            }
            tried => tried?,
        };
        let needed = tried.blocks.iter().map(|block| block.memory).max().unwrap_or_default();
        let Some(most) = most.filter(|most| needed > *most) else { return Ok(tried) };
        in_vain = if needed < least { 0 } else { in_vain + 1 };
        if in_vain == 2 {
            return Err(refused(&"more blocks do not take less"));
        }
        if needed < least {
            takes = format!("in {columns}x{rows} blocks, a block takes about {} of memory", amount(needed));
            output::note(&takes);
            least = needed;
        }
        // As many as would be enough if all of the memory could be divided.
        let enough = (f64::from(columns * rows) * needed as f64 / most as f64).ceil() as u32;
        let count = enough.clamp(columns * rows + 1, 4 * columns * rows);
        let columns = f64::from(count).sqrt().ceil() as u32;
        division.grid = Grid { columns, rows: count.div_ceil(columns) };
    }
}

/// Fails for a model without a checkpoint whose summary says that poses or exposure were corrected, and for a scene
/// that was merged of such blocks.
fn refuse_unsettled(model: &Path) -> Result<(), Failure> {
    let is_merged = BlocksFolder::refuse_existing(model).is_err();
    if let Some(view) = is_merged.then(|| BlocksFolder::open(model)).transpose()?.and_then(corrected) {
        let message = format!("--model: the pose or the exposure of {view} was corrected for these blocks");
        return Err(Failure::usage(message).hint("name their coarse model, or leave out --model"));
    }
    let path = model.join(SUMMARY);
    let Ok(text) = fs::read(&path) else { return Ok(()) };
    let summary: serde_json::Value =
        serde_json::from_slice(&text).map_err(|error| Failure::failed(error).at(path.display()))?;
    for what in ["poses", "exposure"] {
        if summary[what]["used"] == true {
            let message = format!("--model: {what} were corrected for this scene, and only its checkpoint has them");
            let hint = format!("train it with --checkpoint {}", quoted(&model.join(CHECKPOINT)));
            return Err(Failure::usage(message).hint(hint));
        }
    }
    Ok(())
}

/// The name of the first view whose pose or exposure was corrected.
fn corrected(folder: BlocksFolder) -> Option<String> {
    folder.plan().first_corrected().cloned()
}

/// Trains the coarse model, and returns its folder.
fn train_coarse(args: &PrepareArgs) -> Result<PathBuf, Failure> {
    let folder = args.output.join(COARSE);
    fs::create_dir_all(&folder).map_err(|error| Failure::failed(error).at(folder.display()))?;
    let run = RunArgs::within(folder.clone(), args.overwrite, folder.join(CHECKPOINT), args.backend.clone());
    train::run(&TrainArgs {
        dataset: args.dataset.clone(),
        images: DatasetArgs {
            reading: ReadingArgs { max_size: args.coarse_max_size(), ..args.images.reading },
            ..args.images.clone()
        },
        settings: TrainSettingsArgs { gaussians: args.coarse_gaussians, exactly: false, ..args.settings.clone() },
        run,
        image_memory: None,
        resume: None,
    })?;
    Ok(folder)
}

fn summary(folder: &BlocksFolder, coarse: usize, views: usize, seconds: &[f64]) -> Result<(), Failure> {
    let plan = folder.plan();
    if let Some(first) = plan.unused.first() {
        let count = counted(plan.unused.len(), "view");
        output::note(format_args!("note: {count} show nothing of the coarse model and are not used (first: {first})"));
    }
    let used: usize = plan.blocks.iter().map(|block| block.views.len()).sum();
    let most = plan.blocks.iter().map(|block| block.memory).max().unwrap_or_default();
    let path = folder.path();
    let time = match seconds {
        [] => String::new(),
        _ => format!("; all blocks take about {}, one after the other", duration(seconds.iter().sum())),
    };
    output::result(format_args!(
        "{} of {} and {views} views: each view is in {:.2} blocks on average, and a block takes at most about {} of \
         memory{time}; see {}; do them with gs blocks work {}",
        counted(plan.blocks.len(), "block"),
        counted(coarse, "coarse Gaussian"),
        used as f64 / views as f64,
        amount(most),
        path.join(MAP).display(),
        quoted(path)
    ))
}
