//! What a fit leaves behind in its folder. Each file appears complete or not at all, none of an earlier fit stays beside them, and none that
//! fails takes another with it; the summary comes last.

use pollster::FutureExt as _;
use std::{path::Path, thread, time::Instant};

use gs_core::{
    Blend, Canvas, Culled, Image, Optimizer, Scene, Scene2d, counted,
    effects::EffectDecision,
    examination::{self, Examinable},
};
use gs_io::{File2d, write_ply, write_png, write_scene};
use gs_lab::figure::{
    curve::{self, Point},
    ellipses,
};
use gs_train::{ColorRange, FitSummary, MetricsLog, Trainer, Viewable};
use serde::Serialize;

use crate::{
    backend::{Backend, run_on_processor},
    commands::convert::scene2d::ForViewers,
    effects::choice::{EffectsArgs, told_in},
    failure::Failure,
    fit::{arguments::Pictures, observers::write_table, target::Target, trouble::Trouble},
    memory, output,
    output_folder::OutputFolder,
    settings_file::to_toml,
    training_arguments::Detail,
};

/// What `summary.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
pub(crate) struct Summary {
    #[serde(flatten)]
    fit: FitSummary,
    /// The GPU, or the driver that stands in for one; none on the processor.
    adapter: Option<String>,
    /// SIMD level; none on a GPU.
    simd: Option<String>,
    /// The whole time of the program, pictures included, and that of the fit before it was resumed, s.
    total_seconds: f64,
    /// The most memory that the program has had, bytes; none where the system does not tell.
    peak_memory: Option<u64>,
    /// The image; none is the paper's circle and square.
    image: Option<String>,
    /// Which effects the scene calls for at the image's size, and why.
    effects: Vec<EffectDecision>,
}

impl Summary {
    /// The summary for people.
    pub(crate) fn text(&self, folder: &Path, detail: Detail) -> String {
        let FitSummary {
            gaussians,
            iterations,
            seconds,
            psnr,
            ssim,
            ms_ssim,
            edits,
            culled,
            clamped,
            fresh_starts,
            shortfall,
            ..
        } = &self.fit;
        let shortfall = shortfall.as_ref().map_or_else(String::new, |shortfall| format!("\nnote: {shortfall}"));
        let psnr = match psnr.is_finite() {
            true => format!("{psnr:.2} dB"),
            false => "infinite (every pixel is exact)".to_owned(),
        };
        let trouble = Trouble::new(detail, edits, *culled, *clamped, fresh_starts);
        let ms_ssim = ms_ssim.map_or_else(String::new, |value| format!(", MS-SSIM {value:.4}"));
        format!(
            "{} after {} in {seconds:.2} s ({:.2} s in all): PSNR {psnr}, SSIM {ssim:.4}{ms_ssim}{trouble}; see {}{}{shortfall}",
            counted(*gaussians, "Gaussian"),
            counted(*iterations, "step"),
            self.total_seconds,
            folder.display(),
            told_in(detail, &self.effects)
        )
    }
}

/// How the scene looks.
struct Looks {
    /// At the image's size.
    reconstruction: Image,
    /// Gaussians that it was rendered without.
    culled: Culled,
    /// What ellipses are drawn over, and its canvas, where the image is too small for them.
    background: Option<(Image, Canvas)>,
}

/// Where results go and what they tell of besides the fit.
pub(crate) struct Results<'a> {
    pub(crate) folder: &'a OutputFolder,
    pub(crate) target: &'a Target,
    pub(crate) backend: &'a Backend,
    pub(crate) effects: &'a EffectsArgs,
    pub(crate) pictures: Pictures,
    /// When the program began.
    pub(crate) started: Instant,
    /// Time spent before, as the checkpoint that was resumed has it, s.
    pub(crate) seconds_before: f64,
}

impl Results<'_> {
    /// Writes them all, the scene first, and the others even where one fails; pictures are made and packed side by side with the measuring of
    /// the quality.
    ///
    /// # Errors
    /// The first of what failed: where a file cannot be written, or the backend fails.
    pub(crate) fn write<R: Optimizer<Scene2d>>(
        &self,
        rasterizer: &R,
        trainer: &Trainer<'_, R>,
        log: &MetricsLog,
        points: &[Point],
    ) -> Result<Summary, Failure> {
        let render = trainer.shown();
        let (width, height) = trainer.target().size();
        let file = File2d { scene: sound(trainer.scene().block_on()?)?, width, height, settings: render };
        // Before anything else: all the rest can be made of it again.
        let mut tried = vec![self.folder.write_precious("scene.gs2d.safetensors", |path| write_scene(path, &file))];
        let mut looks = self.look(rasterizer, trainer, &file);
        let background = looks.as_mut().ok().and_then(|looks| looks.background.take());
        let settings = to_toml(trainer.settings());
        let title = format!("{}: {}", self.target.title(), counted(trainer.count(), "Gaussian"));

        let fit = thread::scope(|scope| {
            let (file, looks) = (&file, looks.as_ref());
            let drawn = looks.ok().map(|looks| scope.spawn(move || self.write_looks(file, looks)));
            let ellipses = background
                .map(|(picture, canvas)| scope.spawn(move || vec![self.write_ellipses(&file.scene, picture, &canvas)]));
            let others = scope.spawn(|| {
                vec![
                    write_table(self.folder, log),
                    settings.and_then(|text| self.folder.write("settings.toml", &text)),
                    match self.pictures {
                        Pictures::All => self.write_curve(points, log, &title),
                        Pictures::Reconstruction => {
                            ["ellipses.png", "curve.png"].iter().try_for_each(|name| self.folder.leave_out(name))
                        }
                    },
                ]
            });
            let fit = looks.map_err(Failure::clone).and_then(|Looks { reconstruction, culled, .. }| {
                FitSummary::new(trainer, reconstruction, *culled).block_on().map_err(Failure::from)
            });
            for thread in drawn.into_iter().chain([others]).chain(ellipses) {
                tried.extend(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
            }
            fit
        });
        if let Ok(Looks { reconstruction, .. }) = looks {
            tried.push(self.write_ellipses_over(&file, reconstruction));
        }
        // What a training left here would be taken for this fit's.
        tried.push(self.folder.leave_out("evaluation.json"));
        let summary = fit.and_then(|fit| self.summary(fit, &file));
        match &summary {
            Ok(summary) => tried.push(self.folder.write_json("summary.json", summary)),
            Err(failure) => tried.extend([Err(failure.clone()), self.folder.leave_out("summary.json")]),
        }
        Failure::first_of(tried)?;
        summary
    }

    /// What needs the backend, which may fail where no file does.
    fn look<R: Optimizer<Scene2d>>(
        &self,
        rasterizer: &R,
        trainer: &Trainer<'_, R>,
        file: &File2d,
    ) -> Result<Looks, Failure> {
        let (reconstruction, culled) = trainer.render().block_on()?;
        let large = ellipses::canvas_for(canvas_of(file));
        let background = match self.pictures {
            Pictures::All if large != canvas_of(file) => {
                Some((rasterizer.render(&file.scene, &large, &file.settings).block_on()?, large))
            }
            Pictures::All | Pictures::Reconstruction => None,
        };
        Ok(Looks { reconstruction, culled, background })
    }

    fn summary(&self, mut fit: FitSummary, file: &File2d) -> Result<Summary, Failure> {
        let canvas = canvas_of(file);
        // Those that are not finite are not in the file.
        fit.gaussians = file.scene.len() as u32;
        fit.culled.not_finite = 0;
        fit.backend = self.backend.name.to_owned();
        fit.threads = u32::try_from(self.backend.threads).ok();
        Ok(Summary {
            fit,
            adapter: self.backend.adapter.clone(),
            simd: self.backend.simd.clone(),
            total_seconds: self.seconds_before + self.started.elapsed().as_secs_f64(),
            peak_memory: memory::peak(),
            image: self.target.file.as_ref().map(|file| file.display().to_string()),
            effects: self.effects.choose(&file.scene, &[canvas], &file.settings)?.decisions,
        })
    }

    fn write_looks(&self, file: &File2d, looks: &Looks) -> Vec<Result<(), Failure>> {
        let reconstruction = write_png(self.folder.file("reconstruction.png"), &looks.reconstruction);
        vec![reconstruction.map_err(Failure::from), self.write_ply(file)]
    }

    fn write_ellipses(&self, scene: &Scene2d, mut picture: Image, canvas: &Canvas) -> Result<(), Failure> {
        ellipses::draw(&mut picture, scene, canvas);
        Ok(write_png(self.folder.file("ellipses.png"), &picture)?)
    }

    /// Draws the ellipses over the reconstruction itself, where that is large enough for them. It comes last: a large image is there only once.
    fn write_ellipses_over(&self, file: &File2d, reconstruction: Image) -> Result<(), Failure> {
        let canvas = canvas_of(file);
        match self.pictures {
            Pictures::All if ellipses::canvas_for(canvas) == canvas => {
                self.write_ellipses(&file.scene, reconstruction, &canvas)
            }
            Pictures::All | Pictures::Reconstruction => Ok(()),
        }
    }

    /// The scene for splat viewers. A sum has none: none of them shows it, and to convert it is a training of its own.
    fn write_ply(&self, file: &File2d) -> Result<(), Failure> {
        if file.settings.effects.blend == Blend::Sum {
            return self.folder.leave_out("scene.ply");
        }
        if file.scene.is_empty() {
            output::note("note: no Gaussian is left, so there is no scene.ply");
            return self.folder.leave_out("scene.ply");
        }
        let range = ColorRange::NotNegative;
        let Viewable { file, psnr, .. } = run_on_processor(self.backend, ForViewers { file, range })??;
        write_ply(self.folder.file("scene.ply"), &file)?;
        output::note(format_args!("scene.ply shows the reconstruction in splat viewers, at {psnr:.2} dB"));
        Ok(())
    }

    fn write_curve(&self, points: &[Point], log: &MetricsLog, title: &str) -> Result<(), Failure> {
        let picture = curve::draw(points, &curve::measured(log.rows()), title)?;
        Ok(write_png(self.folder.file("curve.png"), &picture)?)
    }
}

/// The image's own size.
fn canvas_of(file: &File2d) -> Canvas {
    Canvas::new(file.width, file.height)
}

/// The scene without what cannot be drawn, which a fit that was stopped may hold, and which no file takes; told where there is any.
pub(crate) fn sound<S: Examinable>(mut scene: S) -> Result<S, Failure> {
    match examination::repair(&mut scene)?.removed {
        0 => {}
        1 => output::note("note: 1 Gaussian is not finite and is left out of the scene"),
        removed => output::note(format_args!("note: {removed} Gaussians are not finite and are left out of the scene")),
    }
    Ok(scene)
}
