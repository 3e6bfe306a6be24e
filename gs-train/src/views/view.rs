//! Training views and test views.

use std::{fmt, path::PathBuf, sync::Arc};

use gs_core::{Camera, Image, check_len, check_same_size};
use gs_io::{
    WorldFrame,
    dataset::{AlphaMeaning, CompactImage, Dataset, DepthMap, PosedImage, Split, View, Window},
};
use rayon::prelude::*;

use super::{
    cache::{ImageCache, ImageReading},
    faces,
};
use crate::{error::Error, run::digest};

/// Number of training views, evenly spread, that replace missing test views.
pub(crate) const STAND_INS: usize = 8;

/// Source of a view's image: memory, or a file that is read when it is needed.
///
/// Sources are read on several threads, among them those of rayon's global pool, all of which may wait
/// for the same image: reading must not itself wait for that pool.
pub trait ImageSource: Send + Sync {
    /// Reads the image, which has the size of its view's camera.
    ///
    /// # Errors
    /// Those of reading a file.
    fn read(&self) -> Result<PosedImage, gs_io::Error>;

    /// [`Self::read`] in fewer bytes, if the source has the image so; otherwise in as many.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    fn read_compact(&self) -> Result<CompactImage, gs_io::Error> {
        Ok(CompactImage::from(&self.read()?))
    }

    /// A part of what [`Self::read_compact`] reads.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    ///
    /// # Panics
    /// Where the window is not in the image.
    fn read_window(&self, window: Window) -> Result<CompactImage, gs_io::Error> {
        Ok(self.read_compact()?.cropped(window))
    }

    /// Says that the image will soon be read. By default, nothing is done about it.
    fn read_ahead(&self) {}

    /// What reading has cost so far, for all sources together that are read ahead; `None` for others.
    fn reading(&self) -> Option<ImageReading> {
        None
    }

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

    /// Whether the source keeps the image, so that reading it again costs little.
    fn keeps_image(&self) -> bool {
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

    fn keeps_image(&self) -> bool {
        true
    }
}

impl ImageSource for View {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        self.read_image()
    }

    fn read_compact(&self) -> Result<CompactImage, gs_io::Error> {
        Self::read_compact(self)
    }

    fn read_window(&self, window: Window) -> Result<CompactImage, gs_io::Error> {
        Self::read_window(self, window)
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

/// An image and its camera. A clone shares the source.
#[derive(Clone)]
pub struct PosedView {
    /// Name for tables.
    pub name: String,
    /// Pose and intrinsics at the image's size.
    pub camera: Camera,
    /// Source of the image.
    pub source: Arc<dyn ImageSource>,
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
        Self { name: name.into(), camera, source: Arc::new(posed) }
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
        check_same_size(image.size(), (self.camera.width, self.camera.height))?;
        let expected = image.pixels().len();
        alpha.iter().try_for_each(|alpha| check_len("alpha", expected, alpha.len()))?;
        mask.iter().try_for_each(|mask| check_len("mask", expected, mask.len()))?;
        image.check_finite("the image of a view")?;
        Ok(posed)
    }
}

/// Training views and test views. A clone shares their images.
#[derive(Debug, Clone)]
pub struct Views {
    /// Training views, at least one.
    pub train: Vec<PosedView>,
    /// Test views, which are held out. Without any, a scene is evaluated on a few training views.
    pub test: Vec<PosedView>,
    /// Largest number of bytes of images that are kept in memory, by default 2 GiB, besides the few
    /// that are read ahead.
    pub keep_bytes: u64,
    /// Folder for a file with the images that exceed the memory; it has no name, and is gone with the
    /// views. Without a folder, such images are read each time that they are needed.
    pub cache_folder: Option<PathBuf>,
    /// Largest number of test views, evenly spread, that are measured while a scene is trained, by
    /// default 8: a curve needs no more. The result is evaluated on all.
    pub most_measured: usize,
    /// The frame of the cameras, which is also that of the scene.
    pub frame: WorldFrame,
}

impl Views {
    /// Default of [`Self::keep_bytes`]: 2 GiB.
    pub const KEEP_BYTES: u64 = 2 << 30;

    /// Default of [`Self::most_measured`].
    pub const MOST_MEASURED: usize = 8;

    /// Views with the default limits, in coordinates of the world.
    pub fn new(train: Vec<PosedView>, test: Vec<PosedView>) -> Self {
        let (keep_bytes, frame) = (Self::KEEP_BYTES, WorldFrame::WORLD);
        Self { train, test, keep_bytes, cache_folder: None, most_measured: Self::MOST_MEASURED, frame }
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

    /// Returns these views with images that are read once, ahead of the steps that need them, and kept
    /// in few bytes within the limits of [`Self::keep_bytes`] and [`Self::cache_folder`]. Images that
    /// their sources keep already stay there.
    ///
    /// Trainings do this with their views. Done before, it lets several of them share the images.
    #[must_use]
    pub fn cached(mut self) -> Self {
        let uncached = |view: &&mut PosedView| !view.source.keeps_image();
        let mut views: Vec<&mut PosedView> = self.train.iter_mut().chain(&mut self.test).filter(uncached).collect();
        let sources = views.iter().map(|view| Arc::clone(&view.source)).collect();
        let cached = ImageCache::sources(sources, self.keep_bytes, self.cache_folder.clone());
        views.iter_mut().zip(cached).for_each(|(view, source)| view.source = source);
        self
    }

    /// Bytes that the images of these views take in a cache, if they have 8 bits a channel.
    pub fn cached_bytes(&self) -> u64 {
        let cached = self.train.iter().chain(&self.test).filter(|view| view.source.reading().is_some());
        3 * cached.map(|view| u64::from(view.camera.width) * u64::from(view.camera.height)).sum::<u64>()
    }

    /// What reading the images has cost so far; `None` where all were in memory from the start.
    pub fn reading(&self) -> Option<ImageReading> {
        self.train.iter().chain(&self.test).find_map(|view| view.source.reading())
    }

    /// The views to evaluate a scene with: those held out, or all if there are none.
    pub fn test_or_train(&self) -> &[PosedView] {
        if self.test.is_empty() { &self.train } else { &self.test }
    }

    /// Number of views that a scene is evaluated with, and of those that are measured while it is trained.
    pub fn evaluated(&self) -> (usize, usize) {
        let evaluated = if self.test.is_empty() { self.train.len().min(STAND_INS) } else { self.test.len() };
        (evaluated, evaluated.min(self.most_measured.max(1)))
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
        gs_core::Error::within("the number of views to train with", self.train.len(), 1.., "at least 1")?;
        for view in self.train.iter().chain(&self.test) {
            view.camera.validate().map_err(|error| {
                gs_core::Error::setting("a view", format!("`{}` ({error})", view.name), "one with a possible camera")
            })?;
        }
        Ok(())
    }
}
