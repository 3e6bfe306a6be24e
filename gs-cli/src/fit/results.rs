//! What a fit leaves behind in its folder. Each file appears complete or not at all; the summary last, so that whoever sees it
//! finds the rest.

use std::{fs, path::Path, thread, time::Instant};

use gs_core::{Blend, Canvas, Image, PlanarScene, Rasterizer, RenderSettings, Scene, effects::Statistics};
use gs_io::{PlanarFile, PlyColors, write_atomically, write_ply, write_png, write_scene};
use gs_train::{FitSummary, MetricsLog, Trainer};
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
    /// SIMD level.
    simd: String,
    /// The whole time of the program, pictures included, s.
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
        let (reconstruction, culled) = (trainer.rendered()?, trainer.quality()?.culled);
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
                self.write_text("metrics.csv", metrics)?;
                self.write_text("settings.toml", &settings)?;
                match self.pictures {
                    Pictures::All => self.write_curve(points, &title),
                    Pictures::Reconstruction => Ok(()),
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
            simd: self.backend.simd.clone(),
            total_seconds: self.started.elapsed().as_secs_f64(),
            image: self.target.file.as_ref().map(|file| file.display().to_string()),
        };
        let json = serde_json::to_string_pretty(&summary).map_err(|error| Failure::failed(error).at("summary.json"))?;
        self.write_text("summary.json", &(json + "\n"))?;
        Ok(summary)
    }

    fn write_scene(&self, file: &PlanarFile, reconstruction: &Image) -> Result<(), Failure> {
        write_scene(self.folder.file("scene.gs2d.safetensors"), file)?;
        if file.scene.is_empty() {
            output::note("note: no Gaussian is left, so there is no scene.ply");
            return Ok(());
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

    fn write_text(&self, name: &str, text: &str) -> Result<(), Failure> {
        Ok(write_atomically(self.folder.file(name), |file| file.write_all(text.as_bytes()))?)
    }
}

/// What a scene is shown with: statistics are a matter of training.
fn shown(mut render: RenderSettings) -> RenderSettings {
    render.effects.statistics = Statistics::None;
    render
}

/// The metrics of the steps before a fit was resumed, as an earlier run left them in the folder.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct History {
    rows: Vec<String>,
}

impl History {
    /// The rows up to `step` of the folder's `metrics.csv`; none where there is no such file.
    pub(crate) fn read(folder: &OutputFolder, step: u32) -> Self {
        let text = fs::read_to_string(folder.file("metrics.csv")).unwrap_or_default();
        let rows = text.lines().filter(|row| point(row).is_some_and(|point| point.step <= step));
        Self { rows: rows.map(str::to_owned).collect() }
    }

    /// Their points of the curve.
    pub(crate) fn points(&self) -> Vec<Point> {
        self.rows.iter().filter_map(|row| point(row)).collect()
    }

    /// The whole table: these rows and those of the run that followed.
    pub(crate) fn with(&self, log: &MetricsLog) -> String {
        let csv = log.to_csv();
        let (heading, new_rows) = csv.split_once('\n').unwrap_or((&csv, ""));
        let old_rows = self.rows.iter().map(String::as_str);
        [heading].into_iter().chain(old_rows).chain(new_rows.lines()).map(|row| format!("{row}\n")).collect()
    }
}

/// Step, count and loss of a row of `metrics.csv`; none of its heading.
fn point(row: &str) -> Option<Point> {
    let cells: Vec<&str> = row.split(',').collect();
    let [step, _, count, .., loss, _l1, _psnr] = cells[..] else { return None };
    Some(Point { step: step.parse().ok()?, count: count.parse().ok()?, loss: loss.parse().ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_fit_keeps_the_rows_before_it() {
        let log = MetricsLog::new(1);
        let heading = log.to_csv();
        let old = "1,0.1,20,0,0,0,0,0,0,0,0.5,0.4,12\n2,0.2,30,5,5,0,0,0,0,0,0.25,0.3,15\n";
        let place = tempfile::tempdir().unwrap();
        let folder = OutputFolder::prepare(place.path(), "--output").unwrap();
        fs::write(folder.file("metrics.csv"), format!("{heading}{old}")).unwrap();
        let (one, both) = (History::read(&folder, 1), History::read(&folder, 7));

        assert_eq!(one.points(), [Point { step: 1, count: 20, loss: 0.5 }]);
        assert_eq!(both.with(&log), format!("{heading}{old}"));
        assert_eq!(History::default().with(&log), heading);
    }
}
