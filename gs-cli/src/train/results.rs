//! What a training leaves behind in its folder. Each file appears complete or not at all; the summary comes last, so that whoever sees it
//! finds the rest.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use gs_core::{Camera, Image, Rasterizer, Scene, SpatialScene, constants::MAX_SIDE_PX, effects::called_for::Verdict};
use gs_io::{SpatialOptions, write_png, write_spatial};
use gs_train::{
    SpatialTrainer,
    effects::sampled,
    spatial::{SpatialSummary, Views},
};
use serde::Serialize;

use crate::{
    backend::Backend,
    effects::choice::told,
    failure::Failure,
    fit::{folder::OutputFolder, results::sound, settings, trouble::Trouble},
    output,
    report::curve::{self, Point},
    train::arguments::TrainArgs,
};

/// Columns between a photograph and its rendering, px.
const GAP_PX: u32 = 4;

/// The most views in which a scene is asked what it calls for.
const ASKED_VIEWS: usize = 8;

/// What `summary.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
pub(crate) struct Summary {
    #[serde(flatten)]
    training: SpatialSummary,
    /// The GPU, or the driver that stands in for one; none on the processor.
    adapter: Option<String>,
    /// SIMD level; none on a GPU.
    simd: Option<String>,
    /// The whole time of the program, pictures included, s.
    total_seconds: f64,
    dataset: String,
    /// Which effects the scene calls for in the views that it is judged by, and why.
    effects: Vec<Verdict>,
}

impl Summary {
    /// The summary for people.
    pub(crate) fn text(&self, folder: &Path) -> String {
        let SpatialSummary { gaussians, iterations, seconds, evaluation, test_views, edits, clamped, .. } =
            &self.training;
        let trouble = Trouble::new(edits, evaluation.culled, *clamped);
        let unmeasured = match evaluation.unmeasured.len() {
            0 => String::new(),
            count => format!(", without {count} of which no pixel counts"),
        };
        let whose = match test_views {
            0 => "views that it trained with".to_owned(),
            count => format!("{count} held-out views"),
        };
        format!(
            "{gaussians} Gaussians after {iterations} steps in {seconds:.1} s ({:.1} s in all): PSNR {:.2} dB, SSIM {:.4} over \
             {whose}{unmeasured}{trouble}; see {}\n{}",
            self.total_seconds,
            evaluation.psnr,
            evaluation.ssim,
            folder.display(),
            told(&self.effects)
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
}

impl Results<'_> {
    /// Writes them all, the scene first.
    ///
    /// # Errors
    /// Where a file cannot be written, a photograph not be read, or the backend fails.
    pub(crate) fn write<R: Rasterizer<SpatialScene>>(
        &self,
        trainer: &SpatialTrainer<'_, R>,
        metrics: &str,
        points: &[Point],
    ) -> Result<Summary, Failure> {
        // Before anything else: all the rest can be made of it again.
        let scene = sound(trainer.scene()?)?;
        Failure::first_of([
            self.write_scene(&scene),
            self.folder.write_text("metrics.csv", metrics),
            self.folder.write_text("settings.toml", &settings::to_toml(trainer.settings())?),
            match self.args.no_report {
                true => self.folder.leave_out("curve.png"),
                false => self.write_curve(trainer.count(), points),
            },
        ])?;
        let views = self.empty_folder_of_views()?;
        let evaluation = if self.args.no_report {
            trainer.evaluate(&mut |_, _| Ok(()))?
        } else {
            let background = trainer.shown().backdrop();
            fs::create_dir_all(&views).map_err(|error| Failure::failed(error).at(views.display()))?;
            trainer.evaluate(&mut |view, rendered| {
                let picture = beside(view.photograph()?.over(background), rendered)?;
                Ok(write_png(views.join(format!("{}.png", file_name(&view.name))), &picture)?)
            })?
        };
        self.folder.write_json("evaluation.json", &evaluation)?;
        let training = SpatialSummary::new(trainer, evaluation)?;
        let summary = Summary {
            training: SpatialSummary {
                backend: self.backend.name.to_owned(),
                threads: u32::try_from(self.backend.threads).ok(),
                ..training
            },
            adapter: self.backend.adapter.clone(),
            simd: self.backend.simd.clone(),
            total_seconds: self.started.elapsed().as_secs_f64(),
            dataset: self.args.dataset.display().to_string(),
            effects: self.args.effects.choose(&scene, &cameras(trainer.views()), &trainer.shown()).verdicts,
        };
        self.folder.write_json("summary.json", &summary)?;
        Ok(summary)
    }

    fn write_scene(&self, scene: &SpatialScene) -> Result<(), Failure> {
        if scene.is_empty() {
            output::note("note: no Gaussian is left, so there is no scene.ply");
            return self.folder.leave_out("scene.ply");
        }
        let write = |path: &Path| write_spatial(path, scene, &SpatialOptions::default()).map(drop);
        self.folder.write_precious("scene.ply", write)
    }

    fn write_curve(&self, count: u32, points: &[Point]) -> Result<(), Failure> {
        let title = format!("{}: {count} Gaussians", self.args.dataset.display());
        let picture = curve::draw(points, &title).map_err(|error| Failure::failed(error).at("curve.png"))?;
        Ok(write_png(self.folder.file("curve.png"), &picture)?)
    }

    /// Where the pictures of views go, without those of an earlier training.
    fn empty_folder_of_views(&self) -> Result<PathBuf, Failure> {
        let views = self.folder.file("views");
        let Ok(entries) = fs::read_dir(&views) else { return Ok(views) };
        for name in entries.flatten().map(|entry| entry.file_name()) {
            if Path::new(&name).extension().is_some_and(|ending| ending == "png") {
                self.folder.leave_out(&Path::new("views").join(name).to_string_lossy())?;
            }
        }
        Ok(views)
    }
}

/// Some of the cameras by which a scene is judged, or that it was trained with.
fn cameras(views: &Views) -> Vec<Camera> {
    let judges = if views.test.is_empty() { &views.train } else { &views.test };
    sampled(&judges.iter().map(|view| view.camera).collect::<Vec<_>>(), ASKED_VIEWS)
}

/// A photograph with its rendering to its right, both clamped.
fn beside(photograph: Image, rendered: &Image) -> Result<Image, gs_core::Error> {
    let (width, height) = photograph.size();
    let total = 2 * width + GAP_PX;
    if total > MAX_SIDE_PX {
        return Ok(rendered.clamped());
    }
    let rendered = rendered.clamped();
    Image::from_fn(total, height, |x, y| match x.checked_sub(width + GAP_PX) {
        Some(x) => rendered.pixel(x, y),
        None if x < width => photograph.pixel(x, y),
        None => [1.0; 3],
    })
}

/// The name of a view as that of a file, without the photograph's ending: views' names may hold folders.
fn file_name(view: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let endings = [".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp", ".tiff", ".tif", ".bmp"];
    let bare = endings.iter().find_map(|ending| view.strip_suffix(ending)).unwrap_or(view);
    let name: String = bare.chars().map(plain).collect();
    name.trim_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_views_stay_in_their_folder() {
        assert_eq!(file_name("test/r_0"), "test_r_0");
        assert_eq!(file_name("../../etc/passwd"), "_.._etc_passwd");
        assert_eq!(file_name("IMG 1.jpg"), "IMG_1");
    }

    #[test]
    fn photograph_and_rendering_stand_side_by_side() {
        let photograph = Image::filled(3, 2, [0.5; 3]).unwrap();
        let rendered = Image::filled(3, 2, [2.0, 0.0, -1.0]).unwrap();
        let both = beside(photograph, &rendered).unwrap();
        assert_eq!(both.size(), (10, 2));
        assert_eq!([both.pixel(2, 1), both.pixel(4, 0), both.pixel(9, 1)], [[0.5; 3], [1.0; 3], [1.0, 0.0, 0.0]]);
    }
}
