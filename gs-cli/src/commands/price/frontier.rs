//! `gs frontier`: what accuracy costs in time for a scene on this machine.

use std::path::PathBuf;

use clap::Args;
use gs_backend::{AnyRasterizer, FutureExt as _, Wanted};
use gs_core::{Optimizer, Scene};
use gs_io::Inputs;
use gs_lab::price::{Frontier, Search};
use serde::Serialize;

use super::{Cameras, Facts, Seen, Subject, SubjectArgs};
use crate::{
    failure::Failure,
    files::{
        output_folder::{self, OutputFolder, OverwriteArgs},
        scene,
    },
    flags::{backend::BackendArgs, values::whole},
    memory,
    terminal::output,
};

const AFTER_HELP: &str = "\
A 3D scene is seen from views of --dataset, or from an orbit around it.

Every setting is measured alone: cut and bound of alpha, full pixels, order, antialiasing, SH degree; on the CPU \
every SIMD level and one thread; on a GPU every kind of kernel. Settings are timed in turn, after a warm-up. The default is measured twice, as if it were \
two settings: their difference is the noise, and smaller differences are `no difference`. The \
error is that of the worst channel of any pixel, not clamped, against a rendering without \
any cut-off, with the effects of the scene. Other effects change the picture; their error is that \
change.

DIR then holds frontier.json, the table with all times, and frontier.svg, error against time. gs \
render takes the settings by --accuracy and the flags of effects.";

/// The flags of `gs frontier`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct FrontierArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    input: PathBuf,
    /// Folder for the results; made if necessary [default: they are only printed]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// Seconds for timing; there are at least seven rounds, however long they take
    #[arg(long, value_name = "S", default_value_t = 24, value_parser = whole::<u32>(1..=3600))]
    seconds: u32,
    /// Data set whose views show a 3D scene
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Views of a 3D scene
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = whole::<u32>(1..=100))]
    views: u32,
    #[command(flatten)]
    subject: SubjectArgs,
}

/// The files that are written.
const FILES: [&str; 2] = ["frontier.json", "frontier.svg"];

/// What `frontier.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report<'a> {
    #[serde(flatten)]
    facts: &'a Facts,
    #[serde(flatten)]
    found: Frontier,
}

/// Measures, prints and writes.
pub(crate) fn run(args: &FrontierArgs) -> Result<(), Failure> {
    let inputs = Inputs::from_iter([scene::file_of(&args.input)]);
    let claim = args.output.as_ref().map(|path| args.overwrite.claim(path, FILES, inputs));
    claim.as_ref().map_or(Ok(()), output_folder::check)?;
    let cameras = args.dataset.as_deref();
    let cameras = cameras.map_or(Cameras::Around(args.views), |path| Cameras::Dataset(path, args.views));
    let subject = Subject::load(&args.input, &args.subject, cameras)?;
    subject.check_work("measuring the frontier of", |size| memory::comparing(size, args.views.into()))?;
    let folder = claim.map(OutputFolder::begin).transpose()?;
    match &subject.seen {
        Seen::TwoD(scene, views) => measure(args, &subject, scene, views, folder.as_ref()),
        Seen::ThreeD(scene, views, _) => measure(args, &subject, scene, views, folder.as_ref()),
    }
}

/// A rasterizer of each backend. `--backend auto` compares the CPU and, if there is an adapter, wgpu.
fn backends(flags: &BackendArgs) -> Result<Vec<AnyRasterizer>, Failure> {
    let asks_for_wgpu = flags.backend == Wanted::Wgpu || flags.adapter.is_some();
    let asks_for_cpu = flags.backend == Wanted::Cpu || flags.simd.is_some();
    let mut wanted = Vec::new();
    if !asks_for_wgpu {
        wanted.push(Wanted::Cpu);
    }
    if asks_for_wgpu || !asks_for_cpu && !gs_wgpu::adapters().block_on().is_empty() {
        wanted.push(Wanted::Wgpu);
    }
    let open = |wanted| {
        let base = flags.open_to_compare(wanted)?;
        output::note(&base.reason);
        Ok(base.rasterizer)
    };
    wanted.into_iter().map(open).collect()
}

/// Measures the scene in views.
fn measure<S>(
    args: &FrontierArgs,
    Subject { render, facts, .. }: &Subject,
    scene: &S,
    views: &[S::View],
    folder: Option<&OutputFolder>,
) -> Result<(), Failure>
where
    S: Scene,
    AnyRasterizer: Optimizer<S>,
{
    let what = facts.text();
    let search = Search {
        scene,
        backends: backends(&args.subject.seen.backend)?,
        shown: *render,
        views,
        seconds: f64::from(args.seconds),
    };
    let report = Report { facts, found: search.run(&mut |what| output::note(what))? };
    let found = &report.found;
    output::answer(args.json, &report, || format!("{what}\n\n{found}"))?;
    if let Some(folder) = folder {
        folder.write_json("frontier.json", &report)?;
        folder.write("frontier.svg", found.svg(&what))?;
        output::note(format_args!("wrote the frontier in {}", folder.path().display()));
    }
    Ok(())
}
