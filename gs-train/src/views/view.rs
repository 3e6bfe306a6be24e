//! Training views and test views.

use std::{fmt, sync::Arc};

use gs_core::{Camera, Image};
use gs_io::{
    WorldFrame,
    dataset::{AlphaMeaning, Dataset, DepthMap, PosedImage, Split, View},
};
use rayon::prelude::*;

use super::faces;
use crate::{error::Error, run::digest};

/// Source of a view's image: memory, or a file that is read when it is needed.
pub trait ImageSource: Send + Sync {
    /// Reads the image, which has the size of its view's camera.
    ///
    /// # Errors
    /// Those of reading a file.
    fn read(&self) -> Result<PosedImage, gs_io::Error>;

    /// Reads the view's depth map, if there is one.
    ///
    /// # Errors
    /// Those of reading a file.
    fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
        Ok(None)
    }

    /// Whether the image is a face of a wider one: of a 360° image or of a wide fish-eye.
    fn is_face(&self) -> bool {
        false
    }

    /// How the view's pixels count, as far as is known without reading it.
    fn counting(&self) -> Counting {
        Counting::default()
    }

    /// Whether the image is in memory, so that reading it is a copy.
    fn is_in_memory(&self) -> bool {
        false
    }

    /// A checksum of what the source reads, so that a run is not resumed with other images. By default
    /// that of the image's pixels.
    ///
    /// # Errors
    /// Those of reading a file.
    fn digest(&self) -> Result<u32, gs_io::Error> {
        let PosedImage { image, alpha, mask } = self.read()?;
        let floats = image.pixels().as_flattened().iter().chain(alpha.iter().flatten());
        let bytes = floats.flat_map(|value| value.to_le_bytes());
        let hash = digest(bytes.chain(mask.iter().flatten().map(|&counts| u8::from(counts))));
        Ok((hash ^ (hash >> 32)) as u32)
    }
}

/// How the pixels of an image count: by the meaning of its alpha, and by a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counting {
    /// Meaning of the alpha channel, if there is one.
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

    fn is_in_memory(&self) -> bool {
        true
    }
}

impl ImageSource for View {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        self.read_image()
    }

    fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
        self.read_depth()
    }

    fn digest(&self) -> Result<u32, gs_io::Error> {
        Self::digest(self)
    }

    fn is_face(&self) -> bool {
        self.source.is_face()
    }

    fn counting(&self) -> Counting {
        Counting { alpha: self.alpha, masked: self.mask.is_some() }
    }
}

/// An image and its camera.
pub struct PosedView {
    /// Name for tables.
    pub name: String,
    /// Pose and intrinsics at the image's size.
    pub camera: Camera,
    /// Source of the image.
    pub source: Box<dyn ImageSource>,
}

impl fmt::Debug for PosedView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PosedView").field("name", &self.name).field("camera", &self.camera).finish_non_exhaustive()
    }
}

impl PosedView {
    /// A view of an opaque image in memory.
    pub fn of_image(name: impl Into<String>, camera: Camera, image: Image) -> Self {
        let posed = PosedImage { image, alpha: None, mask: None };
        Self { name: name.into(), camera, source: Box::new(posed) }
    }

    /// Returns the view with its image in memory; depth map and mask stay those of the source.
    #[must_use]
    pub fn holding(self, image: Arc<PosedImage>) -> Self {
        Self { source: Box::new(Held { image, source: self.source }), ..self }
    }

    /// Reads the image.
    ///
    /// # Errors
    /// [`Error::Io`]; [`gs_core::Error::SizesDiffer`] or [`gs_core::Error::Length`] where it, its
    /// alpha or its mask is not of the camera's size; [`gs_core::Error::Pixel`] where a pixel is
    /// not finite.
    pub fn image(&self) -> Result<PosedImage, Error> {
        let posed = self.source.read()?;
        let PosedImage { image, alpha, mask } = &posed;
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
        image.check_finite("the image of a view")?;
        Ok(posed)
    }
}

/// A source whose image has been read.
struct Held {
    image: Arc<PosedImage>,
    source: Box<dyn ImageSource>,
}

impl ImageSource for Held {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        Ok((*self.image).clone())
    }

    fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
        self.source.depth()
    }

    fn digest(&self) -> Result<u32, gs_io::Error> {
        self.source.digest()
    }

    fn counting(&self) -> Counting {
        self.source.counting()
    }

    fn is_face(&self) -> bool {
        self.source.is_face()
    }

    fn is_in_memory(&self) -> bool {
        true
    }
}

/// Training views and test views.
#[derive(Debug)]
pub struct Views {
    /// Training views, at least one.
    pub train: Vec<PosedView>,
    /// Test views, which are held out. Without any, a scene is evaluated on a few training views.
    pub test: Vec<PosedView>,
    /// Largest number of bytes of images that are kept in memory, by default 4 GiB; other images
    /// are read for each step that needs them.
    pub keep_bytes: u64,
    /// The frame of the cameras, which is also that of the scene.
    pub frame: WorldFrame,
}

impl Views {
    /// Default of [`Self::keep_bytes`]: 4 GiB.
    pub const KEEP_BYTES: u64 = 4 << 30;

    /// Views with the default limit of memory, in coordinates of the world.
    pub fn new(train: Vec<PosedView>, test: Vec<PosedView>) -> Self {
        Self { train, test, keep_bytes: Self::KEEP_BYTES, frame: WorldFrame::WORLD }
    }

    /// The views of a data set, by its own split; validation views are left out.
    pub fn of_dataset(dataset: &Dataset) -> Self {
        let of = |split: Split| {
            let views: Vec<View> = dataset.views_of(split).cloned().collect();
            let named: Vec<_> = views.iter().map(|view| (view.name.clone(), view.camera)).collect();
            let posed = |((name, camera), source)| PosedView { name, camera, source };
            named.into_iter().zip(faces::sources(views)).map(posed).collect()
        };
        Self { frame: dataset.frame, ..Self::new(of(Split::Train), of(Split::Test)) }
    }

    /// Bytes of the images of these views in memory: three colours and alpha of each pixel.
    pub fn image_bytes<'a>(views: impl IntoIterator<Item = &'a PosedView>) -> u64 {
        let pixels = |view: &PosedView| u64::from(view.camera.width) * u64::from(view.camera.height);
        16 * views.into_iter().map(pixels).sum::<u64>()
    }

    /// Returns these views with the images for training in memory, unless they take more than
    /// `most_bytes`.
    ///
    /// # Errors
    /// Those of [`PosedView::image`].
    pub(crate) fn holding_training_images(mut self, most_bytes: u64) -> Result<Self, Error> {
        if Self::image_bytes(&self.train) <= most_bytes {
            let held = |view: PosedView| {
                let image = (!view.source.is_in_memory()).then(|| view.image()).transpose()?;
                Ok(match image {
                    Some(image) => view.holding(Arc::new(image)),
                    None => view,
                })
            };
            let held: Vec<_> = self.train.into_par_iter().map(held).collect();
            // The first error, whichever thread was faster.
            self.train = held.into_iter().collect::<Result<_, Error>>()?;
        }
        Ok(self)
    }

    /// The views to evaluate a scene with: those held out, or all if there are none.
    pub fn test_or_train(&self) -> &[PosedView] {
        if self.test.is_empty() { &self.train } else { &self.test }
    }

    /// Checksums of the images of all views, those for training first.
    ///
    /// # Errors
    /// Those of reading a file.
    pub(crate) fn digests(&self) -> Result<Vec<u32>, Error> {
        let views: Vec<&PosedView> = self.train.iter().chain(&self.test).collect();
        let digests: Vec<_> = views.par_iter().map(|view| view.source.digest()).collect();
        // The first error, whichever thread was faster.
        Ok(digests.into_iter().collect::<Result<_, _>>()?)
    }

    /// Cameras of the training views.
    pub fn train_cameras(&self) -> impl ExactSizeIterator<Item = &Camera> {
        self.train.iter().map(|view| &view.camera)
    }

    /// Checks that there is a training view, and that all cameras are possible.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] naming the view.
    pub(crate) fn validate(&self) -> Result<(), gs_core::Error> {
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
