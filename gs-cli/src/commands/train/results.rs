//! The results of a training. Each file is written completely or not at all, and a failure of one
//! does not keep the others from being written. The summary comes last.

use gs_train::SettingsFile as _;
use std::{
    collections::HashMap,
    path::Path,
    sync::{Mutex, PoisonError},
};

use gs_backend::{AnyRasterizer, Chosen, FutureExt as _, block_on};
use gs_core::{
    Camera, Choice as _, RenderSettings, Scene as _, Scene3d, counted,
    effects::{Antialias, Effect, EffectDecision},
};
use gs_io::{
    TrainedWith, WorldFrame, WriteOptions3d,
    dataset::{Split, SplitOrigin, View},
    write_3d,
};
use gs_lab::report::curve::CurvePoint;
use gs_train::{
    MetricsLog, Trainer3d,
    train::{
        ColorMatched, DRIFT_DB, Evaluation, Exposure, ExposureReport, ImageReading, PoseMatched, PosesReport,
        RefinePoses, TrainSummary, TrainingViews, Views,
    },
};
use serde::Serialize;

use super::{Input, pictures::ViewPictures};
use crate::{
    failure::Failure,
    flags::{cameras::sampled, effects_args},
    terminal::output::{self, Verbosity},
    training::{
        job::Run,
        phases::Phases,
        results::{self, Problems, ProgramSummary, without_broken, write_curve, write_table},
    },
};

/// The most views for which required effects are decided.
const EFFECT_VIEWS: usize = 8;

/// The most views, evenly spread, of which pictures are written.
const MOST_PICTURES: usize = 32;

/// What `summary.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
pub(super) struct Summary<'a> {
    #[serde(flatten)]
    training: TrainSummary,
    #[serde(flatten)]
    program: ProgramSummary,
    dataset: String,
    /// Where the split of the data set comes from.
    split: SplitOrigin,
    /// Whether the user named a number of Gaussians, so that a shortfall is worth a note.
    #[serde(skip)]
    names_gaussians: bool,
    /// What reading the images cost, in seconds and in bytes.
    images: Option<ImageReading>,
    /// Seconds of each phase of this command, in order; the training is all steps, with what is
    /// measured and stored between them.
    phases: &'a Phases,
    /// Which effects the scene requires in the views that evaluate it, and why.
    effects: Vec<EffectDecision>,
}

impl results::Summary for Summary<'_> {
    fn text(&self, folder: &Path, verbosity: Verbosity) -> String {
        let TrainSummary {
            gaussians,
            iterations,
            seconds,
            evaluation,
            training,
            test_views,
            edits,
            clamped,
            fresh_starts,
            shortfall,
            exposure,
            poses,
            ..
        } = &self.training;
        let problems = Problems::new(verbosity, edits, evaluation.culled, *clamped, fresh_starts);
        let unmeasured = match evaluation.unmeasured.len() {
            0 => String::new(),
            count => format!(", without {count} whose pixels are all masked"),
        };
        let evaluated = match test_views {
            0 => "views that it was trained with".to_owned(),
            count => counted(*count, "held-out view"),
        };
        let trained = match training {
            Some(TrainingViews { views, psnr: Some(psnr), .. }) if *test_views > 0 => {
                format!(", PSNR {psnr:.2} dB over {} that it was trained with", counted(*views, "view"))
            }
            _ => String::new(),
        };
        let matched = evaluation.color_matched.map_or_else(String::new, |ColorMatched { psnr, ssim, .. }| {
            format!(" (colours matched: {psnr:.2} dB, {ssim:.4})")
        });
        let drift = self.training.drift().map(|drift| {
            format!(
                "the scene fits the training views {drift:.1} dB better than the held-out views, so it is overfitted (more than \
                 {DRIFT_DB} dB): more views would help most, and fewer Gaussians (-n) may"
            )
        });
        let views = self.training.train_views;
        let auto = self.training.settings.exposure == Exposure::Auto;
        let exposure = match exposure {
            Some(ExposureReport { used: true, gain_db, .. }) => {
                let closer = format!("; a colour map for each image brings neighbouring images {gain_db:.2} dB closer");
                let closer = if auto { &closer } else { "" };
                Some(format!("differences in exposure between the images were corrected{closer}"))
            }
            _ if !auto || verbosity != Verbosity::Verbose => None,
            Some(ExposureReport { compared, .. }) if 2 * compared < views => Some(format!(
                "exposure was not corrected: only {compared} of {views} images can be compared with others at the same places"
            )),
            Some(ExposureReport { gain_db, .. }) => Some(format!(
                "exposure was not corrected: a colour map for each image brings neighbouring images only {gain_db:.2} dB closer"
            )),
            None => {
                let steps = counted(*iterations, "step");
                Some(format!("exposure was not corrected: {steps} are too few to compare images"))
            }
        };
        let poses = match poses {
            Some(report) => Some(poses_line(report, evaluation.pose_matched)),
            None if self.training.settings.refine_poses == RefinePoses::Off => None,
            None => Some(format!(
                "poses were not refined: {} are too few for {}; at least {} are needed (-i)",
                counted(*iterations, "step"),
                counted(views, "view"),
                RefinePoses::least_steps(views)
            )),
        };
        let antialiases = |decision: &&EffectDecision| {
            decision.effect == Effect::Antialias
                && Antialias::from_name(decision.wanted).is_some_and(Antialias::compensates)
        };
        let antialias = self.effects.iter().find(antialiases).map(|decision| {
            format!(
                "viewers must show scene.ply with the antialiasing that it names, {}: for those that cannot, train \
                 with --antialias dilate",
                decision.wanted
            )
        });
        let shortfall = shortfall.as_ref().filter(|_| self.names_gaussians || verbosity == Verbosity::Verbose);
        let images = self.images.as_ref().and_then(|images| images.failure.clone());
        let images = images.map(|failure| format!("{failure}; images were read again instead"));
        let shortfall = shortfall.map(ToString::to_string);
        let notes = [drift, exposure, poses, antialias, images, shortfall].into_iter().flatten();
        let notes: String = notes.map(|note| format!("\nnote: {note}")).collect();
        format!(
            "{} after {} in {seconds:.1} s ({:.1} s in all): PSNR {:.2} dB, SSIM {:.4}{matched} over {evaluated}{unmeasured}{trained}{problems}; \
             see {}{}{notes}",
            counted(*gaussians, "Gaussian"),
            counted(*iterations, "step"),
            self.program.total_seconds,
            evaluation.psnr,
            evaluation.ssim,
            folder.display(),
            effects_args::line_below(verbosity, &self.effects)
        )
    }
}

/// What the refinement of poses did, in words.
fn poses_line(report: &PosesReport, matched: Option<PoseMatched>) -> String {
    let PosesReport { used, trial_db, median_px, median_degrees, most_degrees, median_percent, most_percent, .. } =
        *report;
    if !used {
        let gain = trial_db.unwrap_or_default();
        return format!(
            "poses were not refined: in a short trial, aligning views to their images did not make them better ({gain:+.2} dB in the mean)"
        );
    }
    let matched = matched.map_or_else(String::new, |PoseMatched { psnr, ssim, .. }| {
        format!(
            "; with the poses of held-out views aligned to the left halves of their images, the right halves have \
             {psnr:.2} dB, {ssim:.4}"
        )
    });
    format!(
        "poses were refined: images moved by {median_px:.2} px, cameras turned by {median_degrees:.3} degrees and \
         moved by {median_percent:.3} % of the scene in the median, by {most_degrees:.3} degrees and {most_percent:.3} % at most{matched}"
    )
}

/// The folder of the data set with refined cameras among the results.
const CAMERAS: &str = "refined";

/// The folder for them as COLMAP's text model.
const COLMAP: &str = "refined/colmap-model";

/// Where results go, and what else they contain.
pub(super) struct Results<'a> {
    pub(super) run: &'a Run,
    pub(super) input: Input<'a>,
    pub(super) backend: &'a Chosen,
}

impl Results<'_> {
    /// Writes them all, the scene first.
    pub(super) fn write(
        &self,
        trainer: &Trainer3d<'_, AnyRasterizer>,
        log: &MetricsLog,
        points: &[CurvePoint],
    ) -> Result<Summary<'_>, Failure> {
        let phases = &self.run.job.phases;
        phases.end("training");
        // All other results can be made of the scene.
        let scene = without_broken(trainer.scene().block_on()?)?;
        let mut tried = vec![
            self.write_scene(&scene, &trainer.shown(), trainer.views().frame),
            write_table(&self.run.folder, log),
            trainer
                .settings_to_repeat()
                .to_toml()
                .map_err(Failure::failed)
                .and_then(|text| self.run.folder.write("settings.toml", &text)),
            // Existing files are of an earlier fit.
            self.run.folder.leave_out(["scene.gs2d.safetensors", "reconstruction.png", "ellipses.png"]),
            self.write_cameras(trainer),
            match !self.run.job.pictures {
                true => self.run.folder.leave_out(["curve.svg"]),
                false => self.write_curve(trainer.count(), points, log),
            },
        ];
        phases.end("scene");
        let effects = self.run.job.effects.choose(&scene, &cameras(trainer.views()), &trainer.shown());
        let gaussians = scene.len();
        // Else this copy would be there when the passes below take the most memory.
        drop(scene);
        phases.end("effects");
        let evaluation = match !self.run.job.pictures {
            true => {
                tried.push(ViewPictures::clear(&self.run.folder));
                trainer.evaluate(&|_, _, _| Ok(())).block_on().map_err(Failure::from)
            }
            false => self.write_views(trainer, &mut tried),
        };
        let summary = evaluation.and_then(|evaluation| {
            phases.end("evaluation");
            tried.push(self.run.folder.write_json("evaluation.json", &evaluation));
            self.summary(trainer, evaluation, gaussians, effects?.decisions)
        });
        results::end(&self.run.folder, tried, summary, ["evaluation.json", "summary.json"])
    }

    /// Evaluates the scene and writes some of its views beside their images. Failures of pictures are
    /// added to `tried`: they do not stop the evaluation.
    fn write_views(
        &self,
        trainer: &Trainer3d<'_, AnyRasterizer>,
        tried: &mut Vec<Result<(), Failure>>,
    ) -> Result<Evaluation, Failure> {
        let background = trainer.shown().background_color();
        let views = trainer.evaluation_views();
        let count = views.len().min(MOST_PICTURES);
        let chosen: Vec<usize> = (0..count).map(|picture| picture * views.len() / count).collect();
        let names = chosen.iter().map(|&view| views[view].name.as_str());
        let prepared = ViewPictures::prepare(&self.run.folder, names);
        let failures = Mutex::new(Vec::new());
        let evaluation = block_on(trainer.evaluate(&|number, posed, rendered| {
            let Ok((pictures, names)) = &prepared else { return Ok(()) };
            let Ok(picture) = chosen.binary_search(&number) else { return Ok(()) };
            let written = pictures.write(&names[picture], posed.clone().over(background)?, rendered);
            if let Err(error) = written {
                failures.lock().unwrap_or_else(PoisonError::into_inner).push((picture, Failure::from(error)));
            }
            Ok(())
        }));
        let mut failures = failures.into_inner().unwrap_or_else(PoisonError::into_inner);
        failures.sort_unstable_by_key(|(picture, _)| *picture);
        tried.extend(failures.into_iter().map(|(_, failure)| Err(failure)));
        tried.extend(prepared.err().map(Err));
        Ok(evaluation?)
    }

    fn summary(
        &self,
        trainer: &Trainer3d<'_, AnyRasterizer>,
        evaluation: Evaluation,
        gaussians: usize,
        effects: Vec<EffectDecision>,
    ) -> Result<Summary<'_>, Failure> {
        let mut training = TrainSummary::new(trainer, evaluation).block_on()?;
        self.run.job.phases.end("training-views");
        // The file has no Gaussians that are not finite.
        training.gaussians = gaussians as u32;
        training.backend = self.backend.rasterizer.name().to_owned();
        training.threads = u32::try_from(self.backend.threads).ok();
        Ok(Summary {
            names_gaussians: self.input.names_gaussians,
            training,
            program: ProgramSummary::new(self.backend, self.run),
            dataset: self.input.path.display().to_string(),
            images: trainer.views().reading(),
            phases: &self.run.job.phases,
            split: self.input.dataset.split,
            effects,
        })
    }

    fn write_scene(&self, scene: &Scene3d, shown: &RenderSettings, frame: WorldFrame) -> Result<(), Failure> {
        if scene.is_empty() {
            output::note("note: no Gaussian is left, so there is no scene.ply");
            return self.run.folder.leave_out(["scene.ply"]);
        }
        let trained_with = TrainedWith::default().with(|s| {
            s.antialias = Some(shown.effects.antialias);
            s.order = Some(shown.effects.order);
            s.frame = frame;
        });
        let options = WriteOptions3d::default().with(|s| s.trained_with = trained_with);
        let write = |path: &Path| write_3d(path, scene, &options).map(drop);
        self.run.folder.write_precious("scene.ply", write)
    }

    /// Writes the data set with the refined cameras into [`CAMERAS`], if there are any.
    fn write_cameras(&self, trainer: &Trainer3d<'_, AnyRasterizer>) -> Result<(), Failure> {
        let folder = &self.run.folder;
        let [file, points] = ["transforms.json", "points.ply"].map(|name| format!("{CAMERAS}/{name}"));
        folder.leave_out(folder.claimed(&format!("{CAMERAS}/")))?;
        // Fails if there are other files, which is intended.
        let _ = [COLMAP, CAMERAS].map(|name| std::fs::remove_dir(folder.path().join(name)));
        if !trainer.poses().is_some_and(|poses| poses.used) {
            return Ok(());
        }
        let dataset = self.input.dataset;
        let refined =
            dataset.views_of(Split::Train).map(|view| view.name.as_str()).zip(trainer.views().train_cameras());
        let refined: HashMap<&str, &Camera> = refined.collect();
        let has_points = !dataset.points.is_empty();
        let camera = |view: &View| refined.get(&*view.name).map_or(view.camera, |camera| **camera);
        let transforms = dataset.transforms_json(camera, has_points.then_some("points.ply"));
        let transforms = transforms.map(|text| (file, text.into_bytes()));
        let points = (has_points && transforms.is_some()).then(|| (points, dataset.points_ply().into_bytes()));
        let model = dataset.colmap_text(camera);
        let made = if model.is_some() { COLMAP } else { CAMERAS };
        let model = model.into_iter().flatten().map(|(name, text)| (format!("{COLMAP}/{name}"), text.into_bytes()));
        let files: Vec<_> = transforms.into_iter().chain(points).chain(model).collect();
        if files.is_empty() {
            output::note("note: the refined cameras were not written, because no format has a form for their lens");
            return Ok(());
        }
        folder.make(made)?;
        folder.write_all(files)
    }

    fn write_curve(&self, count: u32, points: &[CurvePoint], log: &MetricsLog) -> Result<(), Failure> {
        let dataset = self.input.path;
        // Also if the path is `.`.
        let path = dataset.canonicalize().unwrap_or_else(|_| dataset.to_owned());
        let name =
            path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned());
        let title = format!("{name}: {}", counted(count, "Gaussian"));
        write_curve(&self.run.folder, points, log, &title)
    }
}

/// Some of the cameras that evaluate a scene.
fn cameras(views: &Views) -> Vec<Camera> {
    let all: Vec<Camera> = views.test_or_train().iter().map(|view| view.camera).collect();
    sampled(&all, EFFECT_VIEWS)
}
