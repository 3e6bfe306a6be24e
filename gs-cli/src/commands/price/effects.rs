//! `gs effects`: which effects a scene requires and why, what each costs on this machine, and what
//! leaving it out would change.

use std::path::PathBuf;

use clap::Args;
use gs_lab::price::{EffectPrices, TrainingPrices, effect_prices, training_prices};
use gs_train::train::Views;
use serde::Serialize;

use super::{Cameras, Facts, Seen, Subject, SubjectArgs};
use crate::{failure::Failure, flags::values::whole, memory, terminal::output};

const AFTER_HELP: &str = "\
A 3D scene is seen from the test views of DATASET (from all views if none is held out), or from \
cameras around it. The flags say which effects are wanted; the default is what 3DGS uses. An \
effect is required unless it is certain that no pixel of these views changes by more than 1/512 \
without it. Renderings with and without it verify that; if they contradict it, the effect is \
required.

The table has a row for each effect: its wanted and its required value; the extra time of a \
picture with the wanted value in place of the next cheaper one; the largest difference of a pixel \
and the PSNR between such pictures; and the reason.

With --train, a second table has a row for each correction of a training that DATASET allows: of \
exposure, and of poses, which needs 15 steps a view. Each row compares two trainings of K steps that \
begin with the scene, with the correction and without it: time of a step, and mean PSNR over the test views, \
as it is, with matched colours and, where poses are refined, at aligned poses.";

/// The flags of `gs effects`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct EffectsCommandArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    input: PathBuf,
    /// Data set of posed images whose views show a 3D scene
    dataset: Option<PathBuf>,
    /// Print JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// The most views
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<u32>(1..=10_000))]
    views: u32,
    /// Measurements of each time
    #[arg(short, long, value_name = "R", default_value_t = 11, value_parser = whole::<u32>(1..=10_000))]
    repetitions: u32,
    /// Also train a 3D scene for K steps on the views of DATASET, with and without the correction of
    /// exposure and of poses
    #[arg(long, value_name = "K", requires = "dataset", value_parser = whole::<u32>(1..=1_000_000))]
    train: Option<u32>,
    #[command(flatten)]
    subject: SubjectArgs,
}

/// What `gs effects --json` prints.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report<'a> {
    #[serde(flatten)]
    facts: &'a Facts,
    #[serde(flatten)]
    prices: EffectPrices,
    #[serde(skip_serializing_if = "Option::is_none")]
    training: Option<TrainingPrices>,
}

/// Decides and verifies which effects are required, measures them, and prints the table.
pub(crate) fn run(args: &EffectsCommandArgs) -> Result<(), Failure> {
    let cameras = args.dataset.as_deref();
    let cameras = cameras.map_or(Cameras::Around(args.views), |path| Cameras::Dataset(path, args.views));
    let mut subject = Subject::load(&args.input, &args.subject, cameras)?;
    subject.check_work("measuring the effects of", |size| memory::comparing(size, 1))?;
    let backend = subject.open(&args.subject)?;
    let Subject { seen, render, facts, .. } = &subject;
    let (rasterizer, repetitions) = (&backend.rasterizer, args.repetitions as usize);
    let prices = match seen {
        Seen::TwoD(scene, views) => effect_prices(rasterizer, scene, views, render, repetitions),
        Seen::ThreeD(scene, views, _) => effect_prices(rasterizer, scene, views, render, repetitions),
    }?;
    let training = match (seen, args.train) {
        (Seen::ThreeD(scene, _, Some(dataset)), Some(steps)) => {
            Some(training_prices(rasterizer, scene, || Views::of_dataset(dataset), render, steps)?)
        }
        _ => None,
    };
    let report = Report { facts, prices, training };
    output::answer(args.json, &report, || {
        let training: String = report.training.iter().map(|training| format!("\n\n{training}")).collect();
        format!("{}\n\n{}{training}", facts.text(), report.prices)
    })
}
