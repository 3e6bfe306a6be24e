//! The views that a scene is trained from, and those it is judged by.

use std::fmt;

use gs_core::{Camera, Image};
use gs_io::dataset::{AlphaMeaning, Dataset, PosedImage, Split, View};

use crate::error::Error;

/// Where a photograph comes from: memory, or a file that is read when it is needed.
pub trait ImageSource: Send + Sync {
    /// The photograph, of the size of its view's camera.
    ///
    /// # Errors
    /// Those of reading a file.
    fn read(&self) -> Result<PosedImage, gs_io::Error>;

    /// Which of its pixels count, and for how much, as far as is known without reading it.
    fn counting(&self) -> Counting {
        Counting::default()
    }
}

/// Which pixels of a photograph count, and for how much: with the same names and cameras, these make other targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counting {
    /// What its alpha channel means, if it has one.
    pub alpha: AlphaMeaning,
    /// Whether a mask leaves pixels out.
    pub masked: bool,
}

impl ImageSource for PosedImage {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        Ok(self.clone())
    }

    fn counting(&self) -> Counting {
        Counting { masked: self.mask.is_some(), ..Counting::default() }
    }
}

impl ImageSource for View {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        self.read_image()
    }

    fn counting(&self) -> Counting {
        Counting { alpha: self.alpha, masked: self.mask.is_some() }
    }
}

/// A image and the camera that took it.
pub struct PosedView {
    /// Its name, for tables.
    pub name: String,
    /// Pose and intrinsics at the photograph's size.
    pub camera: Camera,
    /// The photograph.
    pub source: Box<dyn ImageSource>,
}

impl fmt::Debug for PosedView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PosedView").field("name", &self.name).field("camera", &self.camera).finish_non_exhaustive()
    }
}

impl PosedView {
    /// An opaque photograph in memory.
    pub fn of_image(name: impl Into<String>, camera: Camera, image: Image) -> Self {
        let photograph = PosedImage { image, alpha: None, mask: None };
        Self { name: name.into(), camera, source: Box::new(photograph) }
    }

    /// The photograph.
    ///
    /// # Errors
    /// [`Error::Io`]; [`gs_core::Error::SizesDiffer`] or [`gs_core::Error::Length`] where it, its alpha or its mask is not of the camera's
    /// size; [`gs_core::Error::Setting`] where a pixel is not finite.
    pub fn photograph(&self) -> Result<PosedImage, Error> {
        let photograph = self.source.read()?;
        let PosedImage { image, alpha, mask } = &photograph;
        let (left_width, left_height) = image.size();
        let (right_width, right_height) = (self.camera.width, self.camera.height);
        if (left_width, left_height) != (right_width, right_height) {
            return Err(gs_core::Error::SizesDiffer { left_width, left_height, right_width, right_height }.into());
        }
        let expected = image.pixels().len();
        let lengths = [("alpha", alpha.as_ref().map(Vec::len)), ("mask", mask.as_ref().map(Vec::len))];
        for (what, found) in lengths.into_iter().filter_map(|(what, len)| Some((what, len?))) {
            if found != expected {
                return Err(gs_core::Error::Length { what, expected, found }.into());
            }
        }
        if let Some(bad) = image.pixels().as_flattened().iter().find(|v| !v.is_finite()) {
            return Err(gs_core::Error::setting("a pixel of a photograph", bad, "finite").into());
        }
        Ok(photograph)
    }
}

/// The views of a data set, by what they are for.
#[derive(Debug)]
pub struct Views {
    /// To train with; at least one.
    pub train: Vec<PosedView>,
    /// To be judged by, never trained with. Without any, a scene is judged by a few of those it was trained with.
    pub test: Vec<PosedView>,
    /// Most bytes of pictures that are kept in memory; what is beyond them is read again for each step that needs it.
    pub keep_bytes: u64,
}

impl Views {
    /// What [`Self::keep_bytes`] is unless it is set: 4 GiB.
    pub const KEEP_BYTES: u64 = 4 << 30;

    /// Views to train with and to be judged by.
    pub fn new(train: Vec<PosedView>, test: Vec<PosedView>) -> Self {
        Self { train, test, keep_bytes: Self::KEEP_BYTES }
    }

    /// Those of a data set, by its own split; views to choose settings by are left out.
    pub fn of_dataset(dataset: &Dataset) -> Self {
        let of = |split: Split| {
            let posed = |view: &View| PosedView {
                name: view.name.clone(),
                camera: view.camera,
                source: Box::new(view.clone()),
            };
            dataset.views_of(split).map(posed).collect()
        };
        Self::new(of(Split::Train), of(Split::Test))
    }

    /// The views to evaluate a scene with: those held out, or all if there are none.
    pub fn test_or_train(&self) -> &[PosedView] {
        if self.test.is_empty() { &self.train } else { &self.test }
    }

    /// The cameras of the views to train with.
    pub fn train_cameras(&self) -> impl ExactSizeIterator<Item = &Camera> {
        self.train.iter().map(|view| &view.camera)
    }

    /// Fails without a view to train with, or where a camera is not possible.
    ///
    /// # Errors
    /// [`gs_core::Error`] naming the view.
    pub fn validate(&self) -> Result<(), gs_core::Error> {
        if self.train.is_empty() {
            return Err(gs_core::Error::setting("the number of views to train with", 0, "at least 1"));
        }
        for view in self.train.iter().chain(&self.test) {
            view.camera.validate().map_err(|error| {
                gs_core::Error::setting("a view", format!("`{}` ({error})", view.name), "one with a possible camera")
            })?;
        }
        Ok(())
    }
}
