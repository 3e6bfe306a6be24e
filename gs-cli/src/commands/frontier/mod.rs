//! `gs frontier`: what accuracy costs in time for a scene on this machine, and the settings that
//! keep a budget of either.

mod answer;
mod contenders;
mod subject;

use std::path::PathBuf;

use clap::Args;
use gs_backend::AnyRasterizer;
use gs_core::{Optimizer, counted};
use gs_io::Inputs;
use gs_lab::price::frontier::{
    Budget, Field, Frontier, SearchAnswer, SearchLimits, Verifiable, figure, search, to_csv, to_text,
};
use gs_oracle::OracleView;
use serde::Serialize;

use self::{
    answer::Answer,
    contenders::contenders,
    subject::{Seen, Subject},
};
use crate::{
    backend::BackendArgs,
    dataset::ReadingArgs,
    failure::Failure,
    memory, output,
    output_folder::{self, OutputFolder, OverwriteArgs},
    render_args::RenderArgs3d,
    scene,
    values::{Axis, Size, Tolerance, whole},
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
    /// Size of the pictures [default: that of the image or of the data set; otherwise 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// The most Gaussians to fit an image with [default: 9000 for each 768x512 px]
    #[arg(short = 'n', long, value_name = "N", value_parser = whole::<u32>(1..))]
    gaussians: Option<u32>,
    /// Data set whose views show a 3D scene
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Views of a 3D scene for the search, and as many again to verify
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = whole::<u32>(1..=100))]
    views: u32,
    /// Up direction and axis of the orbit: x, y, z, -x, -y or -z [default: -y]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Axis>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
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
    input: String,
    gaussians: usize,
    width: u32,
    height: u32,
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
    let subject = Subject::load(args)?;
    let folder = claim.map(OutputFolder::begin).transpose()?;
    match subject {
        Subject::TwoD(seen) => measure(args, &seen, folder.as_ref()),
        Subject::ThreeD(seen) => measure(args, &seen, folder.as_ref()),
    }
}

fn measure<S>(args: &FrontierArgs, seen: &Seen<S>, folder: Option<&OutputFolder>) -> Result<(), Failure>
where
    S: Verifiable,
    AnyRasterizer: Optimizer<S>,
{
    let size = seen.views[0].size();
    let bytes = gs_train::memory::comparing(size, seen.views.len().max(seen.unseen.len()) as u64);
    memory::check_work("measuring the frontier of", args.input.display(), size, bytes)?;
    let (contenders, machines) = contenders(&args.backend, &seen.scene, seen.render.effects.blend)?;
    let field = Field { scene: &seen.scene, contenders, shown: seen.render };
    let limits = SearchLimits::default().with(|s| s.seconds = f64::from(args.seconds));
    let frontier = search(&field, &seen.views, limits, &mut |what| output::note(what))?;
    let (width, height) = seen.views[0].size();
    let what = format!("{}: {}, {width}x{height} px", seen.name, counted(seen.scene.len(), "Gaussian"));
    // The frontier is printed and written even if the budget cannot be kept.
    let answer = args.budget().map(|budget| -> Result<Answer, Failure> {
        output::note(format_args!("verifying on {} that the search did not use", counted(seen.unseen.len(), "view")));
        match budget.choose(&field, &frontier, &seen.unseen, 0.1 * limits.seconds)? {
            SearchAnswer::Kept(choice) => Answer::new(budget, &choice, &frontier, &machines, seen.effects, &what),
            SearchAnswer::OutOfReach(best) => Err(answer::out_of_reach(budget, best)),
            SearchAnswer::NotElsewhere(count) => Err(answer::not_elsewhere(budget, count, seen.unseen.len())),
        }
    });
    let (answer, failure) = match answer.transpose() {
        Ok(answer) => (answer, None),
        Err(failure) => (None, Some(failure)),
    };
    let report = Report {
        input: args.input.display().to_string(),
        gaussians: seen.scene.len(),
        width,
        height,
        frontier: &frontier,
        answer: answer.as_ref(),
    };
    let text = format!("{what}\n\n{}", to_text(&frontier));
    match &answer {
        _ if args.json => output::json(&report),
        None => output::result(text),
        Some(answer) => {
            output::note(text);
            output::file(answer.file.trim_end())
        }
    }?;
    if let Some(folder) = folder {
        let figure = figure(&frontier, &what);
        folder.write("frontier.csv", to_csv(&frontier))?;
        folder.write_json("frontier.json", &report)?;
        folder.write("frontier.svg", &figure.svg_file()?)?;
        gs_io::write_png(folder.file("frontier.png"), &figure.image()?)?;
        match &answer {
            Some(answer) => folder.write("settings.toml", &answer.file)?,
            None => folder.leave_out("settings.toml")?,
        }
        output::note(format_args!("wrote the frontier in {}", folder.path().display()));
    }
    failure.map_or(Ok(()), Err)
}
