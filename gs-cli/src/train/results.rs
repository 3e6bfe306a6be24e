//! What a training leaves behind in its folder. Each file appears complete or not at all, and none takes another with it; the summary comes
//! last.

use pollster::{FutureExt as _, block_on};
use std::{path::Path, time::Instant};

use gs_core::{Camera, Canvas, Optimizer, RenderSettings, Scene, Scene3d, counted, effects::EffectDecision};
use gs_io::{WriteOptions3d, write_3d, write_png};
use gs_lab::{
    effects::sampled,
    figure::{
        curve::{self, Point},
        ellipses,
    },
};
use gs_train::{
    MetricsLog, Trainer3d,
    train::{DRIFT_DB, Evaluation, TrainSummary, TrainingViews, Views},
};
use serde::Serialize;

use crate::{
    backend::Backend,
    effects::choice::told_in,
    failure::Failure,
    fit::{observers::write_table, results::sound, trouble::Trouble},
    memory, output,
    output_folder::OutputFolder,
    settings_file::to_toml,
    shown::trained_with,
    train::{arguments::TrainArgs, pictures::ViewPictures},
    training_arguments::Detail,
};

/// The most views in which a scene is asked what it calls for.
const ASKED_VIEWS: usize = 8;

/// What `summary.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
pub(crate) struct Summary {
    #[serde(flatten)]
    training: TrainSummary,
    /// The GPU, or the driver that stands in for one; none on the processor.
    adapter: Option<String>,
    /// SIMD level; none on a GPU.
    simd: Option<String>,
    /// The whole time of the program, pictures included, and that of the training before it was resumed, s.
    total_seconds: f64,
    /// The most memory that the program has had, bytes; none where the system does not tell.
    peak_memory: Option<u64>,
    dataset: String,
    /// Which effects the scene calls for in the views that it is judged by, and why.
    effects: Vec<EffectDecision>,
}

impl Summary {
    /// The summary for people.
    pub(crate) fn text(&self, folder: &Path, detail: Detail) -> String {
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
            ..
        } = &self.training;
        let trouble = Trouble::new(detail, edits, evaluation.culled, *clamped, fresh_starts);
        let unmeasured = match evaluation.unmeasured.len() {
            0 => String::new(),
            count => format!(", without {count} of which no pixel counts"),
        };
        let whose = match test_views {
            0 => "views that it trained with".to_owned(),
            count => counted(*count, "held-out view"),
        };
        let trained = match training {
            Some(TrainingViews { views, psnr: Some(psnr), .. }) if *test_views > 0 => {
                format!(", PSNR {psnr:.2} dB over {} that it trained with", counted(*views, "view"))
            }
            _ => String::new(),
        };
        let drift = self.training.drift().map(|drift| {
            format!(
                "the scene fits the views that it trained with {drift:.1} dB better than those held out, more than {DRIFT_DB} dB: \
                 more steps or Gaussians may not help; more views, or fewer Gaussians (-n), may"
            )
        });
        let notes = [drift, shortfall.as_ref().map(ToString::to_string)].into_iter().flatten();
        let notes: String = notes.map(|note| format!("\nnote: {note}")).collect();
        format!(
            "{} after {} in {seconds:.1} s ({:.1} s in all): PSNR {:.2} dB, SSIM {:.4} over {whose}{unmeasured}{trained}{trouble}; \
             see {}{}{notes}",
            counted(*gaussians, "Gaussian"),
            counted(*iterations, "step"),
            self.total_seconds,
            evaluation.psnr,
            evaluation.ssim,
            folder.display(),
            told_in(detail, &self.effects)
        )
    }
}

/// Where results go and what they tell of besides the training.
pub(crate) struct Results<'a> {
    pub(crate) args: &'a TrainArgs,
    pub(crate) folder: &'a OutputFolder,
    pub(crate) backend: &'a Backend,
    /// When the program began.
    pub(crate) started: Instant,
    /// Time spent before, as the checkpoint that was resumed has it, s.
    pub(crate) seconds_before: f64,
}

impl Results<'_> {
    /// Writes them all, the scene first, and the others even where one fails.
    ///
    /// # Errors
    /// The first of what failed: where a file cannot be written, a photograph not be read, or the backend fails.
    pub(crate) fn write<R: Optimizer<Scene3d>>(
        &self,
        trainer: &Trainer3d<'_, R>,
        log: &MetricsLog,
        points: &[Point],
    ) -> Result<Summary, Failure> {
        // Before anything else: all the rest can be made of it again.
        let scene = sound(trainer.scene().block_on()?)?;
        let mut tried = vec![
            self.write_scene(&scene, &trainer.shown()),
            write_table(self.folder, log),
            to_toml(trainer.settings()).and_then(|text| self.folder.write("settings.toml", &text)),
            // What a fit left here would be taken for this training's.
            ["scene.gs2d.safetensors", "reconstruction.png"].iter().try_for_each(|name| self.folder.leave_out(name)),
            match self.args.no_report {
                true => ["ellipses.png", "curve.png"].iter().try_for_each(|name| self.folder.leave_out(name)),
                false => self.write_curve(trainer.count(), points, log),
            },
        ];
        let evaluation = match self.args.no_report {
            true => {
                tried.push(ViewPictures::clear(self.folder));
                trainer.evaluate(&mut |_, _| Ok(())).block_on().map_err(Failure::from)
            }
            false => {
                tried.push(self.write_ellipses(trainer, &scene));
                self.write_views(trainer, &mut tried)
            }
        };
        let summary = evaluation.and_then(|evaluation| {
            tried.push(self.folder.write_json("evaluation.json", &evaluation));
            self.summary(trainer, &scene, evaluation)
        });
        match &summary {
            Ok(summary) => tried.push(self.folder.write_json("summary.json", summary)),
            Err(failure) => tried.extend([
                Err(failure.clone()),
                ["evaluation.json", "summary.json"].iter().try_for_each(|name| self.folder.leave_out(name)),
            ]),
        }
        Failure::first_of(tried)?;
        summary
    }

    /// Judges the scene and writes its views beside their photographs. A picture that cannot be written is no reason not to judge: what became of
    /// them is added to `tried`.
    fn write_views<R: Optimizer<Scene3d>>(
        &self,
        trainer: &Trainer3d<'_, R>,
        tried: &mut Vec<Result<(), Failure>>,
    ) -> Result<Evaluation, Failure> {
        let background = trainer.shown().background_color();
        let judges = trainer.judges().into_iter().map(|view| view.name.as_str());
        let (pictures, names) = match ViewPictures::prepare(self.folder, judges) {
            Ok((pictures, names)) => (Some(pictures), names),
            Err(failure) => {
                tried.push(Err(failure));
                (None, Vec::new())
            }
        };
        let mut names = names.iter();
        let evaluation = block_on(trainer.evaluate(&mut |view, rendered| {
            if let Some((pictures, name)) = pictures.as_ref().zip(names.next()) {
                let photograph = view.image()?.over(background);
                tried.push(pictures.write(name, photograph, rendered).map_err(Failure::from));
            }
            Ok(())
        }));
        Ok(evaluation?)
    }

    fn summary<R: Optimizer<Scene3d>>(
        &self,
        trainer: &Trainer3d<'_, R>,
        scene: &Scene3d,
        evaluation: Evaluation,
    ) -> Result<Summary, Failure> {
        let mut training = TrainSummary::new(trainer, evaluation).block_on()?;
        // Those that are not finite are not in the file.
        training.gaussians = scene.len() as u32;
        training.backend = self.backend.name.to_owned();
        training.threads = u32::try_from(self.backend.threads).ok();
        Ok(Summary {
            training,
            adapter: self.backend.adapter.clone(),
            simd: self.backend.simd.clone(),
            total_seconds: self.seconds_before + self.started.elapsed().as_secs_f64(),
            peak_memory: memory::peak(),
            dataset: self.args.dataset.display().to_string(),
            effects: self.args.effects.choose(scene, &cameras(trainer.views()), &trainer.shown())?.decisions,
        })
    }

    /// The first of the views that judge, with Gaussians drawn over it.
    fn write_ellipses<R: Optimizer<Scene3d>>(
        &self,
        trainer: &Trainer3d<'_, R>,
        scene: &Scene3d,
    ) -> Result<(), Failure> {
        let Some(view) = trainer.judges().first().map(|view| view.camera) else { return Ok(()) };
        let Canvas { width, height, .. } = ellipses::canvas_for(Canvas::new(view.width, view.height));
        let camera = view.resized(width, height);
        let mut picture = trainer.render_view(&camera).block_on()?.clamped();
        ellipses::draw_3d(&mut picture, scene, &camera, &trainer.shown());
        Ok(write_png(self.folder.file("ellipses.png"), &picture)?)
    }

    fn write_scene(&self, scene: &Scene3d, shown: &RenderSettings) -> Result<(), Failure> {
        if scene.is_empty() {
            output::note("note: no Gaussian is left, so there is no scene.ply");
            return self.folder.leave_out("scene.ply");
        }
        let options = WriteOptions3d { trained_with: trained_with(shown), ..WriteOptions3d::default() };
        let write = |path: &Path| write_3d(path, scene, &options).map(drop);
        self.folder.write_precious("scene.ply", write)
    }

    fn write_curve(&self, count: u32, points: &[Point], log: &MetricsLog) -> Result<(), Failure> {
        let dataset = &self.args.dataset;
        // Without folders, also where it is called `.`.
        let path = dataset.canonicalize().unwrap_or_else(|_| dataset.clone());
        let name =
            path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned());
        let title = format!("{name}: {}", counted(count, "Gaussian"));
        let picture = curve::draw(points, &curve::measured(log.rows()), &title)?;
        Ok(write_png(self.folder.file("curve.png"), &picture)?)
    }
}

/// Some of the cameras by which a scene is judged, or that it was trained with.
fn cameras(views: &Views) -> Vec<Camera> {
    let judges = if views.test.is_empty() { &views.train } else { &views.test };
    sampled(&judges.iter().map(|view| view.camera).collect::<Vec<_>>(), ASKED_VIEWS)
}
