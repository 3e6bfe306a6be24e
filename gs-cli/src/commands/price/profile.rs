//! `gs profile`: the time of each stage of a training step, on any backend.

use std::path::PathBuf;

use clap::Args;
use gs_core::{Choice as _, Effects, Loss, Parameterization};
use gs_lab::price::{StagePrices, stage_prices};
use serde::Serialize;

use super::{Cameras, Facts, Seen, Subject, SubjectArgs};
use crate::{
    failure::Failure,
    flags::values::{ViewName, by_name, whole},
    memory,
    terminal::output,
};

const AFTER_HELP: &str = "\
A 3D scene is profiled from a view of a data set, or from where all of it is in sight. The measured \
steps do not move the Gaussians: their target is the scene's own rendering.

A row of the table is a stage of a training step: its median time, its 10 % and 90 % quantiles, \
its share of the sum, and the pairs of a pixel and a Gaussian that it visits. A stage that a \
training step replaces by another has no share. Below are whole training steps (means over 4, sent \
without waiting, as in a fit), with new lists and with those of the step before (in 3D always new), \
and the forward pass alone, as a caller sees them.

On a GPU, stages are timed by the device if the adapter has timestamps, otherwise by the host, \
which then waits after each stage. The head of the table says which.

--json prints all samples and settings, too.";

/// The flags of `gs profile`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ProfileArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    input: PathBuf,
    /// Print JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// Measurements of each stage
    #[arg(short, long, value_name = "R", default_value_t = 20, value_parser = whole::<u32>(1..=100_000))]
    repetitions: u32,
    /// Loss to minimise [default: l2; l1-dssim in 3D]
    #[arg(long, value_parser = by_name::<Loss>(), value_name = "LOSS")]
    loss: Option<Loss>,
    /// Coordinates of the optimizer [default: covariance-factor; scale-rotation in 3D]
    #[arg(long, value_parser = by_name::<Parameterization>(), value_name = "NAME")]
    parameterization: Option<Parameterization>,
    /// Camera of a view of a data set [default: the whole scene from slightly above]
    #[arg(long, value_name = "DATASET:VIEW", help_heading = "3D scenes")]
    camera: Option<ViewName>,
    #[command(flatten)]
    subject: SubjectArgs,
}

/// What `gs profile --json` prints.
#[derive(Debug, Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    facts: &'a Facts,
    #[serde(flatten)]
    effects: Effects,
    loss: Loss,
    parameterization: Parameterization,
    repetitions: u32,
    #[serde(flatten)]
    prices: StagePrices,
}

/// Profiles a scene, and prints the table.
pub(crate) fn run(args: &ProfileArgs) -> Result<(), Failure> {
    let cameras = args.camera.as_ref().map_or(Cameras::Around(1), Cameras::View);
    let mut subject = Subject::load(&args.input, &args.subject, cameras)?;
    subject.check_work("profiling", memory::profiling)?;
    let is_3d = matches!(subject.seen, Seen::ThreeD(..));
    let usual = match is_3d {
        true => (Loss::PAPER, Parameterization::ScaleRotation),
        false => (Loss::L2, Parameterization::CovarianceFactor),
    };
    let (loss, parameterization) = (args.loss.unwrap_or(usual.0), args.parameterization.unwrap_or(usual.1));
    if is_3d {
        parameterization.check_3d()?;
    }
    let backend = subject.open(&args.subject)?;
    let (seen, facts, render) = (&subject.seen, &subject.facts, subject.render);
    let (rasterizer, repetitions, how) = (&backend.rasterizer, args.repetitions, (loss, parameterization));
    let prices = match seen {
        Seen::TwoD(scene, [canvas]) => stage_prices(rasterizer, scene, canvas, &render, how, repetitions as usize),
        Seen::ThreeD(scene, views, _) => stage_prices(rasterizer, scene, &views[0], &render, how, repetitions as usize),
    }?;
    let report = Report { facts, effects: render.effects, loss, parameterization, repetitions, prices };
    let (loss, parameterization) = (loss.name(), parameterization.name());
    output::answer(args.json, &report, || {
        let text = format!("{}\n{}, {loss}, {parameterization}\n{}", facts.text(), render.effects, report.prices);
        text.trim_end().to_owned()
    })
}
