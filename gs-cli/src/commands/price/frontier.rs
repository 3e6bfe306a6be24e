//! `gs frontier`: what accuracy costs in time for a scene on this machine, and the settings that
//! keep a budget of either.

use std::path::PathBuf;

use clap::Args;
use gs_backend::{AnyRasterizer, FutureExt as _, Wanted};
use gs_core::{Optimizer, Scene, counted};
use gs_io::Inputs;
use gs_lab::price::{
    Contender, Verifiable, contenders,
    frontier::{Budget, Field, Frontier, SearchLimits, search},
    unseen_cameras, unseen_canvases,
};
use serde::Serialize;

use super::{
    Cameras, Facts, Seen, Subject, SubjectArgs,
    answer::{self, Answer},
};
use crate::{
    failure::Failure,
    files::{
        output_folder::{self, OutputFolder, OverwriteArgs},
        scene,
    },
    flags::{
        backend::BackendArgs,
        values::{Tolerance, whole},
    },
    image_fit::FitSettingsArgs,
    terminal::output,
};

const AFTER_HELP: &str = "\
A scene is measured as it is; an image is fitted first. A 3D scene is seen from views of \
--dataset, or from an orbit around it.

Every setting is measured alone, and the combinations on the frontier, if times multiply and \
errors add up: cut of alpha, extent, full pixels, order, antialiasing, SH degree; on the CPU every \
SIMD level, one thread, exp in place of the recurrence, tiles, bounds; on a GPU every kind of \
kernels. Settings are timed in turn, after a warm-up. The default is measured twice, as if it were \
two settings: their difference is the noise, and smaller differences are `no difference`. The \
error is that of the worst channel of any pixel, not clamped, against the 64-bit oracle without \
any cut-off, with the effects of the scene. Other effects change the picture; their error is that \
change.

With --max-error or --max-ms the answer is a settings file for gs render --settings and gs fit \
--settings: the fastest settings that are exact enough, or the most exact that are fast enough, of \
all measured backends, verified on other views than those of the search. Among settings whose \
times differ by less than the noise, the one with the lowest median is taken, and the answer says \
so. The answer is printed on standard output, everything else on standard error.

DIR then holds frontier.csv, the table; frontier.json, the same with all times; frontier.svg and \
.png, error against time; and settings.toml with a budget.";

/// The flags of `gs frontier`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct FrontierArgs {
    /// A scene, or an image to fit first
    input: PathBuf,
    /// Folder for the results; made if necessary [default: they are only printed]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Choose the fastest settings with at most this error at every pixel: a number, or a fraction
    /// such as 1/255
    #[arg(long, value_name = "E", conflicts_with = "max_ms")]
    max_error: Option<Tolerance>,
    /// Choose the most exact settings with at most this many milliseconds per view
    #[arg(long, value_name = "T")]
    max_ms: Option<Tolerance>,
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

/// The files that are written or removed.
const FILES: [&str; 5] = ["frontier.csv", "frontier.json", "frontier.svg", "frontier.png", "settings.toml"];

impl FrontierArgs {
    fn budget(&self) -> Option<Budget> {
        let error = self.max_error.map(|most| Budget::MaxError(most.0));
        error.or(self.max_ms.map(|most| Budget::MaxSeconds(1e-3 * most.0)))
    }
}

/// What `frontier.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report<'a> {
    #[serde(flatten)]
    facts: &'a Facts,
    #[serde(flatten)]
    frontier: &'a Frontier,
    #[serde(skip_serializing_if = "Option::is_none")]
    answer: Option<&'a Answer>,
}

/// Measures, prints and writes.
pub(crate) fn run(args: &FrontierArgs) -> Result<(), Failure> {
    let inputs = Inputs::from_iter([scene::file_of(&args.input)]);
    let claim = args.output.as_ref().map(|path| args.overwrite.claim(path, FILES, inputs));
    claim.as_ref().map_or(Ok(()), output_folder::check)?;
    let cameras = args.dataset.as_deref();
    let cameras = cameras.map_or(Cameras::Around(2 * args.views), |path| Cameras::Dataset(path, 2 * args.views));
    let fit = FitSettingsArgs { iterations: args.subject.iterations, ..FitSettingsArgs::default() };
    let mut subject = Subject::load(Some(&args.input), &args.subject, cameras, fit)?;
    subject.check_work("measuring the frontier of", |size| gs_train::memory::comparing(size, args.views.into()))?;
    if matches!(&subject, Subject::TwoD(seen) if seen.fit.is_some()) {
        let backend = args.subject.seen.backend.open_to_render_2d(subject.render())?;
        subject.fit_first(&backend.rasterizer)?;
    }
    let folder = claim.map(OutputFolder::begin).transpose()?;
    match subject {
        Subject::TwoD(seen) => {
            let unseen = unseen_canvases(seen.views[0]);
            measure(args, &seen, (&seen.views, &unseen), folder.as_ref())
        }
        Subject::ThreeD(seen, _) => {
            let (views, unseen) = unseen_cameras(&seen.views);
            measure(args, &seen, (&views, &unseen), folder.as_ref())
        }
    }
}

/// All contenders for a scene. `--backend auto` compares the CPU and, if there is an adapter, wgpu.
fn all_contenders<'a, S>(flags: &BackendArgs, seen: &Seen<S>) -> Result<Vec<Contender<'a, S::View>>, Failure>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let asks_for_wgpu = flags.backend == Wanted::Wgpu || flags.adapter.is_some();
    let asks_for_cpu = flags.backend == Wanted::Cpu || flags.simd.is_some();
    let mut wanted = Vec::new();
    if !asks_for_wgpu {
        wanted.push(Wanted::Cpu);
    }
    if asks_for_wgpu || !asks_for_cpu && !gs_wgpu::adapters().block_on().is_empty() {
        wanted.push(Wanted::Wgpu);
    }
    let mut all = Vec::new();
    for wanted in wanted {
        let base = flags.open_to_compare(wanted)?;
        output::note(&base.reason);
        all.extend(contenders(base.rasterizer, &seen.scene, seen.render.effects.blend)?);
    }
    Ok(all)
}

/// Measures the scene in views, and verifies the answer on unseen ones.
fn measure<S>(
    args: &FrontierArgs,
    seen: &Seen<S>,
    (views, unseen): (&[S::View], &[S::View]),
    folder: Option<&OutputFolder>,
) -> Result<(), Failure>
where
    S: Verifiable,
    AnyRasterizer: Optimizer<S>,
{
    let contenders = all_contenders(&args.subject.seen.backend, seen)?;
    let field = Field { scene: &seen.scene, contenders, shown: seen.render };
    let limits = SearchLimits::default().with(|s| s.seconds = f64::from(args.seconds));
    let frontier = search(&field, views, limits, &mut |what| output::note(what))?;
    let what = seen.facts.text();
    // The frontier is printed and written even if the budget cannot be kept.
    let answer = args.budget().map(|budget| {
        output::note(format_args!("verifying on {} that the search did not use", counted(unseen.len(), "view")));
        let chosen = budget.choose(&field, &frontier, unseen, 0.1 * limits.seconds)?;
        let choice = chosen.map_err(|why| answer::missed(budget, why, unseen.len()))?;
        Answer::new(budget, choice, &field, &frontier, &what)
    });
    let (answer, failure) = match answer.transpose() {
        Ok(answer) => (answer, None),
        Err(failure) => (None, Some(failure)),
    };
    let report = Report { facts: &seen.facts, frontier: &frontier, answer: answer.as_ref() };
    let text = format!("{what}\n\n{}", frontier.text());
    match &answer {
        _ if args.json => output::json(&report),
        None => output::result(text),
        Some(answer) => {
            output::note(text);
            output::file(answer.file.trim_end())
        }
    }?;
    if let Some(folder) = folder {
        let figure = frontier.figure(&what);
        folder.write("frontier.csv", frontier.table().csv())?;
        folder.write_json("frontier.json", &report)?;
        folder.write("frontier.svg", figure.svg_file()?)?;
        gs_io::write_png(folder.file("frontier.png"), &figure.image()?)?;
        match &answer {
            Some(answer) => folder.write("settings.toml", &answer.file)?,
            None => folder.leave_out("settings.toml")?,
        }
        output::note(format_args!("wrote the frontier in {}", folder.path().display()));
    }
    failure.map_or(Ok(()), Err)
}
