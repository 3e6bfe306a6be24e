//! What a fit leaves behind in its folder. Each file appears complete or not at all, and none of an earlier fit stays beside them;
//! the summary comes last, so that whoever sees it finds the rest.

use std::{path::Path, thread, time::Instant};

use gs_core::{Blend, Canvas, Image, PlanarScene, Rasterizer, RenderSettings, Scene, effects::Statistics};
use gs_io::{PlanarFile, PlyColors, write_ply, write_png, write_scene};
use gs_train::{FitSummary, Trainer};
use serde::Serialize;

use crate::{
    backend::Backend,
    failure::Failure,
    fit::{arguments::Pictures, folder::OutputFolder, settings, target::Target},
    output,
    report::{
        curve::{self, Point},
        ellipses,
    },
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
    /// The image; none is the paper's circle and square.
    image: Option<String>,
}

impl Summary {
    /// The summary for people.
    pub(crate) fn text(&self, folder: &Path) -> String {
        let FitSummary { gaussians, iterations, seconds, psnr, ssim, ms_ssim, .. } = &self.fit;
        let ms_ssim = ms_ssim.map_or_else(String::new, |value| format!(", MS-SSIM {value:.4}"));
        format!(
            "{gaussians} Gaussians after {iterations} steps in {seconds:.2} s ({:.2} s in all): PSNR {psnr:.2} dB, SSIM \
             {ssim:.4}{ms_ssim}; see {}",
            self.total_seconds,
            folder.display()
        )
    }
}

/// Where results go and what they tell of besides the fit.
pub(crate) struct Results<'a> {
    pub(crate) folder: &'a OutputFolder,
    pub(crate) target: &'a Target,
    pub(crate) backend: &'a Backend,
    pub(crate) pictures: Pictures,
    /// When the program began.
    pub(crate) started: Instant,
    /// Time spent before, as the checkpoint that was resumed has it, s.
    pub(crate) seconds_before: f64,
}

impl Results<'_> {
    /// Writes them all; pictures are made and packed side by side with the measuring of the quality.
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub(crate) fn write<R: Rasterizer<PlanarScene>>(
        &self,
        rasterizer: &R,
        trainer: &Trainer<'_, R>,
        metrics: &str,
        points: &[Point],
    ) -> Result<Summary, Failure> {
        let (reconstruction, culled) = trainer.render()?;
        let (width, height) = reconstruction.size();
        let render = shown(trainer.settings().render);
        let file = PlanarFile { scene: trainer.scene()?, width, height, settings: render };
        let large = ellipses::canvas_for(Canvas::new(width, height));
        let backdrop = match self.pictures {
            Pictures::All => Some(rasterizer.render(&file.scene, &large, &render)?),
            Pictures::Reconstruction => None,
        };
        let settings = settings::to_toml(trainer.settings())?;
        let title = format!("{}: {} Gaussians", self.target.name(), trainer.count());

        let scene = &file.scene;
        let fit = thread::scope(|scope| {
            let ellipses = backdrop.map(|mut picture| {
                scope.spawn(move || {
                    ellipses::draw(&mut picture, scene, &large);
                    write_png(self.folder.file("ellipses.png"), &picture).map_err(Failure::from)
                })
            });
            let files = scope.spawn(|| {
                write_png(self.folder.file("reconstruction.png"), &reconstruction)?;
                self.write_scene(&file, &reconstruction)?;
                self.folder.write_text("metrics.csv", metrics)?;
                self.folder.write_text("settings.toml", &settings)?;
                match self.pictures {
                    Pictures::All => self.write_curve(points, &title),
                    Pictures::Reconstruction => {
                        ["ellipses.png", "curve.png"].iter().try_for_each(|name| self.folder.leave_out(name))
                    }
                }
            });
            let fit = FitSummary::new(trainer, &reconstruction, culled).map_err(Failure::from);
            for thread in ellipses.into_iter().chain([files]) {
                thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            }
            fit
        })?;
        let summary = Summary {
            fit: FitSummary {
                backend: self.backend.name.to_owned(),
                threads: u32::try_from(self.backend.threads).ok(),
                ..fit
            },
            adapter: self.backend.adapter.clone(),
            simd: self.backend.simd.clone(),
            total_seconds: self.seconds_before + self.started.elapsed().as_secs_f64(),
            image: self.target.file.as_ref().map(|file| file.display().to_string()),
        };
        self.folder.write_json("summary.json", &summary)?;
        Ok(summary)
    }

    fn write_scene(&self, file: &PlanarFile, reconstruction: &Image) -> Result<(), Failure> {
        write_scene(self.folder.file("scene.gs2d.safetensors"), file)?;
        if file.scene.is_empty() {
            output::note("note: no Gaussian is left, so there is no scene.ply");
            return self.folder.leave_out("scene.ply");
        }
        let colors = match file.settings.effects.blend {
            Blend::Sum => PlyColors::Sampled(reconstruction),
            Blend::Over => PlyColors::Stored,
        };
        Ok(write_ply(self.folder.file("scene.ply"), file, colors)?)
    }

    fn write_curve(&self, points: &[Point], title: &str) -> Result<(), Failure> {
        let picture = curve::draw(points, title).map_err(|error| Failure::failed(error).at("curve.png"))?;
        Ok(write_png(self.folder.file("curve.png"), &picture)?)
    }
}

/// What a scene is shown with: statistics are a matter of training.
fn shown(mut render: RenderSettings) -> RenderSettings {
    render.effects.statistics = Statistics::None;
    render
}
