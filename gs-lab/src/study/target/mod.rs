//! The images and scenes of a study.

mod dataset_reading;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

pub use self::dataset_reading::DatasetReading;
use super::digest;
use crate::{error::Error, synthetic::SyntheticTarget};
use gs_core::{Image, metrics::mean};
use gs_io::dataset::{Dataset, Split};
use gs_train::{
    Error as TrainError,
    train::{PosedView, Start, StartName, Views},
};

/// Where images and data sets are searched, in this order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Places {
    /// The data folder that the user has named.
    pub data: Option<PathBuf>,
    /// The folder of the study file.
    pub beside: Option<PathBuf>,
    /// Where they were found before, by their names in the study.
    pub remembered: BTreeMap<String, PathBuf>,
}

/// What a study's runs are about: an image to fit, or a scene to train from views.
#[derive(Debug, Clone)]
pub(crate) struct StudyTarget {
    /// The name in the study.
    pub(crate) name: String,
    /// The file of the image, or the data set; `None` for a synthetic target.
    pub(crate) path: Option<PathBuf>,
    /// Digest of everything that results depend on: size and pixels, or poses, files and points.
    pub(crate) digest: String,
    /// The image or the views.
    pub(crate) content: TargetContent,
    /// What runs on a scene have in common, once one of them has made it.
    shared: Arc<SharedByRuns>,
}

/// What runs on a scene have in common.
#[derive(Debug, Default)]
struct SharedByRuns {
    /// Starts of trainings, for which the images were searched.
    starts: Mutex<BTreeMap<&'static str, Start>>,
    /// The views, which share their images.
    views: OnceLock<Views>,
}

/// Most bytes of a scene's images that a study keeps in memory; others are read whenever they are
/// needed.
const HELD_BYTES: u64 = 1 << 30;

/// The content of a [`StudyTarget`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub(crate) enum TargetContent {
    /// The pixels, composited over white.
    Image(Image),
    /// The views that the study uses, with the points of the data set.
    Scene(Dataset),
}

impl StudyTarget {
    fn new(name: &str, path: Option<PathBuf>, digest: String, content: TargetContent) -> Self {
        Self { name: name.to_owned(), path, digest, content, shared: Arc::default() }
    }

    /// Makes the synthetic target of that name, or finds and reads the image file.
    ///
    /// # Errors
    /// [`Error::NotFound`], [`Error::NoTarget`], and [`Error::Io`] where the file is not an image.
    pub(crate) fn load_image(name: &str, places: &Places) -> Result<Self, Error> {
        let (path, image) = match SyntheticTarget::named(name) {
            Some(target) => (None, target.image()),
            None => {
                let path = places.find(name, Path::is_file).ok_or_else(|| places.without_image(name))?;
                let image = gs_io::read_image(&path)?.image;
                (Some(path), image)
            }
        };
        let digest = digest::of_image(&image);
        Ok(Self::new(name, path, digest, TargetContent::Image(image)))
    }

    /// Finds a data set, reads it, and leaves out the views that the study does not use. Pixels are
    /// read when they are needed.
    ///
    /// # Errors
    /// [`Error::NotFound`], and [`Error::Io`] where it is not a data set.
    pub(crate) fn load_scene(name: &str, places: &Places, reading: &DatasetReading) -> Result<Self, Error> {
        let path = places.find(name, Path::exists).ok_or_else(|| places.not_found(name, "data set"))?;
        let dataset = reading.read(None, &path)?;
        let digest = digest::of_dataset(&dataset)?;
        Ok(Self::new(name, Some(path), digest, TargetContent::Scene(dataset)))
    }

    /// The name without folder and extension.
    pub(crate) fn label(&self) -> &str {
        Path::new(&self.name).file_stem().and_then(|stem| stem.to_str()).unwrap_or(&self.name)
    }

    /// The image; `None` for a scene.
    pub(crate) fn image(&self) -> Option<&Image> {
        match &self.content {
            TargetContent::Image(image) => Some(image),
            TargetContent::Scene(_) => None,
        }
    }

    /// The data set; `None` for an image.
    pub(crate) fn dataset(&self) -> Option<&Dataset> {
        match &self.content {
            TargetContent::Image(_) => None,
            TargetContent::Scene(dataset) => Some(dataset),
        }
    }

    /// What trainings on this scene start from. Images are searched once for all runs, as the search
    /// depends on nothing but the views.
    ///
    /// # Errors
    /// Those of [`StartName::of`] and [`Start::searched`].
    pub(crate) fn start(&self, name: StartName, dataset: &Dataset, views: &[PosedView]) -> Result<Start, TrainError> {
        let mut starts = self.shared.starts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(start) = starts.get(name.name()) {
            return Ok(start.clone());
        }
        let start = name.of(dataset)?.searched(views)?;
        starts.insert(name.name(), start.clone());
        Ok(start)
    }

    /// The views of this scene. All runs share their images, which are read once.
    ///
    /// # Errors
    /// Those of [`PosedView::image`].
    pub(crate) fn views(&self, dataset: &Dataset) -> Result<Views, TrainError> {
        if let Some(views) = self.shared.views.get() {
            return Ok(views.clone());
        }
        let views = Views { keep_bytes: HELD_BYTES, most_measured: usize::MAX, ..Views::of_dataset(dataset) }.cached();
        let all = || views.train.iter().chain(&views.test);
        if Views::image_bytes(all()) <= HELD_BYTES {
            all().try_for_each(|view| {
                view.source.read_ahead();
                view.image().map(drop)
            })?;
        }
        Ok(self.shared.views.get_or_init(|| views).clone())
    }

    /// All files that are read, which must not be replaced.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        self.path.clone().into_iter().chain(self.dataset().map(Dataset::files).unwrap_or_default()).collect()
    }

    /// Pixels of an image that a step of the optimizer draws: all of an image, or the mean over the
    /// training views.
    pub(crate) fn pixels_per_step(&self) -> f64 {
        match &self.content {
            TargetContent::Image(image) => image.pixels().len() as f64,
            TargetContent::Scene(dataset) => mean(
                dataset.views_of(Split::Train).map(|view| f64::from(view.camera.width) * f64::from(view.camera.height)),
            ),
        }
    }

    /// Size of the image, or number and size of the views, for reports.
    pub(crate) fn describe(&self) -> String {
        match &self.content {
            TargetContent::Image(image) => format!("{} ({}×{} px)", self.name, image.width(), image.height()),
            TargetContent::Scene(dataset) => {
                let [train, test] = [Split::Train, Split::Test].map(|split| dataset.views_of(split).count());
                let size = dataset.views.first().map(|view| (view.camera.width, view.camera.height));
                let size = size.map_or_else(String::new, |(width, height)| format!(", {width}×{height} px"));
                format!("{} ({train} views and {test} held out{size}, {} points)", self.name, dataset.points.len())
            }
        }
    }

    /// The image that a run's picture is held against: the target's own, or that of the view of this
    /// name, before a background. `None` where there is no such view.
    pub(crate) fn reference(&self, view: Option<&str>, background: [f32; 3]) -> Result<Option<Image>, Error> {
        match &self.content {
            TargetContent::Image(image) => Ok(Some(image.clone())),
            TargetContent::Scene(dataset) => {
                let Some(view) = dataset.views.iter().find(|found| Some(found.name.as_str()) == view) else {
                    return Ok(None);
                };
                let image = view.read_image()?.over(background).map_err(gs_train::Error::from)?;
                Ok(Some(image))
            }
        }
    }
}

impl Places {
    /// Finds a file or folder under its path or, so that any folder of images can be used, under
    /// its bare name.
    fn find(&self, name: &str, is: fn(&Path) -> bool) -> Option<PathBuf> {
        let path = Path::new(name);
        let bare = path.file_name().map(Path::new);
        let candidates =
            self.folders().flat_map(|folder| [Some(path), bare].into_iter().flatten().map(|p| folder.join(p)));
        candidates.chain(self.remembered.get(name).cloned()).find(|path| is(path))
    }

    fn folders(&self) -> impl Iterator<Item = &PathBuf> {
        self.data.iter().chain(&self.beside)
    }

    fn without_image(&self, name: &str) -> Error {
        let path = Path::new(name);
        // A bare word was probably meant as a synthetic target.
        if path.extension().is_none() && path.components().count() == 1 {
            let known = SyntheticTarget::ALL.map(|target| target.name()).join(", ");
            return Error::NoTarget { image: name.to_owned(), known };
        }
        self.not_found(name, "file")
    }

    fn not_found(&self, name: &str, what: &'static str) -> Error {
        let looked = self.folders().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(" or ");
        let looked = if looked.is_empty() { "any folder".to_owned() } else { looked };
        Error::NotFound { name: name.to_owned(), what, looked }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_found_with_and_without_their_folder() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("kodak");
        std::fs::create_dir(&folder).unwrap();
        gs_io::write_png(folder.join("a.png"), &Image::filled(3, 2, [0.25; 3]).unwrap()).unwrap();
        for data in [place.path(), &folder] {
            let places = Places { data: Some(data.to_owned()), ..Places::default() };
            let target = StudyTarget::load_image("kodak/a.png", &places).unwrap();
            assert_eq!((target.label(), target.image().unwrap().size()), ("a", (3, 2)));
        }
        let lost = StudyTarget::load_image("kodak/b.png", &Places { data: Some(folder), ..Places::default() })
            .unwrap_err()
            .to_string();
        assert!(lost.contains("kodak/b.png: no such file in ") && lost.contains("--data"), "{lost}");
    }

    #[test]
    fn synthetic_targets_need_no_file_and_the_error_lists_them() {
        let unknown = StudyTarget::load_image("papier", &Places::default()).unwrap_err().to_string();
        for synthetic in SyntheticTarget::ALL {
            let target = StudyTarget::load_image(synthetic.name(), &Places::default()).unwrap();
            assert_eq!(
                (target.image(), target.label(), &target.path),
                (Some(&synthetic.image()), synthetic.name(), &None)
            );
            assert!(unknown.contains(synthetic.name()), "{unknown}");
        }
    }
}
