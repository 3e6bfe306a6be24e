//! `gs frontier`: what accuracy costs in time for a scene on this machine, and the flags that keep a
//! budget of either.

use std::path::PathBuf;

use clap::Args;
use gs_backend::{AnyRasterizer, FutureExt as _, Wanted};
use gs_core::Optimizer;
use gs_io::Inputs;
use gs_lab::price::{Budget, FrontierReport, Search, Verifiable};
use serde::Serialize;

use super::{
    Cameras, Facts, Seen, Subject, SubjectArgs,
    views::{unseen_cameras, unseen_canvases},
};
use crate::{
    failure::Failure,
    files::{
        output_folder::{self, OutputFolder, OverwriteArgs},
        scene,
    },
    flags::{
        backend::BackendArgs,
        values::{tolerance, whole},
    },
    memory,
    terminal::output,
};

const AFTER_HELP: &str = "\
A 3D scene is seen from views of --dataset, or from an orbit around it.

Every setting is measured alone: cut and bound of alpha, full pixels, order, antialiasing, SH degree; on the CPU \
every SIMD level, one thread; on a GPU every kind of kernels. Settings are timed in turn, after a warm-up. The default is measured twice, as if it were \
two settings: their difference is the noise, and smaller differences are `no difference`. The \
error is that of the worst channel of any pixel, not clamped, against the 64-bit oracle without \
any cut-off, with the effects of the scene. Other effects change the picture; their error is that \
change.

With --max-error or --max-ms the answer is flags for gs render: the fastest settings that are \
exact enough, or the most exact that are fast enough, of all measured backends, verified on other \
views than those of the search. Kernels, which no flag chooses, are left out. Among \
settings whose times differ by less than the noise, the one with the lowest median is taken, and \
the answer says so. The answer is printed on standard output, everything else on standard error.

DIR then holds frontier.csv, the table; frontier.json, the same with all times and the answer; and \
frontier.svg, error against time.";

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
    /// Choose the fastest settings with at most this error at every pixel: a number, or a fraction
    /// such as 1/255
    #[arg(long, value_name = "E", value_parser = tolerance, conflicts_with = "max_ms")]
    max_error: Option<f64>,
    /// Choose the most exact settings with at most this many milliseconds per view
    #[arg(long, value_name = "T", value_parser = tolerance)]
    max_ms: Option<f64>,
    /// Print JSON on standard output, and nothing else there
    #[arg(long, conflicts_with_all = ["max_error", "max_ms"])]
    json: bool,
    /// Seconds for timing; there are at least seven rounds, however long they take
    #[arg(long, value_name = "S", default_value_t = 24, value_parser = whole::<u32>(1..=3600))]
    seconds: u32,
    /// Data set whose views show a 3D scene
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Views of a 3D scene for the search, and as many again to verify
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = whole::<u32>(1..=100))]
    views: u32,
    #[command(flatten)]
    subject: SubjectArgs,
}

/// The files that are written.
const FILES: [&str; 3] = ["frontier.csv", "frontier.json", "frontier.svg"];

impl FrontierArgs {
    fn budget(&self) -> Option<Budget> {
        let error = self.max_error.map(Budget::MaxError);
        error.or(self.max_ms.map(|most| Budget::MaxSeconds(1e-3 * most)))
    }
}

/// What `frontier.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report<'a> {
    #[serde(flatten)]
    facts: &'a Facts,
    #[serde(flatten)]
    found: FrontierReport,
}

/// Measures, prints and writes.
pub(crate) fn run(args: &FrontierArgs) -> Result<(), Failure> {
    let inputs = Inputs::from_iter([scene::file_of(&args.input)]);
    let claim = args.output.as_ref().map(|path| args.overwrite.claim(path, FILES, inputs));
    claim.as_ref().map_or(Ok(()), output_folder::check)?;
    let cameras = args.dataset.as_deref();
    let cameras = cameras.map_or(Cameras::Around(2 * args.views), |path| Cameras::Dataset(path, 2 * args.views));
    let subject = Subject::load(&args.input, &args.subject, cameras)?;
    subject.check_work("measuring the frontier of", |size| memory::comparing(size, args.views.into()))?;
    let folder = claim.map(OutputFolder::begin).transpose()?;
    match &subject.seen {
        Seen::TwoD(scene, views) => {
            measure(args, &subject, scene, (views, &unseen_canvases(views[0])), folder.as_ref())
        }
        Seen::ThreeD(scene, cameras, _) => {
            let (views, unseen) = unseen_cameras(cameras);
            measure(args, &subject, scene, (&views, &unseen), folder.as_ref())
        }
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

/// Measures the scene in views, and verifies the answer on unseen ones.
fn measure<S>(
    args: &FrontierArgs,
    Subject { render, facts, .. }: &Subject,
    scene: &S,
    (views, unseen): (&[S::View], &[S::View]),
    folder: Option<&OutputFolder>,
) -> Result<(), Failure>
where
    S: Verifiable,
    AnyRasterizer: Optimizer<S>,
{
    let what = facts.text();
    let search = Search {
        scene: (scene, &what),
        backends: backends(&args.subject.seen.backend)?,
        shown: *render,
        views,
        unseen,
        seconds: f64::from(args.seconds),
        budget: args.budget(),
    };
    let mut report = Report { facts, found: search.run(&mut |what| output::note(what))? };
    let failure = report.found.failure.take();
    let found = &report.found;
    let text = format!("{what}\n\n{found}");
    match found.answer() {
        _ if args.json => output::json(&report),
        None => output::result(text),
        Some(flags) => {
            output::note(text);
            output::file(flags)
        }
    }?;
    if let Some(folder) = folder {
        folder.write("frontier.csv", found.csv())?;
        folder.write_json("frontier.json", &report)?;
        folder.write("frontier.svg", found.figure(&what))?;
        output::note(format_args!("wrote the frontier in {}", folder.path().display()));
    }
    // The frontier is printed and written even if the budget cannot be kept or verified.
    failure.map_or(Ok(()), Err)?;
    match (&found.missed, args.max_error, args.max_ms) {
        (Some(why), Some(most), _) => Err(missed("--max-error", most, why)),
        (Some(why), None, Some(most)) => Err(missed("--max-ms", most, why)),
        _ => Ok(()),
    }
}

/// The failure where no settings keep the budget that a flag sets.
fn missed(flag: &str, most: f64, (why, more): &(String, &'static str)) -> Failure {
    Failure::failed(format_args!("{flag} {most}: {why}")).hint(format_args!("give a larger {flag}{more}"))
}
