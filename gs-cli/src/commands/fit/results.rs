//! The results of a fit. Each file is written completely or not at all, and a failure of one does
//! not keep the others from being written. Files of an earlier run are removed. The summary comes
//! last.

use std::{path::Path, thread};

use gs_backend::{AnyRasterizer, Chosen, FutureExt as _};
use gs_core::{Canvas, Culled, Image, Rasterizer as _, Scene as _, Scene2d, counted, effects::EffectDecision};
use gs_io::{File2d, write_2d, write_png};
use gs_lab::report::{curve::CurvePoint, ellipses};
use gs_train::{FitSummary, MetricsLog, SettingsFile as _, Trainer};
use serde::Serialize;

use crate::{
    failure::Failure,
    flags::effects_args,
    image_fit::{FitImage, batch::Row},
    terminal::output::Verbosity,
    training::{
        job::Run,
        results::{self, Problems, ProgramSummary, without_broken, write_curve, write_table},
    },
};

/// What `summary.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
pub(crate) struct Summary {
    #[serde(flatten)]
    fit: FitSummary,
    #[serde(flatten)]
    program: ProgramSummary,
    /// The image; `null` is the paper's circle and square.
    image: Option<String>,
    /// Which effects the scene requires at the image's size, and why.
    effects: Vec<EffectDecision>,
}

impl Summary {
    /// The line of a table of several fits.
    pub(super) fn row(&self, size: (u32, u32), bytes: u64) -> Row {
        let FitSummary { gaussians, psnr, seconds, .. } = self.fit;
        Row { size, bytes, gaussians: gaussians as usize, psnr, seconds }
    }
}

impl results::Summary for Summary {
    fn text(&self, folder: &Path, verbosity: Verbosity) -> String {
        let FitSummary { gaussians, iterations, seconds, psnr, ssim, ms_ssim, culled, clamped, .. } = &self.fit;
        let shortfall = self.fit.shortfall.as_ref();
        let shortfall = shortfall.map_or_else(String::new, |shortfall| format!("\nnote: {shortfall}"));
        let psnr = match psnr.is_finite() {
            true => format!("{psnr:.2} dB"),
            false => "infinite (every pixel is exact)".to_owned(),
        };
        let problems = Problems::new(verbosity, &self.fit.edits, *culled, *clamped, &self.fit.fresh_starts);
        let ms_ssim = ms_ssim.map_or_else(String::new, |value| format!(", MS-SSIM {value:.4}"));
        format!(
            "{} after {} in {seconds:.2} s ({:.2} s in all): PSNR {psnr}, SSIM {ssim:.4}{ms_ssim}{problems}; see {}{}{shortfall}",
            counted(*gaussians, "Gaussian"),
            counted(*iterations, "step"),
            self.program.total_seconds,
            folder.display(),
            effects_args::line_below(verbosity, &self.effects)
        )
    }
}

/// Renderings of the scene.
struct Renderings {
    /// Rendering at the image's size.
    reconstruction: Image,
    /// Gaussians that are not in it.
    culled: Culled,
    /// What ellipses are drawn over, and its canvas, if the image is too small for them.
    background: Option<(Image, Canvas)>,
}

/// Where results go, and what else they contain.
pub(crate) struct Results<'a> {
    pub(super) run: &'a Run,
    pub(super) target: &'a FitImage,
    pub(super) backend: &'a Chosen,
}

impl Results<'_> {
    /// Writes them all, the scene first. Pictures are drawn and encoded in parallel with the
    /// evaluation.
    pub(crate) fn write(
        &self,
        trainer: &Trainer<'_, AnyRasterizer>,
        log: &MetricsLog,
        points: &[CurvePoint],
    ) -> Result<Summary, Failure> {
        let (width, height) = trainer.target().size();
        let scene = without_broken(trainer.scene().block_on()?)?;
        let file = File2d { scene, width, height, settings: trainer.shown(), profile: None };
        // All other results can be made of the scene.
        let mut tried = vec![self.run.folder.write_precious("scene.gs2d.safetensors", |path| write_2d(path, &file))];
        let mut renderings = self.render(trainer, &file);
        let background = renderings.as_mut().ok().and_then(|renderings| renderings.background.take());
        let settings = trainer.settings().to_toml().map_err(Failure::failed);
        let title = format!("{}: {}", self.target.title(), counted(trainer.count(), "Gaussian"));

        let fit = thread::scope(|scope| {
            let (file, renderings) = (&file, renderings.as_ref());
            let drawn = renderings
                .ok()
                .map(|made| scope.spawn(move || vec![self.write_picture("reconstruction.png", &made.reconstruction)]));
            let ellipses = background
                .map(|(picture, canvas)| scope.spawn(move || vec![self.write_ellipses(&file.scene, picture, &canvas)]));
            let others = scope.spawn(|| {
                vec![
                    write_table(&self.run.folder, log),
                    settings.and_then(|text| self.run.folder.write("settings.toml", &text)),
                    match self.explains() {
                        true => write_curve(&self.run.folder, points, log, &title),
                        false => self.run.folder.leave_out(["ellipses.png", "curve.svg"]),
                    },
                ]
            });
            let fit = renderings.map_err(Failure::clone).and_then(|Renderings { reconstruction, culled, .. }| {
                FitSummary::new(trainer, reconstruction, *culled).block_on().map_err(Failure::from)
            });
            for thread in drawn.into_iter().chain([others]).chain(ellipses) {
                tried.extend(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
            }
            fit
        });
        if let Ok(Renderings { reconstruction, .. }) = renderings {
            tried.push(self.write_ellipses_over(&file, reconstruction));
        }
        // Existing files are of an earlier training.
        tried.push(self.run.folder.leave_out(["evaluation.json", "scene.ply"]));
        let summary = fit.and_then(|fit| self.summary(fit, &file));
        results::end(&self.run.folder, tried, summary, ["summary.json"])
    }

    /// Whether pictures that explain the result are drawn.
    fn explains(&self) -> bool {
        self.run.job.pictures
    }

    /// Renders what the pictures need. The backend may fail here.
    fn render(&self, trainer: &Trainer<'_, AnyRasterizer>, file: &File2d) -> Result<Renderings, Failure> {
        let (reconstruction, culled) = trainer.render().block_on()?;
        let large = ellipses::canvas_for(canvas_of(file));
        let background = match self.explains() && large != canvas_of(file) {
            true => Some((self.backend.rasterizer.render(&file.scene, &large, &file.settings).block_on()?, large)),
            false => None,
        };
        Ok(Renderings { reconstruction, culled, background })
    }

    fn summary(&self, mut fit: FitSummary, file: &File2d) -> Result<Summary, Failure> {
        let canvas = canvas_of(file);
        // The file has no Gaussians that are not finite.
        fit.gaussians = file.scene.len() as u32;
        fit.culled.not_finite = 0;
        fit.backend = self.backend.rasterizer.name().to_owned();
        fit.threads = u32::try_from(self.backend.threads).ok();
        Ok(Summary {
            fit,
            program: ProgramSummary::new(self.backend, self.run),
            image: self.target.file.as_ref().map(|file| file.display().to_string()),
            effects: self.run.job.effects.choose(&file.scene, &[canvas], &file.settings)?.decisions,
        })
    }

    fn write_picture(&self, name: &str, picture: &Image) -> Result<(), Failure> {
        Ok(write_png(self.run.folder.file(name), picture)?)
    }

    fn write_ellipses(&self, scene: &Scene2d, mut picture: Image, canvas: &Canvas) -> Result<(), Failure> {
        ellipses::draw(&mut picture, scene, canvas);
        self.write_picture("ellipses.png", &picture)
    }

    /// Draws the ellipses over the reconstruction itself if it is large enough. This comes last, so
    /// that a large image needs no copy.
    fn write_ellipses_over(&self, file: &File2d, reconstruction: Image) -> Result<(), Failure> {
        let canvas = canvas_of(file);
        match self.explains() && ellipses::canvas_for(canvas) == canvas {
            true => self.write_ellipses(&file.scene, reconstruction, &canvas),
            false => Ok(()),
        }
    }
}

/// A canvas of the image's size.
fn canvas_of(file: &File2d) -> Canvas {
    Canvas::new(file.width, file.height)
}
